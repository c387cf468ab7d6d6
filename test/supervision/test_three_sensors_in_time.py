# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Degraded operation, sample by sample: what continues it and what stops it."""

from math import radians

import pytest
from rig import DEVIATION, Rig, turned
from spm_haptic_master.exceptions import UnreachableError


def degraded_rig(**limits):
    """Return a rig that goes on without th1B."""
    rig = Rig(degraded=True, **limits)
    reasons = [rig.sample(th1b=0.1) for _ in range(3)]
    assert reasons == ['joint_1b jumped'] * 3
    assert rig.sample(th1b=0.1) == ''
    assert rig.state == 'degraded: joint_1b jumped'
    assert rig.solver.missing == ['joint_1b']
    return rig


def test_without_permission_a_fault_of_a_known_sensor_is_silence():
    rig = Rig()
    assert [rig.sample(th1b=0.1) for _ in range(9)] == ['joint_1b jumped'] * 9
    assert rig.solver.missing == []


def test_with_an_undetermined_sensor_there_is_no_degraded_operation():
    rig = Rig(degraded=True)
    rig.solver.four = rig.solver.four._replace(parity=20.0)
    assert {rig.sample() for _ in range(9)} == {'inconsistent angles, sensor undetermined'}
    assert rig.solver.missing == []


def test_degraded_orientations_are_priors_and_keep_their_sign():
    rig = degraded_rig()
    rig.solver.three = rig.solver.three._replace(quaternion=tuple(-x for x in turned(0.005)))
    assert rig.sample(th1b=0.1) == ''
    assert rig.estimate.quaternion == turned(0.005)
    rig.sample(th1b=0.1)
    assert rig.solver.without_priors[-1] == turned(0.005)


@pytest.mark.parametrize(('after', 'turn', 'published'), [
    # 20 rad/s of the human motion limit and six deviations of 1 mrad.
    (1, 0.0259, True), (1, 0.0261, False), (3, 0.0659, True), (3, 0.0661, False),
    (1, -0.0259, True), (1, -0.0261, False)])
def test_degraded_orientations_continue_the_motion(after, turn, published):
    rig = degraded_rig()
    rig.solver.three = rig.solver.three._replace(quaternion=turned(turn))
    reason = rig.sample(after=after, th1b=0.1)
    if published:
        assert reason == ''
        assert rig.state == 'degraded: joint_1b jumped'
    else:
        expected = 'joint_1b jumped, the others do not continue the motion'
        assert reason == expected
        limit = 0.006 + 0.02 * after
        assert rig.detail == f'{abs(turn):.3f} rad off the last one, limit {limit:.3f}'
        assert rig.state == f'silent: {expected}'


def test_the_reach_follows_the_joint_speed():
    rig = degraded_rig(joint_speed=10.0)
    rig.solver.three = rig.solver.three._replace(quaternion=turned(0.0161))
    assert rig.sample(th1b=0.1) != ''


def stopped(rig, reason, **sample):
    """Assert that a sample stops degraded operation, and that it stays stopped."""
    text = f'joint_1b jumped, {reason}'
    assert rig.sample(th1b=0.1, **sample) == text
    assert rig.state == f'silent: {text}'
    asked = len(rig.solver.missing)
    rig.solver.error_of_three = None
    rig.solver.three = rig.solver.three._replace(
        determined=True, quaternion=turned(0.0), covariance=(DEVIATION ** 2, *[0.0] * 8))
    assert [rig.sample(th1b=0.1) for _ in range(5)] == [text] * 5
    assert len(rig.solver.missing) == asked


def test_degraded_operation_stops_where_the_motion_was_lost():
    stopped(degraded_rig(), 'the motion was lost', after=101)
    rig = degraded_rig()
    assert rig.sample(after=100, th1b=0.1) == ''


def test_degraded_operation_stops_at_a_second_symptom():
    rig = degraded_rig()
    reason = 'joint_1b jumped, and joint_3a jumped'
    assert rig.sample(th1b=0.1, th3a=0.1) == reason
    assert rig.detail.startswith('joint_3a 106.')
    assert [rig.sample(th1b=0.1) for _ in range(5)] == [reason] * 5


def test_degraded_operation_goes_on_beside_symptoms_of_the_faulty_sensor_and_of_none():
    rig = degraded_rig()
    rig.solver.four = rig.solver.four._replace(parity=9.0)
    assert rig.sample(th1b=-0.1) == ''
    rig.solver.error = UnreachableError('leg B does not close')
    assert rig.sample(th1b=0.1) == ''


def test_degraded_operation_stops_without_an_orientation():
    rig = degraded_rig()
    rig.solver.error_of_three = UnreachableError('leg C does not close')
    stopped(rig, 'no orientation from the others')


@pytest.mark.parametrize('changed', [
    {'determined': False}, {'covariance': (radians(0.51) ** 2, *[0.0] * 8)}])
def test_degraded_operation_stops_where_three_sensors_determine_nothing(changed):
    rig = degraded_rig()
    rig.solver.three = rig.solver.three._replace(**changed)
    stopped(rig, 'the others do not determine it')


def test_three_sensors_may_have_the_deviation_that_four_may_have():
    assert degraded_rig(deviation=DEVIATION).state == 'degraded: joint_1b jumped'


def test_degraded_operation_ends_when_the_sensor_has_recovered():
    rig = degraded_rig(recovery=0.05)
    # The recovery time, after the window in which the others check it.
    reasons = [rig.sample() for _ in range(75)]
    assert set(reasons) == {''}
    assert rig.state == 'healthy'
    asked = len(rig.solver.missing)
    rig.sample()
    assert len(rig.solver.missing) == asked


def test_a_restart_ends_degraded_operation_and_keeps_the_fault():
    rig = degraded_rig()
    assert rig.sample(after=600, th1b=0.1) == 'joint_1b jumped'
    assert rig.state == 'silent: joint_1b jumped'
    assert [rig.sample(th1b=0.1) for _ in range(9)] == ['joint_1b jumped'] * 9


def test_a_sensor_that_fails_for_good_during_degraded_operation_is_named():
    rig = degraded_rig()
    for _ in range(3):
        reason = rig.sample(th1b=0.1, th1c=0.1)
    assert reason == (
        'joint_1b jumped, and joint_1c jumped and joint_1c jumped, to be acknowledged')
    assert rig.state == f'silent: {reason}'


@pytest.mark.parametrize('reason', ['protection level above the alert limit', 'angle not finite'])
def test_degraded_operation_ends_with_three_samples_in_a_row_that_are_withheld(reason):
    """The state is not `degraded` while nothing is published."""
    rig = degraded_rig()

    def sample():
        if reason == 'angle not finite':
            return rig.sample(th1b=float('nan'))
        rig.solver.three = rig.solver.three._replace(
            covariance=(radians(0.2) ** 2, *[0.0] * 8))
        return rig.sample(th1b=0.1)

    for _ in range(2):
        assert sample() == reason
        assert rig.state == 'degraded: joint_1b jumped'
    assert sample() == f'joint_1b jumped, {reason}'
    assert rig.state == f'silent: joint_1b jumped, {reason}'
    rig.solver.three = rig.solver.three._replace(covariance=(DEVIATION ** 2, *[0.0] * 8))
    assert [rig.sample(th1b=0.1) for _ in range(3)] == [f'joint_1b jumped, {reason}'] * 3


def test_the_level_of_three_sensors_is_that_of_their_noise():
    rig = degraded_rig()
    assert rig.sample(th1b=0.1) == ''
    assert rig.level == pytest.approx(5.3 * DEVIATION)
