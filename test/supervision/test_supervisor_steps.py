# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The whole decision, sample by sample: gaps, pauses, starts, and what is asked beside it."""

from math import degrees, inf, nan

from device import joint_angles, SINGULAR
import numpy as np
import pytest
from rig import Rig
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.supervision.symptom import Reason


def at_singularity(**settings):
    """Return a rig whose th3A no other sensor can check."""
    return Rig(pose=(0.0, 0.0, SINGULAR), alert_limit_deg=2.0, **settings)


def turn_to(rig, tilt, azimuth, phi):
    """Turn a rig to another pose, deg."""
    rotation = workspace_pose(*np.radians([tilt, azimuth, phi]))
    rig.place = joint_angles(rotation[None], rig.sensors)[0]


@pytest.mark.parametrize(('gap', 'is_fault'), [(1, False), (5, False), (6, True), (600, True)])
def test_a_jump_is_a_fault_at_once_if_more_than_five_periods_are_missing_behind_it(gap, is_fault):
    rig = at_singularity()
    assert rig.samples(1, th3a=1.5) == ['joint_3a jumped']
    assert rig.state == 'healthy'
    rig.sample(after=gap, th3a=1.5)
    assert rig.state == ('silent: joint_3a jumped' if is_fault else 'healthy')


@pytest.mark.parametrize(('gap', 'is_fault'), [(1, False), (6, False), (600, True)])
def test_a_jump_that_is_back_behind_a_gap_is_none_but_behind_a_pause_it_may_be(gap, is_fault):
    rig = at_singularity()
    rig.sample(th3a=1.5)
    rig.sample(after=gap)
    assert rig.state == ('silent: joint_3a jumped' if is_fault else 'healthy')
    assert (rig.verdict.estimate is None) == is_fault


def test_before_the_first_orientation_no_jump_is_one():
    rig = Rig(pose=(0.0, 0.0, SINGULAR), alert_limit_deg=2.0, healthy=False)
    rig.samples(3)
    assert rig.samples(2, th3a=1.5) == ['starting', None]


def test_behind_a_pause_the_platform_may_be_anywhere():
    """And as at the start five consistent samples precede the first orientation."""
    rig = Rig()
    turn_to(rig, 15.0, 200.0, 60.0)
    rig.sample(after=600)
    assert rig.verdict.cause.reason is Reason.STARTING
    assert rig.samples(4) == ['starting'] * 3 + [None]
    # No sensor is bounded until its rivals are known.
    assert inf in rig.supervisor.parts


def test_behind_a_pause_each_sensor_has_to_be_checked_again_where_a_start_needs_that():
    rig = Rig(start_checked=True, alert_limit_deg=2.0)
    assert rig.samples(3) == [None] * 3
    rig.sample(after=600)
    causes = rig.samples(40)
    assert causes[:3] == ['starting'] * 3
    assert causes[3] == 'joint_1a not checked yet'
    # The platform rests: rivals are left.
    assert causes[-1] == 'joint_1c not checked yet'


def test_angles_that_fit_no_orientation_are_a_fault_behind_one_that_was_determined():
    rig = Rig()
    assert rig.samples(3, th1a=90.0) == ['no orientation fits'] * 3
    assert rig.state == 'silent: joint_1a jumped'


def test_angles_that_fit_no_orientation_are_none_behind_one_that_was_not_sure():
    """For a tenth of a second."""
    rig = Rig(deviation_limit_deg=0.01, healthy=False)
    rig.samples(10)
    assert rig.samples(100, th1a=90.0) == ['orientation not determined'] * 100
    assert rig.supervisor.latch.fault is None
    assert rig.samples(1, th1a=90.0) == ['no orientation fits']


@pytest.mark.parametrize(('factor', 'is_published'), [(0.97, False), (1.03, True)])
def test_no_orientation_is_published_beyond_its_largest_deviation(factor, is_published):
    deviation = degrees(Rig().verdict.estimate.total_deviation)
    rig = Rig(healthy=False, deviation_limit_deg=factor * deviation)
    rig.samples(10)
    assert (rig.verdict.estimate is not None) == is_published
    if not is_published:
        assert rig.verdict.cause.reason is Reason.UNDETERMINED


def test_behind_a_pause_another_rate_is_known_at_once():
    rig = Rig()
    rig.sample(after=600)
    causes = []
    for _ in range(10):
        rig.sample(after=10)
        causes.append(rig.verdict.cause)
    assert causes[4:] == [None] * 6
    # One missing sample is no gap then, in which a jump would be a fault.
    assert rig.sample(after=20, th1b=5.0).estimate is None
    assert rig.supervisor.latch.fault is None


def interrupted(samples, every, **settings):
    """Return the states of a start at 100 Hz in which every so many-th sample is bad."""
    rig = Rig(healthy=False, **settings)
    states = []
    for number in range(1, samples + 1):
        rig.sample(after=10, th1b=0.0 if number % every else 11.5)
        states.append(rig.state)
    return states


@pytest.mark.parametrize(('due', 'every', 'seconds'), [(5, 4, 1.05), (5, 5, 1.05), (20, 4, 1.2)])
def test_what_interrupts_a_start_is_said_after_a_second_and_the_samples_of_a_start(
    due, every, seconds
):
    states = interrupted(140, every, start_samples=due)
    longest = round(seconds * 100.0)
    assert set(states[:longest]) == {'starting'}
    assert set(states[longest + 1 :]) == {'silent: inconsistent angles'}


def test_a_start_with_enough_consistent_samples_between_is_not_interrupted():
    assert interrupted(5, 6) == ['starting'] * 4 + ['healthy']


def evaluations(rig):
    """Return the numbers of the samples at which the noise is evaluated, as they come."""
    found = []
    follow_noise = rig.supervisor.joints.follow_noise

    def note(bounds):
        found.append(rig.supervisor.joints.samples)
        follow_noise(bounds)

    rig.supervisor.joints.follow_noise = note
    return found


def test_the_noise_is_evaluated_every_sixteenth_sample_behind_an_orientation():
    rig = Rig()
    found = evaluations(rig)
    rig.samples(80)
    assert np.diff(found).tolist() == [16] * 4
    assert len(found) == 5


def test_the_first_evaluation_of_the_noise_is_that_of_the_sixteenth_sample():
    rig = Rig(healthy=False)
    found = evaluations(rig)
    rig.samples(40)
    assert found == [16, 32]


def test_only_the_orientation_of_the_latest_sample_is_accepted():
    rig = Rig()
    quaternion, angles = rig.supervisor.accepted()
    assert quaternion == rig.verdict.estimate.quaternion
    assert np.degrees(angles) == pytest.approx(np.degrees(rig.place), abs=0.3)
    rig.samples(1, th1a=nan)
    assert rig.supervisor.accepted() is None
    rig.samples(1)
    assert rig.supervisor.accepted()
    six = Rig(6)
    # Neither where a sensor is left out for a moment, nor in a degraded state.
    six.samples(1, th3b=nan)
    assert six.verdict.estimate is not None
    assert six.supervisor.accepted() is None
    six.samples(30, th3b=nan)
    assert six.state == 'degraded: joint_3b missing'
    assert six.supervisor.accepted() is None


def test_cautions_are_those_of_the_joints_and_of_the_checks():
    rig = at_singularity()
    rig.samples(1200)
    rig.supervisor.joints.factors = (2.0, 1.0, 1.0, 1.0)
    assert set(rig.supervisor.cautions()) == {'noise joint_1a', 'unchecked joint_3a'}


@pytest.mark.parametrize(('factor', 'is_published'), [(0.99, False), (1.01, True)])
def test_no_orientation_is_published_beyond_the_alert_limit(factor, is_published):
    rig = Rig()
    # With no sensor checked the level is what noise and bias do.
    rig.supervisor.alert_limit = 1e-9
    rig.sample()
    detail = rig.verdict.cause.detail
    assert rig.verdict.cause.reason is Reason.UNPROTECTED
    assert rig.verdict.protection_level == inf
    healthy = float(detail.split(' ')[0])
    rig.supervisor.alert_limit = factor * np.radians(healthy)
    rig.samples(3)
    if is_published:
        level = degrees(rig.verdict.protection_level)
        assert level == pytest.approx(healthy, rel=0.03)
    assert (rig.verdict.estimate is not None) == is_published
