# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""All joints beside each other: ranges, delays, which left their motion alone, noise."""

from math import degrees, hypot, inf, nan, pi, radians, sqrt

import numpy as np
import pytest
from rig import product_limits
from spm_haptic_master.supervision.joint_monitor import JointMonitor, ONE_PERIOD
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.symptom import Reason, Severity

DT = 1e-3
SIGMA = radians(0.04)
FINE = radians(0.005)  # a count
# Standard deviation of the innovation of a healthy joint, rad, before a finer count is seen.
HEALTHY = ONE_PERIOD * hypot(SIGMA, 2.0 * pi / 4096.0 / sqrt(12.0))
BIAS = radians(0.05)
ALL = (0, 1, 2, 3)
# Joints at rest, rad.
PLACE = (0.5, 0.4, 0.3, 0.2)


def monitors(**limits):
    """Return the monitors of four joints with the product's limits, some changed."""
    return JointMonitors((SIGMA,) * 4, product_limits(**limits))


def at(moved=(0.0,) * 4):
    """Return the place with each joint moved by deg."""
    return tuple(angle + radians(turn) for angle, turn in zip(PLACE, moved, strict=True))


def taken(joints, count=1, moved=(0.0,) * 4, left_out=(), jitter=0.0):
    """Let equal samples follow, the joints moved by deg; return what the last one shows."""
    for _ in range(count):
        shown = joints.follow(at(moved), DT, DT, jitter, left_out)
    return shown


def resting(count=20, **limits):
    """Return the monitors of joints that have been at rest for some samples."""
    joints = monitors(**limits)
    taken(joints, count)
    return joints


def moving(speed, count=50, **limits):
    """Return the monitors of joints of which the first two move at a speed, rad/s; its place."""
    joints = monitors(**limits)
    for index in range(count):
        moved = degrees(speed * DT * index)
        taken(joints, 1, (moved, -moved, 0.0, 0.0))
    return joints


# Symptoms of one joint ------------------------------------------------------------------------


@pytest.mark.parametrize('sensor', ALL)
@pytest.mark.parametrize(
    ('low', 'high', 'is_out'),
    [
        (-0.01, 0.01, False),
        # Its ends belong to it.
        (0.0, 0.01, False),
        (-0.01, 0.0, False),
        (0.001, 0.01, True),
        (-0.01, -0.001, True),
    ],
)
def test_a_reading_outside_its_joints_range_is_a_symptom_that_may_pass(sensor, low, high, is_out):
    lowest = [-inf] * 4
    highest = [inf] * 4
    lowest[sensor] = PLACE[sensor] + low
    highest[sensor] = PLACE[sensor] + high
    joints = monitors(joint_min=tuple(lowest), joint_max=tuple(highest))
    is_away, symptoms = taken(joints)
    assert not is_away
    assert [each.sensor for each in symptoms] == [sensor] * is_out
    assert taken(joints, left_out=(sensor,)) == (False, [])
    for symptom in symptoms:
        assert symptom.reason is Reason.OUT_OF_RANGE
        assert symptom.severity is Severity.PENDING
        assert f'{PLACE[sensor]:.4f} rad' in symptom.detail


def noisy(*factors, count=1200, **limits):
    """Return the monitors of joints with so many times the noise, and their last angles, rad."""
    joints = monitors(**limits)
    sizes = SIGMA * np.array(factors)
    noise = np.random.default_rng(1).normal(size=(count, 4))
    readings = PLACE + np.round(noise * sizes / FINE) * FINE
    for angles in readings.tolist():
        joints.follow(tuple(angles), DT, DT, 0.0, ())
    return joints, tuple(angles)


@pytest.mark.parametrize(
    ('limit', 'repeats', 'is_frozen'),
    [
        (20, 19, False),
        (20, 20, True),
        (5, 4, False),
        (5, 5, True),
        # 0: never.
        (0, 100, False),
    ],
)
def test_a_noisy_joint_that_repeats_its_reading_is_frozen(limit, repeats, is_frozen):
    joints, last = noisy(1.0, 1.0, 1.0, 1.0, frozen_samples=limit)
    changed = tuple(angle + 2.0 * FINE for angle in last)
    for _ in range(1 + repeats):
        _, symptoms = joints.follow(changed, DT, DT, 0.0, ())
    assert [each.sensor for each in symptoms] == list(ALL) * is_frozen
    for symptom in symptoms:
        assert symptom.reason is Reason.FROZEN
        assert symptom.severity is Severity.LATCH
        assert symptom.detail.endswith(f' {limit + 1} equal readings')
    _, of_the_others = joints.follow(changed, DT, DT, 0.0, (1, 2))
    assert [each.sensor for each in of_the_others] == [0, 3] * (limit > 0)


def test_a_joint_without_a_reading_begins_its_motion_again():
    joints = resting()
    for _ in range(2):
        joints.follow((nan, *PLACE[1:]), DT, DT, 0.0, ())
    is_away, _ = taken(joints, 1, (60.0, 0.0, 0.0, 0.0))
    assert not is_away
    assert taken(resting(), 1, (60.0, 0.0, 0.0, 0.0))[0]


# Who left its motion --------------------------------------------------------------------------


def test_a_sensor_that_left_its_motion_is_away_unless_it_is_not_in_use():
    joints = resting()
    is_away, symptoms = taken(joints, 1, (0.0, 5.0, 0.0, 0.0))
    assert is_away
    assert symptoms == []
    assert joints.left(ALL) == [1]
    assert joints.left((0, 2, 3)) == []
    assert joints.distance(1) == pytest.approx(radians(5.0))
    is_away, _ = taken(joints, 1, (0.0, 5.0, 0.0, 0.0), left_out=(1,))
    assert not is_away


@pytest.mark.parametrize(('deviations', 'quiet'), [(4.9, True), (5.1, False)])
def test_a_sensor_leaves_alone_while_all_others_are_quiet(deviations, quiet):
    """Within five deviations of their motion."""
    joints = resting()
    off = degrees(deviations * HEALTHY)
    taken(joints, 1, (off, 5.0, 0.0, 0.0))
    assert joints.left(ALL) == [1]
    assert joints.alone(ALL) == [1] * quiet
    # Of a single one nothing is known.
    assert joints.alone((1,)) == []
    assert joints.alone((1, 2)) == [1]


def test_how_long_the_others_have_been_quiet_is_counted():
    joints = resting()
    off = degrees(5.1 * HEALTHY)
    taken(joints, 7, (off, 0.0, 0.0, 0.0))
    taken(joints, 1, (off, 5.0, 0.0, 0.0))
    assert joints.alone(ALL, 7) == [1]
    assert joints.alone(ALL, 8) == []
    assert joints.alone((1, 2, 3), 28) == [1]
    assert joints.alone((1, 2, 3), 29) == []
    assert joints.samples == 28


@pytest.mark.parametrize(
    ('used', 'moved', 'unseen', 'is_gap', 'found'),
    [
        # One that the parity does not see, suspected or certain.
        (ALL, (0.0, 1.0, 0.0, 0.0), (1,), False, [1]),
        (ALL, (0.0, 5.0, 0.0, 0.0), (1,), False, [1]),
        (ALL, (0.0, 1.0, 0.0, 0.0), (1,), True, [1]),
        # One that it sees.
        (ALL, (0.0, 5.0, 0.0, 0.0), (0, 2, 3), False, []),
        (ALL, (0.0, 5.0, 0.0, 0.0), (), True, []),
        # Two of four, which may cancel, by certain steps; after a gap any.
        (ALL, (5.0, 5.0, 0.0, 0.0), (), False, [0, 1]),
        (ALL, (1.0, 5.0, 0.0, 0.0), (), False, []),
        (ALL, (1.0, 5.0, 0.0, 0.0), (), True, [0, 1]),
        # Two of three cannot: there is no parity.
        ((0, 1, 2), (5.0, 5.0, 0.0, 0.0), (), False, []),
        (ALL, (0.0, 0.0, 0.0, 0.0), ALL, False, []),
    ],
)
def test_jumps_are_those_that_no_parity_shows(used, moved, unseen, is_gap, found):
    joints = resting()
    taken(joints, 1, moved)
    symptoms = joints.jumps(used, unseen, is_gap)
    assert [each.sensor for each in symptoms] == found
    for symptom in symptoms:
        assert symptom.reason is Reason.JUMPED
        assert symptom.severity is (Severity.LATCH if is_gap else Severity.PENDING)
        off = radians(moved[symptom.sensor]) / HEALTHY
        assert symptom.detail == f'{off:.1f} sigma off its motion'


@pytest.mark.parametrize(('quiet', 'found'), [(9, []), (10, [1])])
def test_a_jump_is_one_if_the_others_have_been_quiet_for_ten_samples(quiet, found):
    joints = resting()
    off = degrees(5.1 * HEALTHY)
    taken(joints, quiet, (off, 0.0, 0.0, 0.0))
    taken(joints, 1, (off, 5.0, 0.0, 0.0))
    assert [each.sensor for each in joints.jumps(ALL, (1,), is_gap=False)] == found


def test_a_sensor_that_jumped_back_has_returned_from_that_departure():
    joints = resting()
    assert not joints.has_returned(1)
    assert not joints.has_returned(None)
    taken(joints, 2, (0.0, 5.0, 0.0, 0.0))
    assert joints.departure(1) == 1
    assert not joints.has_returned(1)
    taken(joints)
    assert joints.has_returned(1)
    assert joints.has_returned(1, 1)
    assert not joints.has_returned(0)
    assert not joints.has_returned(None, 1)


def test_a_sensor_that_left_again_has_returned_from_the_departure_before():
    joints = resting()
    taken(joints, 2, (0.0, 5.0, 0.0, 0.0))
    taken(joints)
    taken(joints, 1, (0.0, 5.0, 0.0, 0.0))
    assert joints.departure(1) == 2
    assert not joints.has_returned(1)
    assert joints.has_returned(1, 1)


def test_a_restart_forgets_every_motion():
    joints = resting()
    taken(joints, 1, (0.0, 5.0, 0.0, 0.0))
    joints.restart()
    assert joints.left(ALL) == []
    assert taken(joints, 1, (60.0, -60.0, 50.0, 40.0)) == (False, [])


# Delays and noise -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('skew', 'jitter', 'timing'),
    [
        (0.0, 0.0, 0.0),
        (0.0, 1e-3, 4e-3),
        (2e-3, 0.0, 2e-3),
        (2e-3, 1e-3, 6e-3),
    ],
)
def test_a_moving_joint_may_be_off_by_skew_and_four_deviations_of_the_jitter(skew, jitter, timing):
    limits = product_limits()
    joint = JointMonitor(SIGMA, limits.threshold(), limits.joint_acceleration, limits.joint_speed)
    limit = joint.limit(DT, DT) + 3.0 * timing
    for off, leaves in ((0.999 * limit, False), (1.001 * limit, True)):
        joints = moving(3.0, skew=skew)
        expected = degrees(3.0 * DT * 50)
        reading = expected + degrees(off), -expected, 0.0, 0.0
        assert taken(joints, 1, reading, jitter=jitter)[0] == leaves


@pytest.mark.parametrize('skew', [0.0, 2e-3])
def test_the_bias_allows_for_what_a_joint_moves_in_the_skew(skew):
    assert monitors(skew=skew).bias == (BIAS,) * 4
    assert monitors(skew=skew).parity_bias == product_limits().parity_bias
    joints = moving(2.0, skew=skew)
    moved = 2.0 * skew
    assert joints.bias == pytest.approx((BIAS + moved, BIAS + moved, BIAS, BIAS))
    parity_bias = product_limits().parity_bias
    assert joints.parity_bias == pytest.approx(parity_bias + hypot(moved, moved))
    # And no longer once it rests.
    taken(joints, 100, (degrees(2.0 * DT * 49), -degrees(2.0 * DT * 49), 0.0, 0.0))
    assert joints.bias == pytest.approx((BIAS,) * 4, abs=1e-6)
    assert joints.parity_bias == pytest.approx(parity_bias, abs=1e-6)


def test_the_bias_allows_for_what_a_joint_moves_while_its_reading_is_late():
    """A slow encoder has a new reading in every other sample."""
    joints = monitors()
    for index in range(101):
        late = index % 2
        moved = degrees(3.0 * DT * (index - late))
        taken(joints, 1, (0.0, 0.0, moved, 0.0))
        if index > 60:
            expected = BIAS + 3.0 * DT * late
            assert joints.bias == pytest.approx((BIAS, BIAS, expected, BIAS), rel=1e-3)


def test_the_limits_widen_for_noise_to_what_the_parity_allows():
    joints, last = noisy(2.0, 1.0, 2.0, 2.0)
    measured = np.array(joints.noise()) / SIGMA
    assert measured == pytest.approx([2.0, 1.0, 2.0, 2.0], rel=0.2)
    assert joints.factors == (1.0,) * 4
    joints.follow_noise([3.0, 3.0, 1.3, inf])
    assert joints.factors == pytest.approx((measured[0], 1.0, 1.3, measured[3]))
    # A step within the wider limits of its joint.
    off = 1.6 * 6.9 * ONE_PERIOD * SIGMA
    for sensor, leaves in enumerate((False, True, True, False)):
        moved = [0.0] * 4
        moved[sensor] = off
        joints.restart()
        for _ in range(10):
            joints.follow(last, DT, DT, 0.0, ())
        joints.follow(tuple(np.add(last, moved).tolist()), DT, DT, 0.0, ())
        assert joints.left(ALL) == [sensor] * leaves


@pytest.mark.parametrize(
    ('noise', 'bound', 'vibrates'),
    [
        (2.0, 1.2, True),
        (2.0, 1.3, False),
        (1.0, 1.2, False),
    ],
)
def test_a_joint_that_seems_noisier_than_the_parity_allows_vibrates(noise, bound, vibrates):
    """Then one that the parity does not see vibrates too, and no jump is a single one's."""
    joints, last = noisy(noise, 1.0, 1.0, 2.0)
    joints.follow_noise([bound, 3.0, 3.0, inf])
    hidden = 1.0 if vibrates else joints.noise()[3] / SIGMA
    assert joints.factors == pytest.approx((1.3 if bound * noise > 2.5 else 1.0, 1.0, 1.0, hidden))
    for _ in range(20):
        joints.follow(last, DT, DT, 0.0, ())
    off = last[0], last[1] + radians(5.0), last[2], last[3]
    joints.follow(off, DT, DT, 0.0, ())
    assert joints.alone(ALL) == [1]
    assert joints.alone(ALL, 2) == [1] * (not vibrates)


@pytest.mark.parametrize(('factor', 'widens'), [(1.24, False), (1.26, True)])
def test_the_limits_widen_from_a_quarter_more_noise_on(factor, widens):
    joints, _ = noisy(2.0, 2.0, 2.0, 2.0)
    joints.follow_noise([factor] * 4)
    assert joints.factors == (factor if widens else 1.0,) * 4


def test_half_as_much_noise_again_is_a_caution():
    joints = monitors()
    assert joints.cautions() == {}
    joints.factors = (1.0, 1.49, 1.51, 2.0)
    assert joints.cautions() == {
        'noise joint_1c': 'noise of joint_1c 0.06 deg, configured 0.04',
        'noise joint_3a': 'noise of joint_3a 0.08 deg, configured 0.04',
    }
