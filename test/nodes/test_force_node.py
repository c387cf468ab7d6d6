# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback in fkm, sample by sample in simulated time, with a test as drives and clients."""

from dataclasses import dataclass
import math
import time

from geometry_msgs.msg import Quaternion, WrenchStamped
import numpy as np
import pytest
import rclpy
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import (
    inverse,
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
)
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.parameters.resolver import Parameters
from std_msgs.msg import Bool, Empty, Float64, String
from std_srvs.srv import Trigger

pytestmark = pytest.mark.process

MS = 1_000_000
POSE_DEG = (130.0, 50.0, 30.0)
POSE = matrix_from_zxz(*np.radians(POSE_DEG))
TORQUE = (0.05, -0.1, 0.15)
# Each sensor is unchecked at first: the protection level of one pose is of all sensors.
FORCE = {'force.enabled': 'true', 'force.without_drives': 'true', 'alert_limit_deg': '5.0',
         'force.protection_limit_deg': '5.0', 'force.damping': '0.0'}
START = 1_700_000_000_000 * MS


@dataclass
class Report:
    """What drives report."""

    ready: bool = True
    fault: str | None = None
    torques: tuple[float, ...] = (0.0,) * 3
    seconds_since_status: float = 0.001


class FakeDrives:
    """Drives that do what they are commanded."""

    def __init__(self):
        self.report, self.commands, self.closed = Report(), [], 0

    def step(self, torques, now):
        self.commands.append(torques)
        self.report.torques = torques or (0.0,) * 3
        return self.report

    def acknowledge(self):
        self.report.fault = None

    def close(self):
        self.closed += 1


class Rig:
    """An fkm whose time is that of the test, and whose timers never run."""

    def __init__(self, **given):
        arguments = [f'{name}:={value}' for name, value in (FORCE | given).items()]
        self.node = Fkm(Parameters((), arguments, ()))
        for timer in self.node.timers:
            timer.cancel()
        self.now = START
        self.node._now = lambda: self.now
        self.force = self.node._force
        # Whether the time of the computer does not count.
        self.is_timeless = True
        self.teleop = 'engaged'
        self.angles = angles(POSE)
        self.period = MS

    def deliver(self, topic, message):
        """Have a subscription take a message."""
        found, = [each for each in self.node.subscriptions if each.topic_name == f'/{topic}']
        found.callback(message)

    def run(self, milliseconds, torque=None, topic='servo_cf', frame='', rate=1, stamped=None):
        """Run samples, one a millisecond, with a wrench each; return the last output."""
        for _ in range(milliseconds):
            self.now += self.period
            if self.is_timeless:
                self.force._inputs._polled_at, self.force._inputs._was_late = math.inf, False
            if self.teleop:
                self.deliver('teleop_state', String(data=self.teleop))
            if torque is not None and (self.now // MS) % rate == 0:
                self.deliver(topic, wrench(torque, frame, None if stamped is None else (
                    self.now + stamped)))
            self.node.take(self.now, self.angles)
        return self.force._output

    def engage(self, **more):
        """Bring force up; return the last output."""
        self.run(50)
        return self.run(800, (0.0, 0.0, 0.0), **more)

    @property
    def text(self):
        return self.force._output.state.text

    def acknowledge(self):
        return self.node._acknowledge(Trigger.Request(), Trigger.Response())


def angles(rotation):
    joints = inverse(rotation)
    return (*map(float, joints.theta1), float(joints.theta3a))


def wrench(torque, frame='', stamp=None, force=(0.0, 0.0, 0.0)):
    message = WrenchStamped()
    message.header.frame_id = frame
    if stamp is not None:
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10 ** 9)
    t, f = message.wrench.torque, message.wrench.force
    t.x, t.y, t.z = torque
    f.x, f.y, f.z = force
    return message


@pytest.fixture
def make():
    """Make rigs that are gone at the test's end."""
    rclpy.init()
    rigs = []

    def make(drives=None, **given):
        rig = Rig(**given)
        if drives is not None:
            rig.force._drives = drives
        rigs.append(rig)
        return rig

    yield make
    for rig in rigs:
        rig.node.destroy_node()
    rclpy.shutdown()


def test_a_wrench_becomes_motor_torques(make):
    rig = make()
    rig.engage()
    assert rig.text == 'engaged'
    output = rig.run(50, TORQUE)
    np.testing.assert_allclose(output.rendered, TORQUE, atol=1e-3)
    assert rig.force.effort()[:3] == list(output.motor_torque) and rig.force.effort()[3] == 0.0


@pytest.mark.parametrize(('topic', 'frame', 'turned'), [
    ('servo_cf', 'spm_base', False), ('servo_cf', 'spm_platform', True),
    ('servo_cf', 'spm_handle', True), ('spatial/servo_cf', 'anything', False),
    ('body/servo_cf', 'anything', True)])
def test_the_frame_of_a_wrench(make, topic, frame, turned):
    rig = make()
    rig.engage(topic=topic, frame=frame)
    output = rig.run(50, TORQUE, topic, frame)
    expected = POSE @ TORQUE if turned else TORQUE
    np.testing.assert_allclose(output.rendered, expected, atol=1e-3)


def test_dvrks_absolute_body_wrench_is_in_the_frame_of_the_orientation(make):
    rig = make()
    rig.deliver('body/set_cf_orientation_absolute', Bool(data=True))
    rig.engage(topic='body/servo_cf')
    np.testing.assert_allclose(
        rig.run(50, TORQUE, 'body/servo_cf').rendered, TORQUE, atol=1e-3)


def test_an_unknown_frame_is_refused_and_named(make):
    rig = make()
    rig.engage()
    rig.run(10, TORQUE, frame='psm_base')
    assert "in frame 'psm_base'; expected spm_base, spm_handle, spm_platform" in \
        rig.force._inputs.caution
    assert rig.force._inputs.refused == 10
    rig.run(50, TORQUE, frame='psm_base')
    assert rig.text == 'ready' and not any(rig.force._output.motor_torque)


def test_a_wrench_by_its_own_stamp(make):
    rig = make()
    rig.engage(stamped=-5 * MS)
    assert rig.text == 'engaged'
    rig.run(60, TORQUE, stamped=-31 * MS)
    assert rig.text == 'ready' and rig.force._inputs.stale == 60


def test_a_wrench_that_waited_while_this_process_stood_still_is_none(make):
    rig = make()
    rig.engage()
    inputs = rig.force._inputs
    rig.is_timeless, inputs._polled_at = False, time.monotonic() - 10.0
    rig.run(1, TORQUE)
    # Whichever comes first, the message or the timer.
    inputs.poll()
    rig.run(1, TORQUE)
    assert inputs.stale == 2
    rig.is_timeless = True
    assert rig.run(50, TORQUE).state.text == 'engaged' and inputs.stale == 2


@pytest.mark.parametrize('broken', [
    {'torque': (math.nan, 0.0, 0.0)}, {'torque': (0.0,) * 3, 'force': (math.inf, 0.0, 0.0)}])
def test_a_wrench_that_is_not_finite_is_a_fault_even_between_two_samples(make, broken):
    rig = make()
    rig.engage()
    rig.deliver('servo_cf', wrench(**broken))
    rig.run(1, TORQUE)
    assert rig.text == 'fading: wrench not finite'
    rig.run(30, TORQUE)
    assert rig.text == 'fault: wrench not finite'
    assert rig.acknowledge().success and not rig.acknowledge().success
    rig.engage()
    assert rig.text == 'engaged'


def test_a_second_node_that_publishes_wrenches_is_a_fault(make):
    rig = make()
    rig.engage()
    others = [rclpy.create_node(name) for name in ('one', 'other')]
    try:
        first = [others[0].create_publisher(WrenchStamped, topic, 1)
                 for topic in ('servo_cf', 'body/servo_cf', 'spatial/servo_cf')]
        await_sources(rig, 1)
        rig.run(20, TORQUE)
        assert rig.text == 'engaged' and len(first) == 3
        others[1].create_publisher(WrenchStamped, 'body/servo_cf', 1)
        await_sources(rig, 2)
        rig.run(1, TORQUE)
        assert rig.text == 'fading: two sources of the wrench'
        assert rig.force._inputs.caution == 'wrenches from /one, /other; expected one node'
    finally:
        for other in others:
            other.destroy_node()


def await_sources(rig, count):
    """Poll until the publishers of a number of nodes are known."""
    for _ in range(6000):
        rig.force._inputs._count_at = 0.0
        rig.force._inputs.poll()
        if rig.force._inputs.sources == count and all(
                rig.node.count_publishers(topic) >= (1 if count == 1 else 0)
                for topic in ('servo_cf', 'body/servo_cf', 'spatial/servo_cf')):
            return
        rclpy.spin_once(rig.node, timeout_sec=0.01)
    pytest.fail(f'{rig.force._inputs.sources} sources')


@pytest.mark.parametrize(('state', 'first', 'text'), [
    ('disengaged: no presence', 'fading: no hand on the handle', 'ready'),
    ('disengaged: waiting for enable', 'fading: teleoperation not engaged', 'ready'),
    ('other words', 'fading: teleoperation not engaged', 'ready'),
    ('clutched', 'holding', 'holding')])
def test_what_teleop_says(make, state, first, text):
    rig = make()
    rig.engage()
    rig.teleop = state
    rig.run(1, TORQUE)
    assert rig.text == first
    rig.run(50, TORQUE)
    assert rig.text == text and not any(rig.force._output.motor_torque)


def test_a_teleop_that_falls_silent_is_nobodys(make):
    rig = make()
    rig.engage()
    rig.force._inputs._phase_at -= 1.0
    rig.force._inputs.poll()
    assert rig.force._inputs.phase.value == 'disengaged'


def test_the_operating_state_may_engage(make):
    rig = make(**{'force.engaged_by': 'operating_state'})
    assert not [each for each in rig.node.subscriptions if 'teleop_state' in each.topic_name]
    rig.teleop = ''
    rig.engage()
    assert rig.text == 'off' and rig.force._output.obstacle.value == 'disabled'
    rig.node._crtk.take(rig.node._changes[-1])
    assert rig.node._crtk.command('enable')[0]
    rig.run(200, (0.0, 0.0, 0.0))
    assert rig.text == 'engaged'
    rig.node._crtk.command('disable')
    rig.run(50, TORQUE)
    assert rig.text == 'off'


def test_a_sample_that_is_withheld_ends_force(make):
    rig = make()
    rig.engage()
    before = rig.run(50, TORQUE).motor_torque
    rig.angles = (*rig.angles[:3], rig.angles[3] + 0.05)
    output = rig.run(1, TORQUE)
    assert output.state.text == 'fading: no orientation'
    assert 0.0 < abs(output.motor_torque[0]) < abs(before[0])
    assert not any(rig.run(25, TORQUE).motor_torque)
    assert rig.text == 'fault: no orientation'


def test_samples_that_stop_end_force_within_25_ms(make):
    """Nothing calls the node then but its timer, every 5 ms."""
    drives = FakeDrives()
    rig = make(drives)
    warnings = []
    rig.force._warn = warnings.append
    rig.engage()
    assert any(rig.run(50, TORQUE).motor_torque)
    for _ in range(4):
        rig.force._watch()
    assert rig.text == 'fading: no orientation'
    del drives.commands[:]
    for _ in range(5):
        rig.force._watch()
    assert len(drives.commands) == 5 and drives.commands[-1] is None
    assert rig.text == 'fault: no orientation'
    # CRTK's `warning` has it once.
    assert warnings == ['force feedback: fault: no orientation']


def test_a_pause_of_the_whole_process_is_no_missing_sample(make):
    """Its timers run once then, and the samples that have waited come."""
    rig = make()
    rig.engage()
    for _ in range(20):
        rig.now += 12 * MS
        rig.force._watch()
        rig.run(5, TORQUE)
    assert rig.text == 'engaged'


def test_drives_are_commanded_and_their_faults_are_ours(make):
    drives = FakeDrives()
    drives.report.ready = False
    rig = make(drives)
    rig.engage()
    assert rig.text == 'off' and drives.commands[-1] == (0.0,) * 3
    drives.report.ready = True
    rig.engage()
    assert rig.text == 'engaged'
    output = rig.run(50, TORQUE)
    assert drives.commands[-1] == output.motor_torque and any(output.motor_torque)
    drives.report.fault = 'drive 2: overcurrent'
    rig.run(5, TORQUE)
    assert rig.text == 'fault: fault of a drive'
    assert drives.commands[-1] is None
    assert rig.acknowledge().success and drives.report.fault is None
    rig.engage()
    assert rig.text == 'engaged'
    rig.node.destroy_node()
    assert drives.closed == 1
    rig.node.destroy_node = lambda: None


def test_a_locked_orientation_pulls_and_is_let_go(make):
    rig = make(**{'force.lock_stiffness': '0.5'})
    rig.engage()
    turned = matrix_from_zxz(*np.radians((130.0, 50.0, 36.0)))
    x, y, z, w = map(float, quaternion_from_matrix(turned))
    rig.deliver('lock_orientation', Quaternion(x=-x, y=-y, z=-z, w=-w))
    output = rig.run(100, (0.0, 0.0, 0.0))
    expected = 0.5 * math.radians(6.0) * POSE[:, 2]
    np.testing.assert_allclose(output.rendered, expected, atol=2e-3)
    rig.deliver('unlock_orientation', Empty())
    np.testing.assert_allclose(rig.run(50, (0.0, 0.0, 0.0)).rendered, np.zeros(3), atol=1e-3)
    rig.deliver('hold', Empty())
    held = matrix_from_quaternion(rig.force._inputs.target)
    np.testing.assert_allclose(held, POSE, atol=2e-3)
    rig.deliver('free', Empty())
    assert rig.force._inputs.target is None
    rig.run(25)
    assert rig.text == 'ready'


def test_what_is_no_rotation_locks_nothing(make):
    rig = make()
    rig.deliver('lock_orientation', Quaternion(x=0.0, y=0.0, z=0.0, w=0.0))
    assert rig.force._inputs.target is None


def test_the_scale_of_the_force(make):
    rig = make()
    rig.engage()
    for scale, expected in ((0.5, 0.5), (7.0, 0.5), (math.nan, 0.5), (1.0, 1.0)):
        rig.deliver('force_scale', Float64(data=scale))
        output = rig.run(50, TORQUE)
        np.testing.assert_allclose(output.rendered, expected * np.array(TORQUE), atol=1e-3)


def test_the_compensation_of_weight_can_be_switched_off(make):
    rig = make(**{'force.gravity_handle': '[0.0, 0.0, 0.004]'})
    assert np.linalg.norm(rig.engage().rendered) > 0.005
    rig.deliver('use_gravity_compensation', Bool(data=False))
    np.testing.assert_allclose(
        rig.run(600, (0.0, 0.0, 0.0)).rendered, np.zeros(3), atol=1e-3)


def test_a_combination_that_cannot_work_is_refused(make):
    with pytest.raises(SettingError, match='force.without_drives.*the bus of the drives in'):
        make(**{'force.without_drives': 'false'})


def test_without_force_there_is_no_controller_and_no_topic(make):
    rig = make(**{'force.enabled': 'false'})
    assert rig.force is None
    names = {name for name, _ in rig.node.get_topic_names_and_types()}
    assert not [name for name in names if 'servo_cf' in name or 'measured_cf' in name
                or 'force' in name or 'lock' in name]
