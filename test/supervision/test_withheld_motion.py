# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An orientation that is withheld for its worth: what may continue it, and what is a fault."""

from math import radians

from rig import Rig, turned
from spm_haptic_master.exceptions import AmbiguousError

# Angle, rad, between the last orientation and another solution.
ELSEWHERE = 1.0
# Readings from which on a joint's jump is certain, rad.
JUMP = radians(3.0)


def turn(rig, angle):
    rig.solver.four = rig.solver.four._replace(quaternion=turned(angle))


def undetermined(rig, determined):
    rig.solver.four = rig.solver.four._replace(determined=determined)


def withheld(samples=30):
    """Return a rig whose level is above its alert limit, so that orientations are withheld."""
    rig = Rig()
    rig.supervisor.alert_limit = 1e-6
    reasons = {rig.sample() for _ in range(samples)}
    assert 'protection level above the alert limit' in reasons
    return rig


def test_while_it_settles_after_a_spike_another_solution_is_a_fault():
    rig = Rig()
    rig.sample(th1a=JUMP)
    rig.sample()
    turn(rig, ELSEWHERE)
    reasons = [rig.sample() for _ in range(3)]
    assert reasons == ['orientation does not continue the motion, sensor undetermined'] * 3
    assert rig.state == 'silent: orientation does not continue the motion, sensor undetermined'


def test_while_it_is_withheld_another_solution_is_no_fault():
    rig = withheld()
    turn(rig, ELSEWHERE)
    assert rig.sample() == 'orientation not determined'
    rig.supervisor.alert_limit = 1.0
    reasons = [rig.sample() for _ in range(10)]
    # It starts there as it did at first: consistent samples, and then it is published.
    assert reasons[:4] == ['settling'] * 4
    assert reasons[4:] == [''] * 6


def test_while_it_is_withheld_a_jump_to_another_solution_is_a_fault():
    rig = withheld()
    turn(rig, ELSEWHERE)
    assert [rig.sample(th1a=JUMP) for _ in range(3)] == ['joint_1a jumped'] * 3
    assert rig.state == 'silent: joint_1a jumped'


def test_after_a_symptom_the_motion_is_not_followed_any_more():
    rig = withheld()
    rig.supervisor.alert_limit = 1.0
    rig.sample(th1a=JUMP)
    rig.sample()
    turn(rig, ELSEWHERE)
    assert {rig.sample() for _ in range(3)} == {
        'orientation does not continue the motion, sensor undetermined'}


def test_two_solutions_that_meet_do_not_end_the_degraded_operation():
    rig = Rig(degraded=True)
    for _ in range(5):
        rig.sample(th1a=JUMP)
    assert rig.state == 'degraded: joint_1a jumped'
    rig.solver.error = AmbiguousError('two solutions')
    assert [rig.sample(th1a=JUMP) for _ in range(5)] == [''] * 5
    assert rig.state == 'degraded: joint_1a jumped'


def test_two_solutions_that_meet_leave_a_fault_latched():
    rig = Rig()
    for _ in range(5):
        rig.sample(th1a=JUMP)
    assert rig.state == 'silent: joint_1a jumped'
    rig.solver.error = AmbiguousError('two solutions')
    assert {rig.sample() for _ in range(5)} == {'joint_1a jumped'}
    assert rig.state == 'silent: joint_1a jumped'
