# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an attack on the supervision looked for: no wrong orientation, no silence for good."""

from itertools import product

from device import encoders, joint_angles, motion, Outcome
from disturbed import about, disturbance, ENCODERS, random_pose, run
import numpy as np
import pytest
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import forward_all, inverse
from spm_haptic_master.kinematics.estimation.sample_estimation import estimate_sample
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION
from spm_haptic_master.supervision.settings import limits_from

SENSORS = (4, 5, 6)
# Beginning of a fault (samples).
BEGIN = 1500
SEEDS = [pytest.param(range(3), id='few'),
         pytest.param(range(3, 25), id='more', marks=pytest.mark.evidence)]


def healthy_throughout(outcome):
    return outcome.published[10:].all() and set(outcome.states) == {'starting', 'healthy'}


# A healthy device -----------------------------------------------------------------------------

@pytest.mark.parametrize('seeds', SEEDS)
@pytest.mark.parametrize('encoder', ENCODERS)
@pytest.mark.parametrize('sensors', SENSORS)
def test_an_end_stop_is_healthy(sensors, encoder, seeds):
    for seed in seeds:
        outcome = run(disturbance('end stop', seed), sensors, encoder, seed)
        assert outcome is None or healthy_throughout(outcome), seed


@pytest.mark.parametrize('seeds', SEEDS)
@pytest.mark.parametrize('encoder', ENCODERS)
@pytest.mark.parametrize('sensors', SENSORS)
def test_a_vibration_is_healthy(sensors, encoder, seeds):
    for seed in seeds:
        outcome = run(disturbance('vibration', seed), sensors, encoder, seed)
        if outcome is not None and sensors == 4 and encoder == '17 bits':
            # A quiet sensor that the others cannot check may leave its motion first.
            assert outcome.published[10:].mean() > 0.99, seed
            assert set(outcome.states) == {'starting', 'healthy'}, seed
        else:
            assert outcome is None or healthy_throughout(outcome), seed


# Noise and spikes -----------------------------------------------------------------------------

@pytest.mark.parametrize('sensor', range(6), ids=ALL_JOINT_NAMES)
@pytest.mark.parametrize('slow', [0.001, 1.0], ids=['at once', 'within a second'])
@pytest.mark.parametrize('size', [0.5, 2.0])
def test_one_of_six_that_grows_noisy_is_excluded(sensor, slow, size):
    rng = np.random.default_rng(sensor)

    def change(angles):
        growth = np.clip((np.arange(len(angles)) * 1e-3 - 1.0) / slow, 0.0, 1.0)
        angles[:, sensor] += np.radians(size) * growth * rng.normal(size=len(angles))
        return angles
    outcome = run(motion('sweep', 3.0), 6, change=change)
    assert outcome.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'
    assert outcome.published[2200:].mean() > 0.99
    assert outcome.longest_undeclared(sensor) <= 0.02


@pytest.mark.parametrize('sensors', SENSORS)
def test_while_each_twelfth_sample_is_a_spike_the_state_is_not_healthy(sensors):
    def change(angles):
        angles[BEGIN::12, 1] += np.radians(5.0)
        return angles
    outcome = run(motion('turning', 3.0), sensors, change=change)
    assert outcome.states[-1].startswith('degraded: ')
    assert outcome.published[BEGIN:].mean() > 0.9
    assert np.nanmax(outcome.error / outcome.result.protection_level) < 1.0


@pytest.mark.parametrize('rate', [250.0, 500.0, 1000.0])
@pytest.mark.parametrize('kind', ['sweep', 'fast', 'turning'])
@pytest.mark.parametrize('sensor', range(6), ids=ALL_JOINT_NAMES)
def test_six_go_on_within_20_ms_without_one_that_is_stuck(sensor, kind, rate):
    rotations = motion(kind, 1.6 + 0.1 * sensor, rate)
    angles = encoders(joint_angles(rotations, 6), seed=sensor)
    begin = len(angles) // 2
    angles[begin:, sensor] = angles[begin, sensor]
    outcome = Outcome(rotations, angles, rate=rate)
    withheld = np.flatnonzero(np.diff(np.concatenate([[0], ~outcome.published[begin:], [0]])))
    assert max(withheld[1::2] - withheld[::2], default=0) / rate <= 0.02
    assert outcome.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'


# What is over is over -------------------------------------------------------------------------

@pytest.mark.parametrize('seeds', SEEDS)
@pytest.mark.parametrize('kind', ['rest', 'turning', 'sweep'])
@pytest.mark.parametrize('sensors', SENSORS)
def test_after_an_interference_orientations_come_again_by_themselves(sensors, kind, seeds):
    """On one sensor or two, for 1 to 5 ms, then up to 8 ms without a sample; and once more."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        wrong = rng.choice(sensors, size=rng.integers(1, 3), replace=False)
        size = np.radians(rng.choice([2.0, 10.0, 90.0]))
        keep = np.ones(4000, bool)
        first = BEGIN
        spans = []
        for _ in range(2):
            length, lost = int(rng.integers(1, 6)), int(rng.integers(0, 9))
            spans.append(slice(first, first + length))
            keep[first + length:first + length + lost] = False
            first += 300

        def change(angles, spans=spans, wrong=wrong, size=size, rng=rng):
            for span in spans:
                angles[span, wrong] += size * rng.uniform(
                    -1.0, 1.0, (span.stop - span.start, len(wrong)))
            return angles
        outcome = run(motion(kind, 4.0), sensors, seed=seed, change=change, keep=keep)
        assert outcome.published[-(4000 - first + 300 - 1500):].all(), seed


@pytest.mark.parametrize('glitches', [(3, 5), (5, 3), (3, 5, 4)])
def test_a_glitch_of_another_sensor_does_not_end_six_without_a_faulty_one(glitches):
    def change(angles):
        angles[BEGIN:, 0] += np.radians(3.0)
        for index, sensor in enumerate(glitches):
            first = BEGIN + 300 * (index + 1)
            angles[first:first + 3, sensor] += np.radians(4.0)
        return angles
    outcome = run(motion('sweep', 5.0), 6, change=change)
    # Within the recovery and half a second.
    assert outcome.published[BEGIN + 300 * len(glitches) + 1500:].all()
    assert outcome.states[-1] == 'degraded: joint_1a excluded'


@pytest.mark.parametrize('kind', ['rest', 'turning', 'sweep'])
def test_two_of_four_that_jump_and_cancel_wait_for_an_acknowledgement(kind):
    def change(angles):
        angles[BEGIN:, :2] += np.radians(2.0) * np.array([1.0, -0.935])
        return angles
    outcome = run(motion(kind, 4.0), 4, change=change)
    assert not outcome.published[BEGIN + 2:].any()
    assert outcome.states[-1] == 'silent: joint_1a and joint_1b jumped, to be acknowledged'


# Another orientation --------------------------------------------------------------------------

def other_offsets(pose):
    """Return offsets of th3A, rad, with which all four angles fit another orientation."""
    joints = inverse(pose)
    for rotation in forward_all(joints.theta1):
        other = inverse(rotation)
        same = np.remainder(other.theta1 - joints.theta1 + np.pi, 2.0 * np.pi) - np.pi
        offset = np.remainder(other.theta3a - joints.theta3a + np.pi, 2.0 * np.pi) - np.pi
        if np.abs(same).max() < 1e-6 and abs(offset) > np.radians(10.0):
            yield float(offset)


@pytest.mark.parametrize('seeds', [
    pytest.param(range(8), id='few'),
    pytest.param(range(8, 48), id='more', marks=pytest.mark.evidence)])
def test_another_orientation_that_fits_is_never_one_that_counts_as_checked(seeds):
    """At power on it is declared; a fault that was detected does not clear onto it."""
    tried = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        pose = random_pose(rng)
        turn = np.radians(6.0) * np.sin(np.linspace(0.0, 2.0 * np.pi, 1000))
        moved = np.concatenate([
            about(pose, rng.normal(size=3), turn), np.repeat(pose[None], 2500, 0)])
        for offset in other_offsets(pose):
            rest = run(np.repeat(pose[None], 1500, 0), 4, seed=seed,
                       change=lambda angles, offset=offset: angles + [0.0, 0.0, 0.0, offset])
            assert not (rest.result.unchecked == 0.0).any()

            def change(angles, offset=offset):
                angles[1200:, 3] += offset
                return angles
            later = run(moved, 4, seed=seed, change=change)
            if later is not None:
                tried += 1
                assert not (later.error > later.result.protection_level).any()
    assert tried > len(seeds) // 2


# The level ------------------------------------------------------------------------------------

def largest_error_over_level(sensors, bias_deg, sigma_deg, alert_deg, rng, poses):
    """Return the largest error over level of one faulty sensor and biases that oppose it."""
    geometry, used = Geometry(), UsedSensors((np.radians(sigma_deg),) * sensors)
    bias = (np.radians(bias_deg),) * sensors
    limits = limits_from(complete(FKM_SETTINGS, {'sensors': sensors}))
    threshold = limits.threshold(sensors - 3)
    worst = 0.0
    for _ in range(poses):
        pose = random_pose(rng)
        joints = inverse(pose)
        angles = [*joints.theta1, joints.theta3a, joints.theta3b, joints.theta3c][:sensors]
        if not np.isfinite(angles).all():
            continue
        found = estimate_sample(tuple(map(float, angles)), used, geometry)
        worth = integrity(found, bias, (1.0,) * sensors)
        parts = worth.levels((threshold + MISSED_DETECTION) / np.sqrt(20.0))
        gains, changes = np.array(found.gains), np.array(found.parity_gains)
        level = max([part for part in parts if part <= np.radians(alert_deg)] + [worth.healthy])
        limit = threshold / np.sqrt(20.0) + worth.bias
        for sensor, signs in product(range(sensors), product((-1.0, 1.0), repeat=sensors)):
            if parts[sensor] > np.radians(alert_deg):
                continue
            others = np.array(signs) * bias[0]
            others[sensor] = 0.0
            # Largest fault, of either sign, whose mean parity stays within the limit.
            a = changes[sensor] @ changes[sensor]
            b = changes[sensor] @ (others @ changes)
            c = (others @ changes) @ (others @ changes) - limit * limit
            if b * b < a * c:
                continue
            for root in ((-b + np.sqrt(b * b - a * c)) / a, (-b - np.sqrt(b * b - a * c)) / a):
                error = np.linalg.norm((others + root * np.eye(sensors)[sensor]) @ gains)
                worst = max(worst, error / level)
    return worst


@pytest.mark.parametrize(('bias', 'sigma'), [
    (0.05, 0.04), (0.1, 0.02), (0.1, 0.01), (0.05, 0.005)])
@pytest.mark.parametrize('alert', [0.5, 1.0])
@pytest.mark.parametrize('sensors', SENSORS)
def test_no_undetected_fault_is_beyond_the_level_whatever_the_signs_of_the_biases(
        sensors, alert, bias, sigma):
    """Every combination of signs, the largest fault that the window does not detect."""
    rng = np.random.default_rng(1)
    assert 0.1 < largest_error_over_level(sensors, bias, sigma, alert, rng, 25) <= 1.0


# A sensor that is not there -------------------------------------------------------------------

@pytest.mark.parametrize('sensors', [5, 6])
def test_a_missing_sensor_costs_no_orientation(sensors):
    for sensor in range(sensors):
        def change(angles, sensor=sensor):
            angles[1000:2000, sensor] = np.nan
            return angles
        outcome = run(motion('sweep', 3.0), sensors, change=change)
        assert outcome.published[10:].all()
        assert np.nanmax(outcome.error / outcome.result.protection_level) < 1.0
        name = ALL_JOINT_NAMES[sensor]
        assert outcome.states == ['starting', 'healthy', f'degraded: {name} missing', 'healthy']
        assert outcome.result.unchecked[1990, sensor] > 0.9


def test_any_two_of_six_may_be_missing():
    for first in range(6):
        for second in range(first):
            def change(angles, gone=(second, first)):
                angles[700:, list(gone)] = np.nan
                return angles
            outcome = run(motion('sweep', 1.5), 6, change=change)
            assert outcome.published[10:].mean() > 0.99
            names = f'{ALL_JOINT_NAMES[second]} missing, {ALL_JOINT_NAMES[first]} missing'
            assert outcome.states[-1] == f'degraded: {names}'
            assert np.nanmax(outcome.error / outcome.result.protection_level) < 1.0


@pytest.mark.parametrize('sensors', [5, 6])
def test_one_per_cent_of_lost_frames_costs_nothing_and_is_no_state(sensors):
    rng = np.random.default_rng(2)

    def change(angles):
        lost = rng.random(angles.shape) < 0.01
        lost[lost.sum(axis=1) > sensors - 4] = False
        angles[lost] = np.nan
        return angles
    outcome = run(motion('sweep', 3.0), sensors, change=change)
    assert outcome.published[10:].mean() > 0.998
    assert set(outcome.states) == {'starting', 'healthy'}


def test_four_with_one_missing_are_silent():
    def change(angles):
        angles[500:, 2] = np.nan
        return angles
    outcome = run(motion('turning', 1.0), 4, change=change)
    assert not outcome.published[500:].any()
    assert outcome.states[-1] == 'silent: joint_1c missing'


def test_a_sensor_that_comes_back_wrong_is_left_out():
    def change(angles):
        angles[1000:1500, 4] = np.nan
        angles[1500:, 4] += np.radians(4.0)
        return angles
    outcome = run(motion('sweep', 3.0), 6, change=change)
    assert outcome.published[10:].all()
    assert outcome.states[-1] == 'degraded: joint_3b missing'
    assert np.nanmax(outcome.error / outcome.result.protection_level) < 1.0
