# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The file of a simulated rig: what is written is read, and what is wrong is named."""

from dataclasses import replace
import json
from math import radians

from encoder_frames import values
from harness import DATA
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.rig import (
    make_rig,
    random_rig,
    read_rig,
    Rig,
    rig_text,
    SensorErrors,
    Tolerances,
)

RIG = DATA / 'rig'


@pytest.fixture
def path(tmp_path):
    """Give the path of a file."""
    return tmp_path / 'rig.json'


@pytest.mark.parametrize('count', [4, 6])
def test_a_written_rig_is_read_again(count, path):
    rig = random_rig(11, Tolerances(0.01, 0.01, 0.005, 0.001), noise=0.001, sensors=count)
    rig = replace(rig, sensors=(*rig.sensors[:-1], replace(
        rig.sensors[-1], play=0.002, resolution=0.003, delay=0.004)))
    path.write_text(rig_text(rig))
    again = read_rig(path, Geometry(), 1.0, count)
    for name in ('alphas', 'betas', 'base_axes', 'platform_axes'):
        np.testing.assert_allclose(
            getattr(again.geometry, name), getattr(rig.geometry, name), atol=1e-15)
    for one, other in zip(again.sensors, rig.sensors, strict=True):
        for name in SensorErrors.__slots__:
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-15)
    with pytest.raises(InputError, match=r"key '\w+' is .*; expected a list of 5"):
        read_rig(path, Geometry(), 0.0, 5)


def test_what_a_file_lacks_is_perfect(path):
    path.write_text('{"play_deg": [0.1, 0, 0, 0], "zero": [0, 1, 2, 3], "direction": '
                    '[1, -1, 1, 1]}')
    noisy = SensorErrors(noise=radians(0.04))
    drawn = Geometry(alpha=radians(40.0))
    rig = make_rig(values('sim', sim__rig_file=str(path), geometry__alpha_deg=40.0))
    assert rig == Rig(drawn, (replace(noisy, play=radians(0.1)), noisy, noisy, noisy))
    path.write_text('{"alpha_deg": [39, 40, 41], "noise_deg": [0, 0.1, 0, 0]}')
    rig = read_rig(path, drawn, radians(0.04))
    np.testing.assert_allclose(np.degrees(rig.geometry.alphas), [39.0, 40.0, 41.0])
    assert (rig.geometry.betas, rig.geometry.platform_axes) == (drawn.betas, drawn.platform_axes)
    assert [sensor.noise for sensor in rig.sensors] == [0.0, radians(0.1), 0.0, 0.0]


AXES = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


@pytest.mark.parametrize(('content', 'words'), [
    ('{"alpha_deg": [39, 39, 39]', 'cannot be read'), ('[' * 100000, 'cannot be read'),
    ('"text"', "not a rig ('text'); expected a JSON object"),
    ('{"zero": 1, "zero": 2}', "key 'zero' is there twice"),
    *((json.dumps({key: value}), f"key '{key}' is {value}; expected {expected}")
      for key, value, expected in (
          ('alpha', [39, 39, 39], 'one of the keys alpha_deg, beta_deg'),
          ('alpha_deg', [39, 39], 'a list of 3, each a number from 0.1 to 179.9'),
          ('alpha_deg', [39, 39, 0], 'a list of 3'),
          ('beta_deg', [34, float('nan'), 34], 'a list'), ('beta_deg', [34, True, 34], 'a list'),
          ('base_axes', AXES[:2], 'a list of 3 of lists of 3, each a number from -1 to 1'),
          ('platform_axes', [*AXES[:2], [0, 2, 0]], 'a list of 3 of lists of 3'),
          ('eccentricity_deg_cos_sin', [0.1] * 4, 'a list of 4 of lists of 2, each a number from '
           '-10 to 10'),
          ('second_harmonic_deg', [[0.0, 11.0]] * 4, 'a list of 4 of lists of 2'),
          ('play_deg', [-0.1, 0, 0, 0], 'a list of 4, each a number from 0 to 10'),
          ('resolution_deg', {'joint_1a': 1}, 'a list of 4'),
          ('delay', [0, 0, 0, 0.2], 'a list of 4, each a number from 0 to 0.1'),
          ('zero', [1, 2, 3, -4], 'a list of 4, each an integer of at least 0'),
          ('direction', [1, 1, 1, 0], 'a list of 4, each 1 or -1'))),
    (json.dumps({'base_axes': [*AXES[:2], [0, 0.9, 0]]}), 'row 2 = [0.0, 0.9, 0.0]'),
    (json.dumps({'platform_axes': [[0, 0, -1], *AXES[1:]]}), 'Z3A'),
])
def test_what_is_wrong_is_named_in_one_line(content, words, path):
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        read_rig(path, Geometry(), 0.0)
    text = str(caught.value)
    assert text.startswith(f'{path}: ') and words in text and '\n' not in text


def test_settings_that_contradict_each_other(tmp_path):
    with pytest.raises(InputError, match='nowhere.json: cannot be read'):
        make_motion(values('sim', sim__rig_file=str(tmp_path / 'nowhere.json')))
    with pytest.raises(SettingError, match=r"'sim.rig_seed' is 2; expected 0 with a sim.rig_file"):
        make_motion(values('sim', sim__rig_file=str(RIG / 'rig.json'), sim__rig_seed=2))
