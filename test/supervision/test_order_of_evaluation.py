# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the supervisor asks of its solver and makes of the answer, sample by sample."""

from math import pi

from product_limits import product_limits
import pytest
from rig import DEVIATION, MS, PLACE, Rig, SIGMA, TURN, turned
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.supervision.joint_monitor import JointMonitor
from spm_haptic_master.supervision.sample_clock import SampleClock


def test_the_first_sample_may_be_published_and_has_no_prior():
    rig = Rig(healthy=False, start_samples=1)
    assert (rig.state, rig.supervisor.parity) == ('starting', None)
    assert rig.sample() == ''
    assert rig.state == 'healthy'
    assert rig.solver.priors == [None]


def test_the_prior_is_the_last_published_orientation_for_a_tenth_of_a_second():
    rig = Rig()
    rig.solver.four = rig.solver.four._replace(quaternion=turned(TURN))
    rig.sample()
    rig.sample()
    assert rig.solver.priors[-1] == turned(TURN)
    rig.sample(after=100)
    assert rig.solver.priors[-1] == turned(TURN)
    rig.sample(after=101)
    assert rig.solver.priors[-1] is None


def test_a_withheld_orientation_is_no_prior():
    rig = Rig()
    rig.solver.four = rig.solver.four._replace(quaternion=turned(TURN))
    assert rig.sample(th1a=0.1) == 'joint_1a jumped'
    rig.sample()
    assert rig.solver.priors[-1] == turned(0.0)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_the_first_quaternion_has_w_positive(sign):
    rig = Rig(healthy=False, start_samples=1)
    rig.solver.four = rig.solver.four._replace(
        quaternion=tuple(sign * each for each in (0.1, 0.2, 0.3, 0.9)))
    rig.sample()
    assert rig.estimate.quaternion == (0.1, 0.2, 0.3, 0.9)


def test_the_quaternion_continues_the_last_one():
    # A device without a limit of its speed.
    rig = Rig(healthy=False, start_samples=1, joint_speed=1e9)
    path = [(0.5, 0.5, 0.5, 0.5), (0.6, 0.5, 0.5, 0.2), (0.6, 0.5, 0.5, -0.2),
            (0.6, -0.5, 0.5, -0.2), (-0.6, -0.5, 0.5, -0.2), (-0.6, -0.5, -0.5, -0.2),
            (-0.9, 0.3, -0.3, -0.1), (-0.9, 0.3, -0.3, -0.1)]
    for quaternion in path:
        rig.solver.four = rig.solver.four._replace(quaternion=tuple(-x for x in quaternion))
        rig.sample()
        assert rig.estimate.quaternion == quaternion
    # Also after a restart: the sign never jumps.
    rig.sample(after=1000)
    assert rig.estimate.quaternion == path[-1]


def test_a_quaternion_perpendicular_to_the_last_is_left_as_it_is():
    rig = Rig(healthy=False, start_samples=1, joint_speed=1e9)
    for quaternion in ((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)):
        rig.solver.four = rig.solver.four._replace(quaternion=quaternion)
        rig.sample()
        assert rig.estimate is rig.solver.four


def test_the_parity_is_that_of_the_latest_sample():
    rig = Rig()
    rig.solver.four = rig.solver.four._replace(parity=1.25)
    rig.sample()
    assert rig.supervisor.parity == 1.25
    rig.solver.error = UnreachableError('no')
    rig.sample()
    assert rig.supervisor.parity == 1.25


def test_inconsistent_angles_are_withheld_and_a_fault_after_three():
    rig = Rig()
    rig.solver.four = rig.solver.four._replace(parity=20.0)
    for _ in range(2):
        assert rig.sample() == 'inconsistent angles, sensor undetermined'
    assert rig.state == 'healthy'
    rig.sample()
    assert rig.state == 'silent: inconsistent angles, sensor undetermined'


def test_angles_without_an_orientation_are_a_fault_after_three():
    rig = Rig()
    rig.solver.error = UnreachableError('leg A does not close')
    for _ in range(3):
        assert rig.sample() == 'no orientation fits'
        assert rig.detail == 'leg A does not close'
    assert rig.state == 'silent: no orientation fits'
    rig.solver.error = None
    assert rig.sample() == 'no orientation fits'


# Samples without a faulty sensor ----------------------------------------------------------------

@pytest.mark.parametrize('value', [float('nan'), float('inf')])
def test_an_angle_that_is_not_finite_is_not_evaluated(value):
    rig = Rig()
    asked = len(rig.solver.priors)
    assert rig.sample(th3a=value) == 'angle not finite'
    assert len(rig.solver.priors) == asked
    assert rig.sample() == ''


def test_three_such_samples_in_a_row_are_silence_until_consistency_is_shown_again():
    rig = Rig()
    for expected in ('healthy', 'healthy', 'silent: angle not finite', 'silent: angle not finite'):
        rig.sample(th1a=float('nan'))
        assert rig.state == expected
    assert [rig.sample() for _ in range(5)] == ['settling'] * 4 + ['']
    assert rig.state == 'healthy'
    # Counted from zero: two more are no silence.
    rig.sample(th1a=float('nan'))
    rig.sample(th1a=float('nan'))
    assert rig.sample() == ''


def test_two_of_them_between_published_samples_are_no_more_than_that():
    rig = Rig()
    for _ in range(5):
        rig.sample(th1a=float('nan'))
        rig.sample(th1a=float('nan'))
        assert rig.sample() == ''
        assert rig.state == 'healthy'


def test_an_orientation_is_published_up_to_the_limit_of_its_deviation():
    rig = Rig(deviation=DEVIATION)
    rig = Rig(deviation=0.99 * DEVIATION, healthy=False, start_samples=1)
    assert rig.sample() == 'orientation not determined'
    assert rig.detail == 'standard deviation 0.0010 rad, limit 0.00099'
    assert rig.state == 'starting'


def test_an_orientation_that_is_not_valid_is_withheld_and_silence_if_that_lasts():
    rig = Rig()
    rig.solver.four = rig.solver.four._replace(determined=False)
    for expected in ('healthy', 'healthy', 'silent: orientation not determined'):
        assert rig.sample() == 'orientation not determined'
        assert rig.state == expected
    rig.solver.four = rig.solver.four._replace(determined=True)
    assert [rig.sample() for _ in range(5)] == ['settling'] * 4 + ['']
    assert rig.state == 'healthy'


def test_a_latched_fault_is_not_hidden_by_such_samples():
    rig = Rig()
    for _ in range(3):
        rig.sample(th1b=0.1)
    for _ in range(5):
        rig.sample(th1a=float('nan'))
    assert rig.state == 'silent: joint_1b jumped'


# Stamps -----------------------------------------------------------------------------------------

@pytest.mark.parametrize('back', [0, 1, 10_000])
def test_an_older_sample_is_withheld(back):
    rig = Rig()
    assert rig.sample(stamp=rig.now - back * MS) == 'sample not newer than the last'
    assert rig.detail == f'{back * 1e-3:.6f} s older'
    assert rig.sample() == ''


def test_a_hundred_older_samples_are_a_clock_that_was_set_back():
    rig = Rig(start_samples=2)
    rig.now -= 10_000 * MS
    assert {rig.sample() for _ in range(100)} == {'sample not newer than the last'}
    assert rig.state == 'starting'
    assert [rig.sample() for _ in range(3)] == ['starting', '', '']
    # The orientation before is no prior: its age is not known.
    assert rig.solver.priors[-3:-1] == [None, None]
    assert rig.state == 'healthy'


def test_older_samples_not_in_a_row_are_no_clock_set_back():
    rig = Rig()
    for _ in range(5):
        for _ in range(99):
            rig.sample(stamp=rig.now - MS)
        assert rig.state == 'healthy'
        assert rig.sample() == ''


def test_older_samples_are_counted_from_zero_after_the_clock_was_followed():
    rig = Rig()
    rig.now -= 10_000 * MS
    for _ in range(110):
        rig.sample()
    assert rig.state == 'healthy'
    for _ in range(99):
        rig.sample(stamp=rig.now - 20_000 * MS)
    assert rig.state == 'healthy'


def test_a_gap_of_more_than_half_a_second_restarts():
    rig = Rig()
    assert rig.sample(after=500) == ''
    assert rig.sample(after=501) == 'starting'
    assert rig.state == 'starting'
    assert [rig.sample() for _ in range(4)] == ['starting'] * 3 + ['']


@pytest.mark.parametrize(('speed', 'reason'), [(0.9, ''), (1.1, 'joint_1a too fast')])
def test_stamps_are_in_nanoseconds(speed, reason):
    rig = Rig(joint_speed=1.0)
    reasons = [rig.sample(th1a=speed * 1e-3 * index) for index in range(1, 100)]
    assert reasons[-1] == reason


def test_the_limits_of_gaps_are_exact():
    """A gap of half a second is none; an orientation of a tenth of a second ago is recent."""
    rig = Rig()
    assert rig.sample(stamp=rig.now + 100 * MS) == ''
    assert rig.sample(stamp=rig.now + 200 * MS + 1) == ''
    assert [prior is None for prior in rig.solver.priors[-2:]] == [False, True]
    assert rig.sample(stamp=rig.now + 700 * MS + 1) == ''
    assert rig.sample(stamp=rig.now + 1200 * MS + 2) == 'starting'


def test_after_a_restart_every_joint_may_be_anywhere():
    rig = Rig(start_samples=2)
    assert rig.sample(after=600, th1a=0.5, th1b=-0.5, th1c=0.3, th3a=0.4) == 'starting'
    assert rig.sample(th1a=0.5, th1b=-0.5, th1c=0.3, th3a=0.4) == ''


def test_a_restart_empties_the_window_of_the_parity():
    rig = Rig(start_samples=1)
    rig.solver.four = rig.solver.four._replace(parity=2.0)
    for _ in range(8):
        assert rig.sample() == ''
    assert rig.sample(after=600) == ''
    assert [rig.sample() for _ in range(8)] == [''] * 8


def test_a_joint_that_jumped_right_before_a_gap_is_a_fault_unless_it_returned():
    for returned in (True, False):
        rig = Rig()
        assert rig.sample(th1c=0.1) == 'joint_1c jumped'
        reason = rig.sample(after=10, th1c=0.0 if returned else 0.1)
        assert reason == ('settling' if returned else 'joint_1c jumped')
        assert rig.state == ('healthy' if returned else 'silent: joint_1c jumped')


@pytest.mark.parametrize('after', [1, 3, 6, 30])
def test_a_gap_lets_joints_move_on_as_far_as_a_human_can(after):
    for factor, reason in ((0.99, ''), (1.01, 'joint_3a jumped')):
        rig = Rig()
        joint = JointMonitor(SIGMA[3], product_limits().threshold, 500.0)
        # The period has grown by the gap.
        period = 1e-3 * (1.0 + (min(after, 20.0) - 1.0) / 50.0)
        limit = joint.limit(after * 1e-3, period)
        assert rig.sample(after=after, th3a=factor * limit) == reason


# Each joint's range and speed -------------------------------------------------------------------

@pytest.mark.parametrize('sensor', range(4))
def test_a_reading_out_of_its_joints_range_is_withheld_and_a_fault_after_three(sensor):
    name = ('th1a', 'th1b', 'th1c', 'th3a')[sensor]
    low, high = [-3.0] * 4, [3.0] * 4
    low[sensor], high[sensor] = 0.499, 0.501
    for value in (-0.001, 0.001 - 1e-6):
        rig = Rig(joint_min=tuple(low), joint_max=tuple(high))
        rig.changes = 1
        assert rig.sample(**{name: value}) == ''
    for value in (-0.00101, 0.00101):
        rig = Rig(joint_min=tuple(low), joint_max=tuple(high))
        for _ in range(3):
            assert rig.state == 'healthy'
            assert rig.sample(**{name: value}) == f'{JOINT_NAMES[sensor]} out of range'
            assert rig.detail == f'{JOINT_NAMES[sensor]} {0.5 + value:.4f} rad'
        assert rig.state == f'silent: {JOINT_NAMES[sensor]} out of range'


@pytest.mark.parametrize('speed', [2.0, -2.0])
def test_a_joint_faster_than_a_human_is_withheld(speed):
    for limit, expected in ((2.1, ['', '', '']), (1.9, ['joint_1b too fast'] * 3)):
        rig = Rig(healthy=False, joint_speed=limit)
        reasons = [rig.sample(th1b=speed * 1e-3 * index) for index in range(12)]
        assert reasons[-3:] == expected
    assert rig.detail == f'joint_1b {speed:.1f} rad/s'


@pytest.mark.parametrize(('jitter', 'skew'), [(0, 0.0), (100_000, 0.0), (0, 0.002)])
def test_the_limit_of_a_jump_allows_for_the_time_of_a_sample(jitter, skew):
    """For four mean deviations of the stamps, and the declared skew, at the joint's speed."""
    speed = 3.0
    for factor, reason in ((0.999, ''), (1.001, 'joint_1b jumped')):
        rig = Rig(healthy=False, skew=skew, alert_limit=10.0)
        joint = JointMonitor(SIGMA[1], product_limits().threshold, 500.0)
        clock = SampleClock()

        def take(index, off, rig=rig, joint=joint, clock=clock):
            stamp = index * MS + jitter * (index % 2)
            dt = clock.step(stamp)
            timing = skew + 4.0 * clock.jitter
            reading = 0.5 + (index % 2) * 1e-6 + speed * 1e-9 * stamp
            if off:
                limit = joint.limit(dt, clock.period) + abs(joint.velocity) * timing
                off = joint.velocity * dt + off * limit - speed * dt
            joint.jumped(reading + off, dt, clock.period or dt, timing)
            return rig.sample(stamp=stamp, th1b=speed * 1e-9 * stamp + off)

        for index in range(1, 200):
            take(index, 0.0)
        if jitter:
            assert clock.jitter > 0.9e-4
        assert take(200, factor) == reason


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_reading_that_noise_takes_past_half_a_turn_is_in_range(sign):
    rig = Rig(healthy=False)
    past = sign * (pi + 1e-3) - PLACE[3]
    assert [rig.sample(th3a=past) for _ in range(10)][-6:] == [''] * 6
