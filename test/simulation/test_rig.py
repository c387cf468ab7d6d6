# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated rigs: perfect, random with their tolerances, and of a file."""

from dataclasses import replace
import json
from math import radians

from encoder_frames import values
from harness import DATA
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.simulation import rig

TOLERANCES = rig.Tolerances(0.004, 0.003, 0.002, 0.001)


def test_the_default_rig_is_as_drawn_and_so_is_one_without_tolerances():
    assert rig.make_rig(values('sim')) == rig.perfect_rig(Geometry(), radians(0.04))
    same = rig.make_rig(
        values(
            'sim',
            geometry__alpha_deg=40.0,
            sim__rig_seed=5,
            sim__tolerance_deg=(0.0, 0.0),
            sim__harmonics_deg=(0.0, 0.0),
        )
    )
    assert same.geometry.alphas == Geometry(radians(40.0)).alphas
    np.testing.assert_allclose(same.geometry.platform_axes, Geometry().platform_axes, atol=1e-14)
    assert same.sensors == rig.perfect_rig(Geometry(), radians(0.04)).sensors
    assert not same.has_harmonics
    assert rig.random_rig(3, TOLERANCES).has_harmonics
    plain = rig.random_rig(3, rig.Tolerances())
    assert plain.sensors == (rig.SensorErrors(),) * 4
    np.testing.assert_allclose(plain.geometry.base_axes, Geometry().base_axes, atol=1e-14)


def test_the_seed_decides_the_rig_and_more_sensors_leave_the_others():
    four = rig.random_rig(3, TOLERANCES, noise=0.001)
    six = rig.random_rig(3, TOLERANCES, noise=0.001, sensors=6)
    harmonics = {each.first_harmonic for each in six.sensors}
    assert six.geometry == four.geometry
    assert six.sensors[:4] == four.sensors
    assert len(harmonics) == 6
    assert rig.random_rig(4, TOLERANCES, noise=0.001) != four


def test_random_rigs_have_their_tolerances_in_frames_without_a_reference():
    rigs = [rig.random_rig(seed, TOLERANCES) for seed in range(1, 401)]
    drawn = Geometry()

    def between(axes):
        """Angles between neighbouring axes, which no choice of a frame changes."""
        axes = np.array(axes)
        cosines = (axes * np.roll(axes, -1, axis=0)).sum(1)
        return np.arccos(cosines)

    def off(figures):
        return np.array([figures(made.geometry) for made in rigs]) - figures(drawn)

    for figures, deviation in (
        (lambda g: np.array(g.alphas + g.betas), 0.004),
        (lambda g: between(g.base_axes), 2.0**0.5 * 0.003),
        (lambda g: between(g.platform_axes), 2.0**0.5 * 0.003),
    ):
        np.testing.assert_allclose(off(figures).std(0), deviation, rtol=0.12)
        np.testing.assert_allclose(off(figures).mean(0), 0.0, atol=0.2 * deviation)
    first = []
    second = []
    for made in rigs:
        first.append([sensor.first_harmonic for sensor in made.sensors])
        second.append([sensor.second_harmonic for sensor in made.sensors])
    np.testing.assert_allclose(np.std(first, axis=0), 0.002, rtol=0.12)
    np.testing.assert_allclose(np.std(second, axis=0), 0.001, rtol=0.12)
    assert all(made.geometry.base_axes[0] == (0.0, 0.0, 1.0) for made in rigs)


@pytest.mark.parametrize('count', [4, 6])
def test_a_written_rig_is_read_again(count, tmp_path):
    path = tmp_path / 'rig.json'
    tolerances = rig.Tolerances(0.01, 0.01, 0.005, 0.001)
    made = rig.random_rig(11, tolerances, noise=0.001, sensors=count)
    *others, last = made.sensors
    last = replace(
        last,
        play=0.002,
        resolution=0.003,
        delay=0.004,
    )
    made = replace(made, sensors=(*others, last))
    path.write_text(rig.rig_text(made))
    again = rig.read_rig(path, Geometry(), 1.0, count)
    for name in ('alphas', 'betas', 'base_axes', 'platform_axes'):
        expected = getattr(made.geometry, name)
        np.testing.assert_allclose(getattr(again.geometry, name), expected, atol=1e-15)
    for one, other in zip(again.sensors, made.sensors, strict=True):
        for name in rig.SensorErrors.__slots__:
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-15)
    with pytest.raises(InputError, match=r"key '\w+' is .*; expected a list of 5"):
        rig.read_rig(path, Geometry(), 0.0, 5)


def test_what_a_file_lacks_is_perfect(tmp_path):
    path = tmp_path / 'rig.json'
    path.write_text(
        '{"play_deg": [0.1, 0, 0, 0], "zero": [0, 1, 2, 3], "direction": [1, -1, 1, 1]}'
    )
    noisy = rig.SensorErrors(noise=radians(0.04))
    drawn = Geometry(alpha=radians(40.0))
    made = rig.make_rig(values('sim', sim__rig_file=str(path), geometry__alpha_deg=40.0))
    assert made == rig.Rig(drawn, (replace(noisy, play=radians(0.1)), noisy, noisy, noisy))
    assert made.geometry.alpha == drawn.alpha
    path.write_text('{"alpha_deg": [39, 40, 41], "noise_deg": [0, 0.1, 0, 0]}')
    made = rig.read_rig(path, drawn, radians(0.04))
    np.testing.assert_allclose(np.degrees(made.geometry.alphas), [39.0, 40.0, 41.0])
    assert made.geometry.betas == drawn.betas
    assert made.geometry.platform_axes == drawn.platform_axes
    assert [sensor.noise for sensor in made.sensors] == [0.0, radians(0.1), 0.0, 0.0]


AXES = [
    [0.0, 0.0, 1.0],
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
]


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ('{"alpha_deg": [39, 39, 39]', 'cannot be read'),
        pytest.param('[' * 9999, 'cannot be read: maximum recursion depth', id='nested'),
        ('"text"', "not a rig ('text'); expected a JSON object"),
        *(
            (json.dumps({key: value}), f"key '{key}' is {value}; expected {expected}")
            for key, value, expected in (
                ('alpha', [39, 39, 39], 'one of the keys alpha_deg, beta_deg'),
                ('alpha_deg', [39, 39], 'a list of 3, each a number from 0.1 to 179.9'),
                ('beta_deg', [34, True, 34], 'a list'),
                ('base_axes', AXES[:2], 'a list of 3 of lists of 3, each a number from -1 to 1'),
                *(
                    (key, [[0.0, 0.0, 1.5 * sign], *AXES[1:]], 'a list of 3 of lists of 3')
                    for key in ('base_axes', 'platform_axes')
                    for sign in (-1.0, 1.0)
                ),
                (
                    'eccentricity_deg_cos_sin',
                    [0.1] * 4,
                    'a list of 4 of lists of 2, each a number from -10 to 10',
                ),
                ('delay', [0, 0, 0, 0.2], 'a list of 4, each a number from 0 to 0.1'),
            )
        ),
        (json.dumps({'base_axes': [*AXES[:2], [0, 0.9, 0]]}), 'row 2 = [0.0, 0.9, 0.0]'),
    ],
)
def test_what_is_wrong_is_named_in_one_line(content, words, tmp_path):
    path = tmp_path / 'rig.json'
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        rig.read_rig(path, Geometry(), 0.0)
    text = str(caught.value)
    assert text.startswith(f'{path}: ')
    assert words in text
    assert '\n' not in text


def test_settings_that_contradict_each_other():
    with pytest.raises(SettingError, match=r"'sim.rig_seed' is 2; expected 0 with a sim.rig_file"):
        rig.make_rig(values('sim', sim__rig_file=str(DATA / 'rig' / 'rig.json'), sim__rig_seed=2))


def test_a_key_that_is_given_twice_is_refused(tmp_path):
    """The reader of JSON would take the last one."""
    path = tmp_path / 'rig.json'
    path.write_text('{"noise_deg": [0.0, 0.0, 0.0, 0.0], "noise_deg": [1.0, 1.0, 1.0, 1.0]}')
    with pytest.raises(
        InputError, match="rig.json: cannot be read: key 'noise_deg' is given twice"
    ):
        rig.read_rig(path, Geometry(), 0.0)
