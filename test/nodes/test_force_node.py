# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback of a hosted fkm, sample by sample, with the test as drives and clients."""

from contextlib import contextmanager
from dataclasses import dataclass, fields
from math import inf, nan, radians
from types import SimpleNamespace
from unittest import mock

from fkm_rig import angles, POSE
from geometry_msgs.msg import PoseStamped, Quaternion, WrenchStamped
from harness import SIMULATED_CHECK
from in_process import hosted
from mechanism import turn
import numpy as np
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.force import ForceLimits
from spm_haptic_master.kinematics import matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.nodes import factories
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.parameters.fkm import FORCE_SETTINGS
from spm_haptic_master.parameters.nodes import NODE_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.ros import diagnostic_status
from spm_haptic_master.ros.qos import SAMPLES
from spm_haptic_master.supervision.fault import Acknowledgement
from std_msgs.msg import Bool, Empty, Float64, String

PERIOD = 0.002
TORQUE = (0.05, -0.1, 0.15)
ZERO = (0.0, 0.0, 0.0)
# Each sensor is unchecked at first: the protection level of one pose is of all sensors.
FORCE = {
    'rate': 500.0,
    'recovery': 0.05,
    'crtk_rate': 0.0,
    'alert_limit_deg': 5.0,
    'force.enabled': 'true',
    'force.without_drives': 'true',
    'force.damping': 0.0,
    'force.protection_limit_deg': 5.0,
    'force.ramp': 0.02,
}
DRIVES = {
    'force.without_drives': False,
    'drives.channel': 'bus',
    'drives.rated_torque': [0.5],
    'drives.check_file': str(SIMULATED_CHECK),
}
BASE_DEG = [90.0, 20.0, -30.0]
HANDLE_DEG = [10.0, -40.0, 70.0]
TABLE, HANDLE = (matrix_from_zxz(*np.radians(turn)) for turn in (BASE_DEG, HANDLE_DEG))
MOUNTED = {'mounting.base_zxz_deg': BASE_DEG, 'mounting.handle_zxz_deg': HANDLE_DEG}
WRENCHES = '/servo_cf', '/spatial/servo_cf', '/body/servo_cf'


@dataclass
class FakeDrives:
    """Drives that do what they are commanded."""

    ready: bool = True
    fault: str | None = None
    torques: tuple[float, ...] = ZERO
    seconds_since_status: float = 0.001
    closed: int = 0

    def __post_init__(self):
        self.commands = []

    def step(self, torques, now):
        self.commands.append(torques)
        self.torques = torques or ZERO
        return self

    def acknowledge(self):
        self.fault = None

    def close(self):
        self.closed += 1


class Rig:
    """A hosted fkm at one pose, and a client of its force feedback."""

    def __init__(self, host):
        self.host = host
        self.teleop = 'engaged'
        self.angles = angles(POSE)
        host.publishers |= dict.fromkeys(WRENCHES, ())
        host.subscribed = lambda topic: topic.endswith(('_cf', 'measured_js'))

    def send(self, torque, topic='servo_cf', frame='', age=None, force=ZERO):
        message = WrenchStamped()
        message.header.frame_id = frame
        if age is not None:
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(
                self.host.time_ns() - round(1e9 * age), 10**9
            )
        t = message.wrench.torque
        f = message.wrench.force
        t.x, t.y, t.z = torque
        f.x, f.y, f.z = force
        self.host.give(topic, message)

    def run(self, count, torque=None, **more):
        """Run samples with a wrench each; return the state."""
        for _ in range(count):
            self.host.run(PERIOD)
            if self.teleop:
                self.host.give('teleop_state', String(data=self.teleop))
            if torque is not None:
                self.send(torque, **more)
            self.host.node.take(self.host.time_ns(), tuple(self.angles))
        return self.state

    def engage(self, **more):
        self.run(75)
        assert self.run(75, ZERO, **more) == 'engaged', self.entry
        return self

    def rendered(self, torque=TORQUE, count=50, on='spatial', **more):
        """Return the torque that is rendered of a wrench, as on a topic."""
        self.run(count, torque, **more)
        found = self.host.last(f'{on}/measured_cf').wrench.torque
        return np.array([found.x, found.y, found.z])

    @property
    def state(self):
        return self.host.node.force_state.text

    @property
    def effort(self):
        return list(self.host.last('crtk/measured_js').effort)

    def figures(self, torque=ZERO, count=60):
        """Return the figures on /diagnostics after samples: each 0.1 s they are repeated here."""
        with mock.patch.object(diagnostic_status, 'REPEAT_PERIOD', 0.1):
            self.run(count, torque)
        return str(self.host.figures('force'))

    @property
    def entry(self):
        self.host.run(1.01)
        return f'{self.host.entry("force").message} {self.host.figures("force")}'


@pytest.fixture
def drives(monkeypatch):
    found = FakeDrives()
    monkeypatch.setattr(factories, 'make_drives', lambda values: found)
    return found


@contextmanager
def running(**given):
    """Yield the rig of an fkm with settings; in names, __ stands for a dot."""
    settings = FORCE | {name.replace('__', '.'): value for name, value in given.items()}
    with hosted(Fkm, *(f'{name}:={value}' for name, value in settings.items())) as host:
        yield Rig(host)


@pytest.fixture
def rig():
    with running() as rig:
        yield rig.engage()


def test_a_wrench_becomes_motor_torques_by_the_power_balance(rig):
    """In `crtk/measured_js`: what the joints get by their speeds, the handle gets by its own."""
    np.testing.assert_allclose(rig.rendered(), TORQUE, atol=1e-3)
    effort = np.array(rig.effort)
    step = 1e-6
    assert effort[3] == 0.0
    for axis in np.eye(3):
        turned = turn(step * axis) @ POSE
        speeds = (np.array(angles(turned)) - angles(POSE)) / step
        assert effort @ speeds == pytest.approx(np.dot(TORQUE, axis), abs=1e-3)
    # The topics of the state: each once.
    assert [each.data for each in rig.host.sent['force_state']] == ['off', 'ready', 'engaged']
    assert rig.host.last('spatial/measured_cf').header.frame_id == 'spm_base'


def test_a_wrench_in_each_frame_of_a_mounted_device():
    with running(**MOUNTED) as rig:
        rig.engage()
        for topic, frame, in_base in (
            ('servo_cf', 'spm_base', np.eye(3)),
            ('servo_cf', '', TABLE.T),
            ('servo_cf', 'spm_table', TABLE.T),
            ('servo_cf', 'spm_platform', POSE),
            ('servo_cf', 'spm_handle', POSE @ HANDLE),
            ('spatial/servo_cf', 'any', TABLE.T),
            ('body/servo_cf', 'any', POSE @ HANDLE),
        ):
            rig.rendered(topic=topic, frame=frame)
            for on, of_base, name in (
                ('spatial', TABLE, 'spm_table'),
                ('body', (POSE @ HANDLE).T, 'spm_handle'),
            ):
                found = rig.rendered(
                    count=1,
                    on=on,
                    topic=topic,
                    frame=frame,
                )
                np.testing.assert_allclose(found, of_base @ in_base @ TORQUE, atol=1e-3)
                assert rig.host.last(f'{on}/measured_cf').header.frame_id == name


def test_without_a_mounting_the_handle_is_the_platform(rig):
    """And dVRK's absolute body wrench is in the frame of `orientation`."""
    for topic, frame, absolute, in_base in (
        ('servo_cf', 'spm_handle', False, POSE),
        ('body/servo_cf', '', False, POSE),
        ('body/servo_cf', '', True, np.eye(3)),
    ):
        rig.host.give('body/set_cf_orientation_absolute', Bool(data=absolute))
        np.testing.assert_allclose(
            rig.rendered(topic=topic, frame=frame), in_base @ TORQUE, atol=1e-3
        )
    assert rig.host.last('body/measured_cf').header.frame_id == 'spm_platform'


def test_an_unknown_frame_is_refused_and_named(rig):
    assert rig.run(50, TORQUE, frame='psm_base') == 'ready'
    assert not any(rig.effort)
    entry = rig.entry
    assert "in frame 'psm_base'; expected spm_base, spm_handle, spm_platform or none" in entry
    assert "'wrenches in an unknown frame': '50'" in entry


def test_a_wrench_by_its_own_stamp(rig):
    assert rig.run(50, TORQUE, age=0.005) == 'engaged'
    assert rig.run(60, TORQUE, age=0.031) == 'ready'
    assert "'wrenches too old': '60'" in rig.entry


def test_a_wrench_that_waited_while_this_process_stood_still_is_none(rig):
    rig.host.pause(10.0)
    # Whichever comes first, the message or the timer.
    rig.send(TORQUE)
    rig.host.run(0.0)
    rig.send(TORQUE)
    rig.host.run(0.005)
    rig.send(TORQUE)
    assert "'wrenches too old': '2'" in rig.entry


@pytest.mark.parametrize(
    'broken',
    [
        {'torque': (nan, 0.0, 0.0)},
        {'torque': ZERO, 'force': (inf, 0.0, 0.0)},
    ],
)
def test_a_wrench_that_is_not_finite_is_a_fault_even_between_two_samples(rig, broken):
    rig.send(**broken)
    assert rig.run(1, TORQUE) == 'fading: wrench not finite'
    assert rig.run(20, TORQUE) == 'fault: wrench not finite'
    # CRTK's `warning` has it once.
    assert [each.data for each in rig.host.sent['warning']] == [
        'force feedback: fault: wrench not finite'
    ]
    acknowledged = [rig.host.call('~/acknowledge').success for _ in range(2)]
    assert acknowledged == [True, False]
    rig.engage()


def publish_wrenches(rig, *publishers):
    """Have wrenches published by (process, node, topic) alone."""
    rig.host.publishers |= {
        topic: tuple(node for _, node, its_topic in publishers if its_topic == topic)
        for topic in WRENCHES
    }
    rig.host.node.get_publishers_info_by_topic = lambda topic: [
        SimpleNamespace(
            node_name=node,
            node_namespace='/',
            endpoint_gid=f'{process:12}{topic}'.encode(),
            qos_profile=SAMPLES,
            topic_type='geometry_msgs/msg/WrenchStamped',
        )
        for process, node, its_topic in publishers
        if its_topic == topic
    ]


def test_one_node_may_publish_wrenches_on_each_topic(rig):
    publish_wrenches(rig, *(('process', 'one', topic) for topic in WRENCHES))
    assert rig.run(150, TORQUE) == 'engaged'


@pytest.mark.parametrize(
    ('second', 'names'),
    [
        (('process', 'other', '/body/servo_cf'), '/one, /other'),
        (('process', 'one', '/servo_cf'), '/one'),
        # A name is not unique: two processes are two sources, also on two topics.
        (('another', 'one', '/body/servo_cf'), '/one, /one'),
    ],
)
def test_a_second_source_of_wrenches_is_a_fault(rig, second, names):
    publish_wrenches(rig, ('process', 'one', '/servo_cf'), second)
    rig.run(150, TORQUE)
    assert rig.state == 'fault: two sources of the wrench'
    assert f'wrenches from {names}; expected one node' in rig.entry


@pytest.mark.parametrize(
    ('state', 'first', 'then'),
    [
        ('disengaged: no presence', 'fading: no hand on the handle', 'ready'),
        ('disengaged: waiting for enable', 'fading: teleoperation not engaged', 'ready'),
        ('other words', 'fading: teleoperation not engaged', 'ready'),
        ('clutched', 'holding', 'holding'),
    ],
)
def test_what_teleop_says(rig, state, first, then):
    rig.teleop = state
    assert rig.run(1, TORQUE) == first
    assert rig.run(25, TORQUE) == then
    assert not any(rig.effort)


def test_a_teleop_that_falls_silent_is_nobodys(rig):
    rig.teleop = ''
    assert rig.run(250, TORQUE) == 'engaged'
    assert rig.run(100, TORQUE) == 'ready'


def test_the_operating_state_may_engage():
    with running(force__engaged_by='operating_state') as rig:
        assert not any('teleop_state' in each.topic_name for each in rig.host.node.subscriptions)
        rig.teleop = ''
        assert rig.run(100, ZERO) == 'off'
        assert rig.host.entry('force').message == 'off; disabled'
        assert rig.host.call('enable').success
        assert rig.run(75, ZERO) == 'engaged'
        rig.host.call('disable')
        assert rig.run(25, TORQUE) == 'off'


def test_a_sample_that_is_withheld_ends_force(rig):
    rig.angles[3] += 0.05
    assert rig.run(1, TORQUE) == 'fading: no orientation'
    assert rig.run(20, TORQUE) == 'fault: no orientation'


def test_samples_that_stop_end_force_within_25_ms(drives):
    """Nothing calls the node then but its timer, every 5 ms."""
    with running() as rig:
        rig.engage().run(50, TORQUE)
        assert any(drives.commands[-1])
        rig.host.run(0.02)
        assert rig.state == 'fading: no orientation'
        drives.commands.clear()
        rig.host.run(0.025)
        assert len(drives.commands) == 5
        assert drives.commands[-1] is None
        assert rig.state == 'fault: no orientation'


def test_a_pause_of_the_whole_process_is_no_missing_sample(rig):
    """Its timers run once then, and the samples that have waited come."""
    for _ in range(20):
        rig.host.pause(0.012)
        assert rig.run(5, TORQUE) == 'engaged'


def test_drives_are_commanded_and_their_faults_are_ours(drives):
    drives.ready = False
    with running() as rig:
        rig.run(100, ZERO)
        assert rig.state == 'off'
        assert drives.commands[-1] == ZERO
        assert "'drives': 'not in operation'" in rig.entry
        drives.ready = True
        rig.engage().run(50, TORQUE)
        assert any(drives.commands[-1])
        assert rig.effort[:3] == list(drives.commands[-1])
        drives.fault = 'drive 2: overcurrent'
        assert rig.run(5, TORQUE) == 'fault: fault of a drive'
        assert drives.commands[-1] is None
        rig.host.run(0.01)
        assert rig.host.last('warning').data.endswith('drive; drive 2: overcurrent')
        assert rig.host.call('~/acknowledge').success
        assert drives.fault is None
        rig.engage()
    assert drives.closed == 1


def tilted(rig, phi_deg):
    """Turn the handle about its own axis."""
    rig.angles = angles(matrix_from_zxz(*np.radians((130.0, 50.0, phi_deg))))


def lock_at(phi_deg):
    """Return the message of a locked orientation."""
    found = quaternion_from_matrix(matrix_from_zxz(*np.radians((130.0, 50.0, phi_deg))))
    x, y, z, w = map(float, found)
    return Quaternion(x=x, y=y, z=z, w=w)


def test_a_locked_orientation_pulls_and_is_let_go():
    with running(force__lock_stiffness=0.5) as rig:
        rig.engage()
        target = lock_at(36.0)
        opposite = Quaternion(
            x=-target.x,
            y=-target.y,
            z=-target.z,
            w=-target.w,
        )
        for quaternion in (target, opposite, Quaternion(w=0.0)):
            # One that is no rotation changes nothing.
            rig.host.give('lock_orientation', quaternion)
            pull = 0.5 * radians(6.0) * POSE[:, 2]
            np.testing.assert_allclose(rig.rendered(ZERO, 150), pull, atol=2e-3)
        for topic, away in (('unlock_orientation', 0.0), ('hold', 2.0)):
            rig.host.give(topic, Empty())
            for phi in np.linspace(30.0, 30.0 + away, 40):
                tilted(rig, phi)
                rig.run(1, ZERO)
            pull = -0.5 * radians(away) * POSE[:, 2]
            np.testing.assert_allclose(rig.rendered(ZERO), pull, atol=2e-3)
        rig.host.give('free', Empty())
        assert rig.run(20) == 'ready'
        assert "'orientation locked': 'no'" in rig.entry


def test_a_lock_holds_without_wrenches_while_the_clutch_is_pressed():
    """K2: dVRK sends none then; from `ready` on. Its release ends the lock."""
    with running() as rig:
        rig.teleop = 'clutched'
        assert rig.run(150) == 'ready'
        rig.host.give('hold', Empty())
        rig.run(20)
        for phi in np.linspace(30.0, 33.0, 40):
            tilted(rig, phi)
            rig.run(1)
        assert rig.run(50) == 'holding'
        pull = -radians(3.0) * POSE[:, 2]
        felt = rig.host.last('spatial/measured_cf').wrench.torque
        np.testing.assert_allclose((felt.x, felt.y, felt.z), pull, atol=3e-3)
        assert "'orientation locked': 'yes'" in rig.figures(None, 510)
        rig.teleop = 'engaged'
        assert rig.run(60) == 'ready'
        assert not any(rig.effort)
        assert "'orientation locked': 'no'" in rig.figures(None)


def end_by_teleop(rig):
    rig.teleop = 'disengaged: waiting for enable'
    rig.run(20, ZERO)


def end_by_fault(rig):
    rig.send((nan, 0.0, 0.0))
    rig.run(20, ZERO)


def end_by_wrenches(rig):
    """Let wrenches come again, without which the lock held."""
    assert rig.run(40) == 'holding'
    assert rig.run(20, ZERO) == 'engaged'


@pytest.mark.parametrize(
    'end',
    [
        end_by_teleop,
        end_by_fault,
        end_by_wrenches,
        lambda rig: rig.host.give('move_cp', PoseStamped()),
        lambda rig: rig.host.give('unlock_orientation', Empty()),
        lambda rig: rig.host.give('free', Empty()),
    ],
)
def test_what_ends_a_lock(rig, end):
    """K2."""
    rig.host.give('lock_orientation', lock_at(32.0))
    assert "'orientation locked': 'yes'" in rig.figures()
    assert rig.state == 'engaged'
    end(rig)
    assert "'orientation locked': 'no'" in rig.figures()


MODES = [
    ('force_scale', Float64(data=0.5), "'force scale': '0.5'", "'force scale': '1'"),
    (
        'use_gravity_compensation',
        Bool(data=False),
        "'weight compensated': 'no'",
        "'weight compensated': 'yes'",
    ),
    (
        'body/set_cf_orientation_absolute',
        Bool(data=True),
        "'body/servo_cf in the frame of orientation': 'yes'",
        "'body/servo_cf in the frame of orientation': 'no'",
    ),
    (
        'lock_orientation',
        lock_at(30.0),
        "'orientation locked': 'yes'",
        "'orientation locked': 'no'",
    ),
]


@pytest.mark.parametrize(('topic', 'message', 'given', 'usual'), MODES)
def test_a_mode_ends_with_its_publisher(rig, topic, message, given, usual):
    """A6."""
    publishers = rig.host.publishers
    publishers['/' + topic] = ('client',)
    rig.host.give(topic, message)
    assert given in rig.figures()
    # One that comes later has not set it: the publishers are counted each second.
    publishers['/' + topic] = ('later',)
    assert usual in rig.figures(count=510)


@pytest.mark.parametrize(('topic', 'message', 'given', 'usual'), MODES)
def test_a_mode_ends_with_off(topic, message, given, usual):
    """A6."""
    with running(force__engaged_by='operating_state') as rig:
        rig.teleop = ''
        rig.run(20)
        rig.host.call('enable')
        rig.engage()
        rig.host.give(topic, message)
        assert given in rig.figures()
        rig.host.call('disable')
        assert rig.run(300, ZERO) == 'off'
        assert usual in rig.figures()


def test_hold_without_an_orientation_is_refused_aloud(capfd):
    """K2."""
    with running() as rig:
        rig.host.give('hold', Empty())
        assert "'orientation locked': 'no'" in rig.entry
    assert 'hold is refused: there is no orientation to hold' in capfd.readouterr().err


def test_one_acknowledgement_ends_only_what_it_names(rig):
    """A7: a fault of the sensors and one of the force wait for one each."""
    rig.send((nan, 0.0, 0.0))
    rig.run(20, ZERO)
    latched = iter(['two encoders', '', ''])
    rig.host.node._supervisor.latch.acknowledge = lambda: Acknowledgement(next(latched), '')
    answers = [rig.host.call('~/acknowledge') for _ in range(3)]
    assert [answer.message for answer in answers] == [
        'acknowledged: sensors: two encoders',
        'acknowledged: force feedback: wrench not finite',
        'no fault waits for an acknowledgement',
    ]
    assert [answer.success for answer in answers] == [True, True, False]


@pytest.mark.parametrize('late', [0.0, 0.002, 0.02])
def test_a_repeated_or_older_stamp_reaches_no_force(drives, late):
    """A10: no torque changes, and no frame goes out."""
    with running() as rig:
        rig.engage().run(50, TORQUE)
        before = list(drives.commands)
        rig.host.node.take(rig.host.time_ns() - round(1e9 * late), tuple(rig.angles))
        assert drives.commands == before
        assert rig.run(20, TORQUE) == 'engaged'


def test_the_scale_of_the_force(rig):
    for scale, expected in ((0.5, 0.5), (7.0, 0.5), (nan, 0.5), (1.0, 1.0)):
        rig.host.give('force_scale', Float64(data=scale))
        np.testing.assert_allclose(rig.rendered(), expected * np.array(TORQUE), atol=1e-3)


@pytest.mark.parametrize('weight', [0.0, 0.004])
def test_the_weight_is_held_until_that_is_switched_off(weight):
    with running(force__gravity_handle=[0.0, 0.0, weight]) as rig:
        rig.engage()
        # The handle's centre of mass lies on its axis.
        expected = np.cross(POSE @ [0.0, 0.0, weight], [0.0, 0.0, 9.80665])
        np.testing.assert_allclose(rig.rendered(ZERO), expected, atol=1e-3)
        rig.host.give('use_gravity_compensation', Bool(data=False))
        np.testing.assert_allclose(rig.rendered(ZERO), ZERO, atol=1e-3)


def values(**given):
    return complete(NODE_SETTINGS['fkm'], {'crtk_rate': 0.0, **given})


def test_the_defaults_are_those_of_the_limits():
    assert factories.limits_from(values()) == ForceLimits()


NUMBERS = [each for each in FORCE_SETTINGS if each.kind is float and each.count is None]


@pytest.mark.parametrize('setting', NUMBERS, ids=lambda setting: setting.name)
def test_each_number_is_one_of_the_limits(setting):
    """One without a field of ForceLimits would be accepted and have no effect."""
    limits = factories.limits_from(values(**{setting.name: 0.9 * setting.default}))
    defaults = ForceLimits()
    changed = {
        field.name: getattr(limits, field.name) / getattr(defaults, field.name)
        for field in fields(ForceLimits)
        if getattr(limits, field.name) != getattr(defaults, field.name)
    }
    assert [*changed.values()] == [pytest.approx(0.9)], changed


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({'force.sigma_full': 0.05}, r'force.sigma_full.*0.05.*above force.sigma_off \(0.05\)'),
        (
            {'force.small_torque': 0.4},
            r'force.small_torque.*0.4.*at most force.torque_limit \(0.3',
        ),
        ({'rate': 200.0}, r"'rate' is 200.*at least 250 Hz with force.enabled"),
        ({'force.without_drives': False}, 'force.without_drives.*the bus of the drives in'),
        ({**DRIVES, 'force.without_drives': True}, 'force.without_drives.*True.*not both'),
        ({'crtk_rate': 200.0}, "'crtk_rate' is 200.*expected 0 with force.without_drives"),
        ({**DRIVES, 'drives.node_id': [11, 12]}, r'drives.node_id.*\[11, 12\].*3 drives \(force'),
        (
            {**DRIVES, 'drives.torque_limit': 0.4},
            r'drives.torque_limit.*0.4.*at least force.motor',
        ),
    ],
)
def test_settings_that_contradict_each_other_are_refused(given, words):
    with pytest.raises(SettingError, match=words):
        factories.make_motors(values(**{'force.without_drives': True, **given}))
    # Equal limits and as many drives as motors are none.
    for fine in (
        {'force.without_drives': True, 'rate': 250.0, 'force.small_torque': 0.3},
        {
            **DRIVES,
            'drives.interface': 'virtual',
            'drives.torque_limit': 0.5,
        },
    ):
        drives = factories.make_motors(values(**fine))[1]
        assert drives is None or drives.motors == 3


def test_without_force_there_is_no_controller_and_no_topic():
    with running(force__enabled=False) as rig:
        assert rig.host.node.force_state is None
        assert not [
            each
            for each in (*rig.host.node.subscriptions, *rig.host.node.publishers)
            if any(word in each.topic_name for word in ('_cf', 'force', 'lock'))
        ]
