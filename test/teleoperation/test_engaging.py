# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The state machine of engaging: one condition after the other, and random sequences of all."""

from itertools import pairwise
from math import nan, radians
import random
from typing import ClassVar

from engaging_rig import angle_between, MASTER, MS, PERIOD, quaternion, Rig, rotation_vector, SLAVE
from mechanism import turn, zxz
import numpy as np
import pytest
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.parameters.nodes import TELEOP_SETTINGS
from spm_haptic_master.supervision.orientation_state import read_state, received_state
from spm_haptic_master.teleoperation.command import Pose
from spm_haptic_master.teleoperation.engaging import Phase


def test_each_condition_is_named_that_is_missing():
    rig = Rig(alignment_tolerance_deg=5.0, protection_limit_deg=1.0)
    machine = rig.machine
    rig.master_speaks = rig.slave_speaks = False
    for change, why in (
        (lambda: None, 'no state of the orientation'),
        (
            lambda: machine.take_state(read_state('silent: no joint samples')),
            'silent: no joint samples',
        ),
        (lambda: machine.take_state(read_state('degraded: joint_3a missing')), 'no orientation'),
        (lambda: setattr(rig, 'master_speaks', True), 'no pose of the slave'),
        (
            lambda: setattr(rig, 'slave_speaks', True) or machine.take_enabling(0, 0.0),
            'master not enabled',
        ),
        (lambda: machine.take_enabling(7, 0.0), 'no protection level'),
        (lambda: setattr(rig, 'level', 1.5), 'protection level above the limit'),
        (lambda: setattr(rig, 'level', nan), 'protection level above the limit'),
        # The limit itself is within it.
        (lambda: setattr(rig, 'level', 1.0), 'no presence'),
        (lambda: machine.take_presence(True) or machine.take_clutch(True), 'clutch pressed'),
        (lambda: machine.take_clutch(False), 'waiting for enable'),
        (machine.enable, 'waiting for the slave to be at rest'),
        (lambda: rig.run(60), 'not aligned'),
        (lambda: setattr(rig, 'slave', rig.master), 'waiting for the slave to be at rest'),
    ):
        change()
        rig.run(5)
        assert rig.state == f'disengaged: {why}'
        machine.external_block = 'two publishers of servo_cp'
        assert rig.state == 'disengaged: two publishers of servo_cp'
        assert machine.is_blocked
        machine.external_block = ''
    rig.run(60)
    assert rig.state == 'engaged'


@pytest.mark.parametrize(
    ('numbers', 'engages'),
    [
        # It may be older than the machine: one that starts while the pedal is down stays still.
        ([(123, 0.0)], False),
        ([(123, 0.0), (123, 0.0)], False),
        ([(123, 0.0), (124, 0.0)], True),
        # The link was lost, or this process stood still: the surgeon has forgotten it.
        ([(1, 0.0), (2, 10.0)], True),
        ([(1, 0.0), (2, 11.0)], False),
        ([(1, 0.0), (2, 3600.0)], False),
        ([(1, 0.0), (2, -3600.0)], False),
    ],
)
def test_only_a_fresh_enable_that_is_known_as_such_engages(numbers, engages):
    rig = Rig().ready()
    rig.machine.take_presence(True)
    for number, age in numbers:
        rig.machine.take_enabling(number, age)
        given = rig.run(50)
    assert bool(given) is engages


def fall_silent(rig):
    rig.machine.take_state(read_state('silent: joint_3a stuck'))
    rig.run(2)
    rig.machine.take_state(read_state('healthy'))


@pytest.mark.parametrize(
    'end',
    [
        lambda rig: rig.run(120),
        fall_silent,
        lambda rig: rig.machine.disengage(),
    ],
)
def test_an_enable_that_was_not_used_lapses(end):
    rig = Rig(enable_timeout=0.1).ready()
    assert rig.machine.enable() == ''
    end(rig)
    rig.machine.take_presence(True)
    assert rig.run(50) == []
    assert rig.state == 'disengaged: waiting for enable'


def test_an_enable_during_an_obstacle_has_no_effect():
    rig = Rig().ready()
    rig.machine.take_presence(True)
    rig.pause('slave', 150)
    assert rig.machine.enable() == 'no pose of the slave'
    assert rig.run(50) == []


def test_an_enable_during_an_obstacle_of_a_moment_has_no_effect():
    rig = Rig().ready()
    rig.machine.take_presence(True)
    rig.machine.external_block = 'two publishers of servo_cp'
    assert rig.machine.enable() == 'two publishers of servo_cp'
    rig.machine.external_block = ''
    assert rig.run(50) == []


def test_a_slave_is_at_rest_after_50_ms_near_one_pose():
    rig = Rig(command_rate=0.0)
    rig.machine.take_state(read_state('healthy'))
    rig.run(20)
    rig.slave = turn([0.0, 0.0, radians(0.6)]) @ rig.slave
    rig.run(1)
    rig.machine.take_presence(True)
    assert rig.machine.enable() == ''
    rig.slave = turn([0.0, 0.0, radians(0.4)]) @ rig.slave
    assert rig.run(49) == []
    assert rig.state.endswith('waiting for the slave to be at rest')
    assert len(rig.run(1)) == 1


def stop(rig):
    """Stop the whole process and let it go on: everything that waits is delivered at once."""
    rig.machine.pass_time(3.0)
    rig.stamp += 3000 * MS


def passing(method, bad, good):
    """Return a loss that is over at once: what the machine takes, and takes after it."""

    def lose(rig):
        take = getattr(rig.machine, method)
        take(bad)
        take(good)

    return lose


def set_the_clock(rig):
    """Let an hour pass that the computer slept, or have its clock set."""
    rig.stamp += 3_600_000 * MS


def lose_enabling(rig):
    rig.machine.take_enabling(0, 0.0)
    rig.machine.take_enabling(1, 1e9)


NOT_A_ROTATION = (0.0, nan, 0.0, 1.0)


def unlike_a_rotation_for_a_moment(rig):
    rig.machine.take_master(rig.stamp + 1, NOT_A_ROTATION)
    rig.machine.take_master(rig.stamp + 2, quaternion(rig.master))


# What disengages, by the cause that is named.
LOSSES = {
    'no presence': passing('take_presence', False, True),
    'no orientation': lambda rig: rig.pause('master', 60),
    'no orientation (norm)': lambda rig: rig.machine.take_master(rig.stamp + 1, NOT_A_ROTATION),
    'no orientation (norm, for a moment)': unlike_a_rotation_for_a_moment,
    'no orientation (stopped)': stop,
    'no orientation (stamp)': set_the_clock,
    'no pose of the slave': lambda rig: rig.pause('slave', 110),
    'no pose of the slave (norm)': lambda rig: rig.machine.take_slave(Pose(NOT_A_ROTATION)),
    'no pose of the slave (invalid, for a moment)': passing(
        'take_slave', None, Pose(quaternion(SLAVE))
    ),
    # As dVRK says that its arm is not ready.
    'no pose of the slave (invalid)': lambda rig: rig.machine.take_slave(None),
    'slave DISABLED': passing('take_slave_obstacle', 'slave DISABLED', ''),
    'force: fault: x': passing('take_force_fault', 'force: fault: x', ''),
    'silent: x': passing('take_state', read_state('silent: x'), read_state('healthy')),
    'master not enabled': lose_enabling,
    'protection level above the limit': passing('take_level', radians(0.8), radians(0.1)),
    'disabled': lambda rig: rig.machine.disengage(),
}


def engaged_with_a_level():
    """Return a rig that is engaged, with a limit of the protection level."""
    rig = Rig(protection_limit_deg=0.5)
    rig.level = 0.1
    return rig.engage()


def check_disengaged(rig, cause):
    """Check that a rig has disengaged for a cause, for good, and engages by an enable."""
    assert rig.run(300) == []
    assert rig.machine.phase is Phase.DISENGAGED
    assert rig.state == f'disengaged: waiting for enable, after: {cause.partition(" (")[0]}'
    assert rig.machine.enable() == ''
    assert rig.run(20)
    assert rig.machine.starts == 2


@pytest.mark.parametrize('cause', LOSSES)
def test_what_disengages_does_so_for_good(cause):
    rig = engaged_with_a_level()
    LOSSES[cause](rig)
    check_disengaged(rig, cause)


@pytest.mark.parametrize('cause', [*LOSSES, 'clutch gone while pressed'])
def test_what_disengages_does_so_while_the_clutch_is_pressed_too(cause):
    rig = engaged_with_a_level()
    rig.machine.take_clutch(True)
    assert rig.run(20) == []
    assert rig.state == 'clutched'
    if cause in LOSSES:
        LOSSES[cause](rig)
    else:
        rig.machine.take_clutch(None)
    rig.machine.take_clutch(False)
    check_disengaged(rig, cause)


def test_a_clutch_that_is_not_pressed_may_go():
    rig = engaged_with_a_level()
    rig.machine.take_clutch(None)
    rig.machine.take_clutch(False)
    assert rig.run(20)


def test_presence_has_to_be_repeated():
    """By default: a pedal that was killed does not lead the slave."""
    defaults = {setting.name: setting.default for setting in TELEOP_SETTINGS}
    timeout = defaults['teleop.presence_timeout']
    rig = Rig(presence_timeout=timeout).engage()
    for _ in range(2):
        rig.machine.take_presence(True)
        assert rig.run(round(1000 * timeout) - 5)[-1]
    assert rig.run(20)
    assert rig.run(100) == []
    assert rig.state == 'disengaged: no presence'


def test_the_law_at_the_rate_of_the_samples_and_with_a_registration():
    angles = [0.5, -0.7, 0.2]
    registration = zxz(*angles)
    rig = Rig(command_rate=0.0, registration_zxz_deg=np.degrees(angles).tolist()).engage()
    master = rig.master
    slave = rig.slave
    for k in range(300):
        ((_, given),) = rig.run(1, (0.002 * k, -0.001 * k, 0.3))
        expected = registration @ rig.master @ (registration @ master).T @ slave
        np.testing.assert_allclose(given, expected, atol=1e-12)


def test_an_orientation_that_is_not_newer_is_ignored():
    rig = Rig(command_rate=0.0).engage()
    other = quaternion(turn([1.0, 0.0, 0.0]) @ rig.master)
    for late in (0, 1, 1000):
        assert rig.machine.take_master(rig.stamp - late * MS, other) is None
    ((_, after),) = rig.run(1)
    np.testing.assert_allclose(after, rig.slave, atol=1e-12)


@pytest.mark.parametrize(('late', 'state'), [(0, 'engaged'), (1, 'disengaged')])
def test_stamps_may_be_50_ms_apart(late, state):
    """By the stamps alone: as if no clock had run meanwhile."""
    rig = Rig().engage()
    rig.machine.take_master(rig.stamp + 50 * MS + late, quaternion(rig.master))
    assert rig.state.partition(':')[0] == state


def test_a_clock_that_was_set_back_before_engaging_does_not_matter():
    rig = Rig().ready()
    rig.stamp -= 3_600_000 * MS
    assert rig.engage().run(20)


@pytest.mark.parametrize('tilt', [0.1, 0.2, 0.3, 0.4, 0.5])
def test_a_slave_that_is_aligned_already_stays_where_it_is(tilt):
    rig = Rig(alignment='absolute')
    rig.master = zxz(0.3, tilt, -0.2)
    rig.slave = rig.master
    rig.engage()
    for _, given in rig.run(20):
        np.testing.assert_allclose(given, rig.master, atol=1e-12)


def test_an_aligned_slave_meets_a_jump_of_the_master_at_the_limits_of_the_command():
    """The speed of aligning is for the offset of engaging alone."""
    rig = Rig(alignment='absolute', align_speed=0.1)
    rig.slave = rig.master
    rig.engage()
    rig.master = turn([0.0, radians(20.0), 0.0]) @ rig.master
    last = rig.run(200)[-1][1]
    np.testing.assert_allclose(last, rig.master, atol=1e-9)


def test_a_slave_that_does_not_follow_disengages():
    """A command that it never got would be a jump once it gets the next one."""
    rig = Rig(tracking_limit_deg=10.0).engage()
    rig.run(300, (0.0, 0.0, 0.5))
    assert rig.state == 'engaged'
    rig.run(100, (0.0, 0.0, 0.5))
    assert rig.state == 'disengaged: waiting for enable, after: the slave does not follow'
    rig = Rig(tracking_limit_deg=10.0).engage()
    for _ in range(100):
        rig.slave = rig.run(10, (0.0, 0.0, 0.5))[-1][1]
    assert rig.state == 'engaged'


def test_commands_come_at_their_rate():
    commands = Rig().engage().run(200)
    stamps = [stamp for stamp, _ in commands]
    assert set(np.diff(stamps)) == {5 * MS}


def test_the_clutch_holds_the_slave_and_takes_a_new_offset():
    rig = Rig(command_rate=0.0).engage()
    before = rig.run(200, (0.0, 0.5, 0.0))[-1][1]
    rig.machine.take_clutch(True)
    rig.slave = turn([0.0, 0.0, 0.01]) @ before
    assert rig.run(400, (0.0, 0.0, 2.0)) == []
    assert rig.state == 'clutched'
    rig.machine.take_clutch(False)
    (_, start), *_, (_, end) = rig.run(101, (0.4, 0.0, 0.0))
    np.testing.assert_allclose(start, rig.slave, atol=1e-12)
    np.testing.assert_allclose(end, turn([0.04, 0.0, 0.0]) @ rig.slave, atol=1e-9)
    assert rig.state == 'engaged'


def test_a_release_of_the_clutch_far_from_alignment_disengages():
    rig = Rig(alignment_tolerance_deg=5.0)
    rig.slave = rig.master
    rig.engage()
    rig.machine.take_clutch(True)
    rig.run(200, (0.0, 1.0, 0.0))
    rig.machine.take_clutch(False)
    assert rig.run(50) == []
    assert rig.state == 'disengaged: waiting for enable, after: not aligned'


def approach_of(rig, angle):
    """Check that the commands went straight to the master; return times and angles left."""
    stamps, matrices = zip(*rig.commands, strict=True)
    left = np.array([angle_between(matrix, rig.master) for matrix in matrices])
    turned = np.array([angle_between(matrix, matrices[0]) for matrix in matrices])
    assert left[0] == pytest.approx(angle, abs=1e-9)
    assert left[-1] < 1e-9
    assert np.all(np.diff(left) <= 1e-7)
    # It stays on its way: what it has turned and what is left add up.
    np.testing.assert_allclose(turned + left, angle, atol=1e-6)
    return 1e-9 * np.diff(stamps), left


@pytest.mark.parametrize('seed', range(3))
def test_an_absolute_slave_brakes_ahead_and_never_passes_the_master(seed):
    """At any limits, rate and gaps: the angle to the master only falls, within the limits."""
    generator = random.Random(seed)
    speed = generator.uniform(0.2, 3.0)
    acceleration = 10.0 ** generator.uniform(-0.3, 3.0)
    rate = generator.choice([0.0, 50.0, 200.0, 333.0])
    rig = Rig(
        alignment='absolute',
        align_speed=speed,
        acceleration_limit=acceleration,
        command_rate=rate,
        jump_limit_deg=90.0,
    )
    angle = generator.uniform(0.05, 2.8)
    rig.slave = turn(angle * np.array([0.6, 0.0, 0.8])) @ MASTER
    rig.engage()
    # Long enough to accelerate, to close in and to brake, with the gaps.
    for _ in range(1000):
        rig.run(generator.randint(1, 15))
        rig.pause('master', generator.choice([0, 0, 0, 3, 8, 25, 40]))
        if angle_between(rig.commands[-1][1], rig.master) < 1e-9:
            break
    assert rig.machine.phase is Phase.ENGAGED
    times, left = approach_of(rig, angle)
    # From rest.
    rates = np.concatenate([[0.0], -np.diff(left) / times])
    changes = np.abs(np.diff(rates))
    assert rates.max() <= speed * (1.0 + 1e-6)
    # As fast as the limits allow: it speeds up for half of the way at most.
    assert rates.max() > 0.8 * min(speed, np.sqrt(acceleration * angle))
    assert np.all(changes <= acceleration * times * (1.0 + 1e-6) + 1e-4)
    # Then they are one.
    rig.run(600, (0.02, 0.0, 0.0))
    _, last = rig.commands[-1]
    np.testing.assert_allclose(last @ rig.master.T, np.eye(3), atol=5e-4)


def test_a_jump_of_the_master_is_slewed_or_disengages():
    jump = turn([0.0, radians(30.0), 0.0])
    rig = Rig().engage()
    rig.master = jump @ rig.master
    after = [matrix for _, matrix in rig.run(400)]
    assert max(map(angle_between, [SLAVE, *after], after)) <= 6.0 * PERIOD * 1.001
    np.testing.assert_allclose(after[-1], jump @ SLAVE, atol=1e-9)
    rig = Rig(limit_action='disengage').engage()
    rig.master = jump @ rig.master
    assert rig.run(100) == []
    assert rig.state == 'disengaged: waiting for enable, after: jump above the limit'


def run_with_lag(rig, lag, every, steps, rate):
    """Have the slave follow the command by a lag, s, and report where it is at times, ms."""
    part = 1.0 if lag == 0.0 else 1.0 - np.exp(-0.001 / lag)
    for _ in range(steps):
        rig.slave_speaks = rig.stamp // MS % every == 0
        rig.run(1, (0.0, rate, 0.0))
        commanded = rig.commands[-1][1] if rig.commands else rig.slave
        behind = rotation_vector(commanded @ rig.slave.T)
        rig.slave = turn(part * behind) @ rig.slave


@pytest.mark.parametrize(
    ('lag', 'every', 'slave_timeout', 'moment', 'rests'),
    [
        (0.0, 100, 0.15, 0, False),
        (0.05, 5, 0.1, 30, False),
        (0.02, 90, 0.1, 60, False),
        # It has rested for long, and has not reported yet that the last commands move it.
        (0.0, 100, 0.15, 60, True),
    ],
)
@pytest.mark.parametrize('tapped', ['clutch', 'disable'])
def test_a_slave_on_its_way_does_not_begin_to_follow(
    lag, every, slave_timeout, tapped, moment, rests
):
    """Its last pose is not where it is: the command would go back there."""
    rig = Rig(slave_timeout=slave_timeout)
    rig.machine.take_state(read_state('healthy'))
    run_with_lag(rig, lag, every, 300, 0.0)
    rig.machine.take_presence(True)
    rig.machine.enable()
    run_with_lag(rig, lag, every, 200, 0.0 if rests else 2.0)
    run_with_lag(rig, lag, every, moment, 2.0)
    assert rig.state == 'engaged'
    last = rig.commands[-1][1]
    if tapped == 'clutch':
        rig.machine.take_clutch(True)
        run_with_lag(rig, lag, every, 1, 2.0)
        rig.machine.take_clutch(False)
    else:
        rig.machine.disengage()
        assert rig.machine.enable() == ''
    count = len(rig.commands)
    run_with_lag(rig, lag, every, 400, 2.0)
    assert rig.state == 'engaged'
    assert angle_between(rig.commands[count][1], last) < radians(1.0)


def test_what_has_waited_does_not_go_out_at_once():
    rig = Rig().engage()
    rig.run(100, (0.0, 5.9, 0.0))
    last = rig.commands[-1][1]
    rig.machine.pass_time(0.045)
    burst = []
    for _ in range(45):
        rig.stamp += MS
        rig.machine.pass_time(1e-5)
        rig.machine.take_slave(Pose(quaternion(rig.slave)))
        rig.master = turn([0.0, 0.0059, 0.0]) @ rig.master
        command = rig.machine.take_master(rig.stamp, quaternion(rig.master))
        if command is not None:
            burst.append(matrix_from_quaternion(command.pose.rotation))
    assert burst
    assert angle_between(burst[-1], last) <= 6.0 * (0.01 + 2.0 * PERIOD) * 1.05
    # It catches up within the limits.
    behind = len(rig.commands)
    rig.run(300, (0.0, 1.0, 0.0))
    assert rig.state == 'engaged'
    matrices = [matrix for _, matrix in rig.commands[behind:]]
    speeds = [angle_between(*pair) / PERIOD for pair in pairwise(matrices)]
    assert max(speeds) <= 6.0 * 1.001
    assert speeds[-1] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    'limits',
    [
        {'command_rate': 20.0, 'orientation_timeout': 0.2},
        {'jump_limit_deg': 1.0, 'command_rate': 100.0},
    ],
)
def test_the_velocity_is_that_of_the_command(limits):
    """A slave that is driven by rates turns as far as one that is driven by poses."""
    rig = Rig(**limits).engage()
    before, last = rig.commands[-1]
    turned = 0.0
    for _ in range(1000):
        for stamp, _ in rig.run(1, (0.0, 0.5, 0.0)):
            turned += rig.last.motion.angular[1] * (stamp - before) * 1e-9
            before = stamp
    moved = rotation_vector(rig.commands[-1][1] @ last.T)[1]
    assert moved > 0.4
    assert turned == pytest.approx(moved, rel=1e-6)


class Watch:
    """What has to hold, from what has happened to a rig: it knows nothing of the machine."""

    def __init__(self, rig):
        self.rig = rig
        self.healthy = False
        self.present = False
        self.clutch = False
        self.enabling = None
        # Whether an enable came since something disengaged.
        self.armed = False
        self.engaged = False
        self.last = None

    def check(self, commands):
        for stamp, matrix in commands:
            assert self.healthy
            assert self.present
            assert not self.clutch
            assert self.enabling != 0
            assert self.armed or self.engaged
            self.engaged = True
            self.armed = False
            if self.last is None:
                np.testing.assert_allclose(matrix, self.rig.spoken['slave'][0], atol=1e-9)
            else:
                before, rotation = self.last
                passed = min((stamp - before) * 1e-9, 2.0 * PERIOD)
                largest = min(6.0 * passed, radians(5.0))
                step = rotation_distance(quaternion(rotation), quaternion(matrix))
                assert step <= largest * (1.0 + 1e-6) + 1e-7
            self.last = stamp, matrix

    def happen(self, what, value):
        """Have something happen, and follow what it disengages."""
        self.happenings[what](self, value)
        machine = self.rig.machine
        machine.pass_time(0.0)
        is_too_long = what in self.longest and value > self.longest[what]
        if not self.healthy or self.enabling == 0 or what == 'disable' or is_too_long:
            self.armed = False
            self.engaged = False
        if machine.phase is Phase.DISENGAGED:
            self.engaged = False
        if self.clutch or not self.engaged:
            self.last = None

    def run(self, value):
        self.check(self.rig.run(*value))

    def be_silent(self, value):
        assert self.rig.pause('master', value) == []

    def be_stale(self, value):
        # The pose that is the last one is the slave's.
        self.check(self.rig.pause('slave', value))

    def take_presence(self, value):
        self.present = value
        self.rig.machine.take_presence(value)

    def take_clutch(self, value):
        self.clutch = value
        self.rig.machine.take_clutch(value)

    def take_state(self, value):
        state = received_state(value)
        self.healthy = state.publishes
        self.rig.machine.take_state(state)

    def enable(self, _):
        self.armed = self.rig.machine.enable() == '' or self.armed

    def take_enabling(self, value):
        before = self.enabling
        self.enabling = value
        self.armed = self.armed or before not in (None, value)
        self.rig.machine.take_enabling(value, 0.0)

    def disable(self, _):
        self.rig.machine.disengage()

    def move_master(self, value):
        self.rig.master = turn(value) @ self.rig.master

    def move_slave(self, value):
        self.rig.slave = turn(value) @ self.rig.slave

    # Longest pauses that do not disengage, ms.
    longest: ClassVar = {'silence': 50, 'stale': 101}
    happenings: ClassVar = {
        'run': run,
        'walk': run,
        'silence': be_silent,
        'stale': be_stale,
        'presence': take_presence,
        'clutch': take_clutch,
        'state': take_state,
        'enable': enable,
        'enable of the master': take_enabling,
        'disable': disable,
        'master': move_master,
        'slave': move_slave,
    }


# What may happen between two samples of the master, by its weight in a random sequence: its value.
ACTIONS = {
    'run': lambda draw: (draw.randint(1, 120), [draw.uniform(-8.0, 8.0) for _ in range(3)]),
    'walk': lambda draw: (draw.randint(1, 60), (0.2, -0.1, 0.3)),
    'silence': lambda draw: draw.randint(1, 90),
    'stale': lambda draw: draw.randint(1, 160),
    'presence': lambda draw: draw.random() < 0.9,
    'clutch': lambda draw: draw.random() < 0.3,
    'state': lambda draw: draw.choice(
        [
            *['healthy'] * 8,
            'degraded: joint_1a',
            'silent: no joint samples',
            'starting',
            'all is well',
            'healthy: but',
        ]
    ),
    'enable': lambda _: None,
    'enable of the master': lambda draw: draw.randint(0, 8),
    'disable': lambda _: None,
    'master': lambda draw: [draw.uniform(-1.0, 1.0) for _ in range(3)],
    'slave': lambda draw: [draw.uniform(-0.1, 0.1) for _ in range(3)],
}
WEIGHTS = (4, 8, 1, 1, 3, 2, 3, 8, 2, 0.5, 1, 1)


@pytest.mark.parametrize(
    'seed',
    [
        0,
        1,
        *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 5)),
    ],
)
def test_whatever_comes_there_is_no_step_and_no_command_while_not_engaged(seed):
    draw = random.Random(seed)
    watch = Watch(Rig(limit_action=('slew', 'disengage')[seed % 2]))
    for what in draw.choices(list(ACTIONS), WEIGHTS, k=400):
        watch.happen(what, ACTIONS[what](draw))
    assert watch.rig.machine.starts > 4
