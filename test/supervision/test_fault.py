# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A latched fault: its words, when it is over, and when only a person can clear it."""

from rig import Rig

PAIR = {'th1a': 2.0, 'th1b': -1.87}  # their parities cancel
RECOVERY = 0.1005  # s, a hundred samples


def until_healthy(rig, **moved):
    """Return after how many samples the state is healthy; None if it is not within 300."""
    return next((count for count in range(1, 300)
                 if rig.samples(1, **moved) and rig.state == 'healthy'), None)


def test_a_fault_is_over_after_its_recovery_which_a_bad_sample_begins_again():
    rig = Rig(recovery=RECOVERY, alert_limit_deg=2.0)
    rig.samples(100, th1b=5.0)
    assert rig.state == 'silent: joint_1b jumped'
    for _ in range(3):
        rig.samples(90)
        rig.samples(1, th1b=5.0)
        assert rig.state == 'silent: joint_1b jumped'
    # And the window in which the others check it.
    assert 100 <= until_healthy(rig) <= 125


def test_a_fault_is_over_where_the_device_has_not_moved_yet():
    rig = Rig(healthy=False, recovery=RECOVERY, alert_limit_deg=2.0)
    rig.samples(100)
    rig.samples(10, th1b=5.0)
    assert rig.state == 'silent: joint_1b jumped'
    assert 100 <= until_healthy(rig) <= 125


def test_what_was_measured_before_a_pause_is_no_evidence_after_it():
    rig = Rig(healthy=False, bias_deg=(0.0,) * 4)
    rig.samples(4, th1b=0.4)
    rig.sample(after=600)
    assert rig.samples(20) == ['starting'] * 3 + [None] * 17


def test_a_second_sensor_that_jumps_during_a_fault_waits_for_a_person():
    rig = Rig(alert_limit_deg=2.0)
    rig.samples(100, th1b=5.0)
    rig.samples(30, th1b=5.0, th3a=20.0)
    assert rig.state == 'silent: joint_1b and joint_3a jumped, to be acknowledged'


def test_two_that_jumped_and_stay_wait_for_a_person_and_then_for_the_recovery():
    rig = Rig(recovery=RECOVERY, alert_limit_deg=2.0)
    assert not rig.supervisor.latch.acknowledge()
    rig.samples(100, **PAIR)
    assert rig.state == 'silent: joint_1a and joint_1b jumped, to be acknowledged'
    assert until_healthy(rig) is None
    assert rig.supervisor.latch.acknowledge() and not rig.supervisor.latch.acknowledge()
    assert 100 <= until_healthy(rig) <= 125


def test_two_that_jumped_back_need_no_person():
    rig = Rig(recovery=RECOVERY, alert_limit_deg=2.0)
    rig.samples(10, **PAIR)
    assert rig.state.endswith('to be acknowledged')
    assert 100 <= until_healthy(rig) <= 125
