# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated rig that is not perfect: its file, random ones, and what its sensors read."""

import csv
from dataclasses import replace
import gzip
import json
from math import cos, pi, radians, sin

import can
from encoder_frames import decoder, values
from harness import DATA
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.kinematics import (
    estimate,
    Geometry,
    inverse,
    matrix_from_quaternion,
)
from spm_haptic_master.nodes.source_factory import make_source
from spm_haptic_master.simulation.noisy_motion import NoisyMotion
from spm_haptic_master.simulation.rig import (
    perfect_rig,
    random_rig,
    Rig,
    SensorErrors,
    Tolerances,
)
from spm_haptic_master.simulation.rig_file import read_rig, rig_text
from spm_haptic_master.simulation.settings import make_motion, make_rig
from spm_haptic_master.simulation.trajectories import sweep

RIG = DATA / 'rig'
MODE = (1, 1, 1)
SIGMA = radians(0.04)
COUNT = 2.0 * pi / 16384


def true_joints(motion, times):
    return np.array([motion.joints(t) for t in times])


def measured(motion, times):
    return np.array([motion.angles(t) for t in times])


def orientations(motion, times):
    return matrix_from_quaternion(np.array([motion.orientation(t) for t in times]))


def motion_of(*sensors, geometry=None, seed=1):
    """Return a motion of four sensors, the first ones as given."""
    errors = (*sensors, *[SensorErrors()] * (4 - len(sensors)))
    return NoisyMotion(sweep(radians(20.0)), Rig(geometry or Geometry(), errors), seed, MODE)


# The mechanism ---------------------------------------------------------------------------------

@pytest.mark.parametrize('source', ['sim', 'file'])
def test_angles_are_consistent_with_the_mechanism_as_built_only(source, tmp_path):
    rig = random_rig(7, Tolerances(links=radians(0.25), axes=radians(0.25)), noise=SIGMA)
    path = tmp_path / 'rig.json'
    path.write_text(rig_text(rig))
    chosen = {'sim__rig_seed': 7, 'sim__harmonics_deg': (0.0, 0.0)} if source == 'sim' \
        else {'sim__rig_file': str(path)}
    simulated = make_source('sim', values('sim', sim__trajectory='sweep', **chosen))
    times = np.arange(0.0, 60.0, 0.05)
    angles = np.array([simulated.angles(t) for t in times])
    truth = orientations(make_motion(values('sim', sim__trajectory='sweep', **chosen)), times)
    joints = inverse(truth, simulated.rig.geometry)
    error = angles - np.column_stack([joints.theta1, joints.theta3a])
    np.testing.assert_allclose(error.std(0), np.hypot(SIGMA, COUNT / 12**0.5), rtol=0.06)
    np.testing.assert_allclose(error.mean(0), 0.0, atol=4.0 * SIGMA / len(times)**0.5)
    built = estimate(angles[:, :3], angles[:, 3], SIGMA, simulated.rig.geometry)
    assert built.parity.std() == pytest.approx(1.01, abs=0.06)
    nominal = estimate(angles[:, :3], angles[:, 3], SIGMA)
    assert (nominal.parity**2).mean() > 30.0


def test_the_default_rig_is_as_drawn():
    assert make_rig(values('sim')) == perfect_rig(Geometry(), radians(0.04))
    # And one without tolerances, of another drawing.
    same = make_rig(values('sim', geometry__alpha_deg=40.0, sim__rig_seed=5,
                           sim__tolerance_deg=(0.0, 0.0))).geometry
    assert same.alphas == Geometry(radians(40.0)).alphas
    np.testing.assert_allclose(same.platform_axes, Geometry().platform_axes, atol=1e-14)


@pytest.mark.slow
def test_a_recorded_rig_reads_as_recorded():
    """From an independent model: mechanism, frames, zeros and both harmonics."""
    settings = json.loads((RIG / 'rig.json').read_text())
    taker = decoder(encoders__zero_count=tuple(settings['zero']),
                    encoders__direction=tuple(settings['direction']))
    with can.LogReader(RIG / 'dev_check.log.gz') as log:
        samples = [sample for sample in map(taker.feed, log) if sample is not None]
    with gzip.open(RIG / 'dev_check_truth.csv.gz', 'rt') as file:
        rows = np.array(list(csv.reader(file))[1:], dtype=float)
    stamps = np.array([sample.stamp for sample in samples]) * 1e-9
    index = np.searchsorted(stamps, rows[:, 0] - 1e-4)
    angles = np.array([sample.angles for sample in samples])[index]
    rig = read_rig(RIG / 'rig.json', Geometry(), 0.0)
    joints = inverse(matrix_from_quaternion(rows[:, 1:]), rig.geometry)
    true = np.column_stack([joints.theta1, joints.theta3a])

    def residual(**without):
        sensors = [replace(sensor, **without) for sensor in rig.sensors]
        expected = [[sensor.with_harmonics(angle) for sensor, angle in
                     zip(sensors, row, strict=True)] for row in true]
        return np.degrees(np.angle(np.exp(1j * (angles - expected))))

    noise = 0.04 / len(rows)**0.5
    assert np.abs(residual().mean(0)).max() < 4.0 * noise
    assert residual().std() == pytest.approx(0.0404, abs=0.001)
    assert np.abs(residual(second_harmonic=(0.0, 0.0)).mean(0)).max() > 7.0 * noise
    assert np.abs(residual(first_harmonic=(0.0, 0.0)).mean(0)).max() > 12.0 * noise


# Random rigs -----------------------------------------------------------------------------------

def test_the_seed_decides_the_rig():
    tolerances = Tolerances(0.004, 0.004, 0.002, 0.001)
    assert random_rig(3, tolerances) == random_rig(3, tolerances) != random_rig(4, tolerances)
    once, twice = (random_rig(3, Tolerances(links=links)) for links in (0.001, 0.002))
    off = np.array([rig.geometry.alphas + rig.geometry.betas for rig in (once, twice)]) \
        - np.array(Geometry().alphas + Geometry().betas)
    np.testing.assert_allclose(off[1], 2.0 * off[0], rtol=1e-9)
    perfect = random_rig(3, Tolerances())
    np.testing.assert_allclose(perfect.geometry.platform_axes, Geometry().platform_axes,
                               atol=1e-15)
    assert perfect.sensors == perfect_rig(Geometry(), 0.0).sensors


def test_random_rigs_have_their_tolerances():
    rigs = [random_rig(seed, Tolerances(0.004, 0.003, 0.002, 0.001)) for seed in range(1, 401)]
    drawn = Geometry()
    links = np.array([rig.geometry.alphas + rig.geometry.betas for rig in rigs]) \
        - np.array(drawn.alphas + drawn.betas)
    np.testing.assert_allclose(links.std(0), 0.004, rtol=0.12)
    np.testing.assert_allclose(links.mean(0), 0.0, atol=0.0008)

    def between(axes):
        """Angles between neighbouring axes, which no choice of a frame changes."""
        axes = np.array(axes)
        return np.arccos((axes * np.roll(axes, -1, axis=0)).sum(1))

    for name in ('base_axes', 'platform_axes'):
        off = np.array([between(getattr(rig.geometry, name)) for rig in rigs]) \
            - between(getattr(drawn, name))
        np.testing.assert_allclose(off.std(0), 2.0**0.5 * 0.003, rtol=0.12)
    for name, deviation in (('first_harmonic', 0.002), ('second_harmonic', 0.001)):
        found = np.array([[getattr(sensor, name) for sensor in rig.sensors] for rig in rigs])
        np.testing.assert_allclose(found.std(0), deviation, rtol=0.12)
    # The frames need no outside reference.
    for rig in rigs[:20]:
        assert rig.geometry.base_axes[0] == (0.0, 0.0, 1.0)
        assert rig.geometry.base_axes[1][1] == 0.0 < rig.geometry.base_axes[1][0]
        np.testing.assert_allclose(
            np.cross(rig.geometry.platform_axes, drawn.platform_axes).sum(0), 0.0, atol=1e-14)


# The sensors -----------------------------------------------------------------------------------

TIMES = np.arange(0.0, 30.0, 0.01)


def test_harmonics_of_a_turn():
    sensor = SensorErrors((0.01, -0.02), (0.003, 0.004))
    for angle in np.linspace(-3.0, 3.0, 13):
        assert sensor.with_harmonics(angle) == pytest.approx(
            angle + 0.01 * cos(angle) - 0.02 * sin(angle) + 0.003 * cos(2.0 * angle)
            + 0.004 * sin(2.0 * angle), abs=1e-15)
    motion = motion_of(sensor)
    error = measured(motion, TIMES) - true_joints(motion, TIMES)
    np.testing.assert_allclose(
        error[:, 0], [sensor.with_harmonics(angle) - angle
                      for angle in true_joints(motion, TIMES)[:, 0]], atol=1e-15)
    assert np.abs(error[:, 1:]).max() == 0.0


def test_play_is_lost_at_each_turn_of_the_joint():
    play = radians(0.3)
    motion = motion_of(SensorErrors(), SensorErrors(play=play))
    joint = true_joints(motion, TIMES)[:, 1]
    lag = measured(motion, TIMES)[:, 1] - joint
    assert np.abs(lag).max() <= 0.5 * play + 1e-12
    speed = np.gradient(joint, TIMES)
    # Far from a reversal the encoder trails by half the play.
    steady = np.abs(speed) > 0.5 * np.abs(speed).max()
    np.testing.assert_allclose(lag[steady], -0.5 * play * np.sign(speed[steady]), atol=1e-12)
    assert {-1.0, 1.0} == set(np.sign(speed[steady]))
    # At a reversal the encoder rests until the joint has crossed the play.
    resting = np.diff(lag + joint)
    crossed = np.abs(np.diff(joint))[np.abs(resting) < 1e-12].sum()
    reversals = np.count_nonzero(np.diff(np.sign(np.diff(joint))))
    assert crossed == pytest.approx(play * reversals, rel=0.15)


def test_play_follows_across_half_a_turn():
    motion = motion_of(SensorErrors(play=0.01))
    shafts = [motion._shaft(0, angle, 0.005) for angle in (pi - 0.001, -pi + 0.003, -pi + 0.02)]
    assert shafts == pytest.approx([pi - 0.001, -pi - 0.001, -pi + 0.015])


def test_a_delayed_sensor_reads_the_past():
    delays = (0.0, 0.003, 0.0, 0.0005)
    motion = motion_of(*(SensorErrors(delay=delay) for delay in delays))
    readings, joints = measured(motion, TIMES), true_joints(motion, TIMES)
    speed = (true_joints(motion, TIMES + 1e-5) - true_joints(motion, TIMES - 1e-5)) / 2e-5
    found = -((readings - joints) * speed).sum(0) / (speed**2).sum(0)
    np.testing.assert_allclose(found, delays, atol=2e-5)
    # The true orientation is that of the sample's time.
    np.testing.assert_allclose(
        inverse(orientations(motion, TIMES[:50])).theta1, joints[:50, :3], atol=1e-12)


def test_each_sensor_has_its_noise_and_resolution():
    noise, resolution = (0.0, 0.001, 0.0, 0.002), (0.005, 0.0, 0.0, 0.01)
    motion = motion_of(*(SensorErrors(noise=sigma, resolution=step)
                         for sigma, step in zip(noise, resolution, strict=True)))
    readings, joints = measured(motion, TIMES), true_joints(motion, TIMES)
    error = readings - joints
    assert error[:, 1].std() == pytest.approx(0.001, rel=0.03)
    assert error[:, 2].std() == 0.0
    for index in (0, 3):
        steps = readings[:, index] / resolution[index]
        assert np.abs(steps - steps.round()).max() < 1e-9
    assert np.abs(error[:, 0]).max() == pytest.approx(0.0025, rel=0.02)
    assert error[:, 3].std() == pytest.approx(np.hypot(0.002, 0.01 / 12**0.5), rel=0.05)


# The file --------------------------------------------------------------------------------------

def test_a_written_rig_is_read_again(tmp_path):
    rig = random_rig(11, Tolerances(0.01, 0.01, 0.005, 0.001), noise=0.001)
    rig = replace(rig, sensors=(*rig.sensors[:3], replace(
        rig.sensors[3], play=0.002, resolution=0.003, delay=0.004)))
    path = tmp_path / 'rig.json'
    path.write_text(rig_text(rig))
    again = read_rig(path, Geometry(), 1.0)
    for name in ('alphas', 'betas', 'base_axes', 'platform_axes'):
        np.testing.assert_allclose(
            getattr(again.geometry, name), getattr(rig.geometry, name), atol=1e-15)
    for one, other in zip(again.sensors, rig.sensors, strict=True):
        for name in SensorErrors.__slots__:
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-15)
    assert set(json.loads(rig_text(rig))) >= set(json.loads(
        (RIG / 'rig.json').read_text())) - {'zero', 'direction'}


def test_what_a_file_lacks_is_perfect(tmp_path):
    path = tmp_path / 'rig.json'
    path.write_text('{"play_deg": [0.1, 0, 0, 0]}')
    rig = make_rig(values('sim', sim__rig_file=str(path), geometry__alpha_deg=40.0))
    assert rig == replace(
        perfect_rig(make_rig(values('sim', geometry__alpha_deg=40.0)).geometry, radians(0.04)),
        sensors=(SensorErrors(play=radians(0.1), noise=radians(0.04)),
                 *[SensorErrors(noise=radians(0.04))] * 3))
    path.write_text('{"alpha_deg": [39, 40, 41], "noise_deg": [0, 0.1, 0, 0]}')
    rig = read_rig(path, Geometry(), radians(0.04))
    np.testing.assert_allclose(np.degrees(rig.geometry.alphas), [39.0, 40.0, 41.0])
    assert rig.geometry.platform_axes == Geometry().platform_axes
    assert [sensor.noise for sensor in rig.sensors] == [0.0, radians(0.1), 0.0, 0.0]


AXES = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


@pytest.mark.parametrize(('key', 'value', 'words'), [
    ('alpha', [39, 39, 39], ["key 'alpha' is [39, 39, 39]", 'one of the keys alpha_deg']),
    ('alpha_deg', [39, 39], ["key 'alpha_deg' is [39, 39]", 'a list of 3, each', '0.1 to 179.9']),
    ('alpha_deg', 39.3, ["'alpha_deg' is 39.3", 'a list of 3']),
    ('alpha_deg', [39, 39, 0], ['[39, 39, 0]', 'from 0.1 to 179.9']),
    ('beta_deg', [34, True, 34], ['[34, True, 34]']),
    ('beta_deg', [34, '34', 34], ["'34'"]),
    ('beta_deg', [34, None, 34], ['None']),
    ('beta_deg', [34, float('nan'), 34], ['nan']),
    ('beta_deg', [34, float('inf'), 34], ['inf']),
    ('beta_deg', [34, 10**400, 34], ["'beta_deg' is [34, 1000", 'from 0.1']),
    ('base_axes', AXES[:2], ["'base_axes'", 'a list of 3 of lists of 3']),
    ('base_axes', [*AXES[:2], [0, 1]], ['[0, 1]', 'lists of 3']),
    ('base_axes', [*AXES[:2], [0, 2, 0]], ['[0, 2, 0]', 'from -1 to 1']),
    ('base_axes', [*AXES[:2], [0, 0.9, 0]], ['row 2 = [0.0, 0.9, 0.0]', 'a unit vector']),
    ('base_axes', [*AXES[:2], AXES[1]], ['rows 1 and 2', 'parallel']),
    ('platform_axes', [[0, 0, -1], *AXES[1:]], ['Z3A', 'opposite']),
    ('eccentricity_deg_cos_sin', [[0.1, 0.1]] * 3, ['a list of 4 of lists of 2']),
    ('eccentricity_deg_cos_sin', [0.1] * 4, ['a list of 4 of lists of 2']),
    ('second_harmonic_deg', [[0.0, 11.0]] * 4, ['11.0', 'from -10 to 10']),
    ('play_deg', [-0.1, 0, 0, 0], ["'play_deg' is [-0.1, 0, 0, 0]", 'from 0 to 10']),
    ('noise_deg', [0.1, 0.1, 0.1], ["'noise_deg' is [0.1, 0.1, 0.1]", 'a list of 4']),
    ('resolution_deg', {'joint_1a': 1}, ["{'joint_1a': 1}", 'a list of 4']),
    ('delay', [0, 0, 0, 0.2], ['[0, 0, 0, 0.2]', 'from 0 to 0.1']),
    ('zero', [1, 2, 3, -4], ["'zero' is [1, 2, 3, -4]", 'an integer of at least 0']),
    ('direction', [1, 1, 1, 0], ["'direction' is [1, 1, 1, 0]", '1 or -1']),
])
def test_a_wrong_value_is_named_in_one_line(key, value, words, tmp_path):
    path = tmp_path / 'rig.json'
    path.write_text(json.dumps({key: value}))
    with pytest.raises(InputError) as caught:
        read_rig(path, Geometry(), 0.0)
    text = str(caught.value)
    assert text.startswith(f'{path}: ') and '\n' not in text and len(text) < 600
    assert [word for word in words if word not in text] == []


@pytest.mark.parametrize(('content', 'words'), [
    (b'{"alpha_deg": [39, 39, 39]', 'cannot be read'), (b'', 'cannot be read'),
    (b'\xff\xfe\x00', 'cannot be read'), (b'[' * 100000, 'cannot be read'),
    (b'[1, 2]', 'not a rig ([1, 2])'), (b'"text"', "not a rig ('text')"),
    (b'{"zero": 1, "zero": 2}', "key 'zero' is there twice"),
    (b'{"play_deg": [1e400, 0, 0, 0]}', 'inf'),
])
def test_a_file_that_is_no_rig(content, words, tmp_path):
    path = tmp_path / 'rig.json'
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_rig(path, Geometry(), 0.0)
    assert words in str(caught.value) and '\n' not in str(caught.value)


def test_settings_that_contradict_each_other(tmp_path):
    with pytest.raises(InputError, match='nowhere.json: cannot be read'):
        make_motion(values('sim', sim__rig_file=str(tmp_path / 'nowhere.json')))
    with pytest.raises(SettingError, match=r"'sim.rig_seed' is 2; expected 0 with a sim.rig_file"):
        make_motion(values('sim', sim__rig_file=str(RIG / 'rig.json'), sim__rig_seed=2))


def test_a_motion_out_of_the_mechanisms_reach_is_refused(tmp_path):
    path = tmp_path / 'rig.json'
    path.write_text('{"alpha_deg": [39.3, 39.3, 31], "beta_deg": [34.1, 34.1, 26]}')
    make_motion(values('sim', sim__rig_file=str(path)))
    with pytest.raises(SettingError, match="'sim.trajectory' is 'sweep'; expected a motion within "
                       'reach of the simulated mechanism'):
        make_motion(values('sim', sim__trajectory='sweep', sim__rig_file=str(path)))
