# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Levels by hysteresis, and dexterity from the latest orientation only."""

from built_mechanism import random_built
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import QuaternionStamped
from harness import stamp
from in_process import hosted
import numpy as np
import pytest
from rclpy.parameter import Parameter
from spm_haptic_master import kinematics
from spm_haptic_master.kinematics.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics.workspace import nearness
from spm_haptic_master.nodes.diagnostics import Diagnostics, Levels
from spm_haptic_master.parameters.geometry import mechanism_checksum, mounting_from
from spm_haptic_master.parameters.nodes import DIAGNOSTICS_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.simulation import trajectories
from std_msgs.msg import String

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
THRESHOLDS = {
    'dexterity_warn': 0.06,
    'dexterity_error': 0.03,
    'dexterity_hysteresis': 0.1,
}


@pytest.mark.parametrize(
    ('etas', 'expected'),
    [
        ([0.07, 0.06, 0.059, 0.065, 0.067], [OK, OK, WARN, WARN, OK]),
        ([0.03, 0.029, 0.032, 0.034, 0.0299], [WARN, ERROR, ERROR, WARN, ERROR]),
        ([0.0, 0.065, 0.1], [ERROR, WARN, OK]),
    ],
)
def test_levels_are_entered_below_and_left_above(etas, expected):
    """Of the sensors in use, and of the three active joints where those in use are enough."""
    texts = {
        OK: 'clear of singularities',
        WARN: 'near a parallel singularity; the sensors in use cover it',
        ERROR: 'at a parallel singularity; the sensors in use cover it',
    }
    along = Levels(THRESHOLDS)
    covered = Levels(THRESHOLDS)
    for eta, level in zip(etas, expected, strict=True):
        text = along.take(0.2, eta)
        assert along.level == level
        assert (
            text
            == {
                **texts,
                WARN: 'near a singularity of the sensors in use',
                ERROR: 'at a singularity of the sensors in use',
            }[level]
        )
        assert (covered.take(eta, 0.3), covered.level) == (texts[level], OK)


@pytest.mark.parametrize(
    'trajectory', [trajectories.sweep(np.radians(20.0)), trajectories.hand, trajectories.fig9]
)
def test_two_minutes_of_a_healthy_device_are_ok(trajectory):
    """The fourth sensor copes with the singularity, which the message reports all the same."""
    along = Levels(complete(DIAGNOSTICS_SETTINGS, {}))
    crossings = set()
    for seconds in np.arange(0.0, 120.0, 0.4):
        quaternion = kinematics.quaternion_from_matrix(
            kinematics.matrix_from_zxz(*trajectory(seconds))
        )
        found = nearness(tuple(quaternion.tolist()), kinematics.Geometry(), (1, 1, 1))
        crossings.add(along.take(found.three, found.every))
        assert along.level == OK, seconds
    assert len(crossings) == 3


def orientation(quaternion, when):
    message = QuaternionStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(when, 10**9)
    q = message.quaternion
    q.x, q.y, q.z, q.w = (float(each) for each in quaternion)
    return message


def turned(phi):
    """Return the quaternion of the centre of the workspace, turned by phi, deg."""
    return kinematics.quaternion_from_matrix(
        kinematics.matrix_from_zxz(*np.radians([135.0, 54.7356, phi]))
    )


@pytest.fixture
def device():
    """Give a hosted node; `show` gives it an orientation and lets it evaluate that."""
    with hosted(Diagnostics, 'joint_states_rate:=200.0', subscribes=True) as host:

        def show(quaternion):
            host.give('orientation', orientation(quaternion, host.time_ns()))
            host.run(0.1)
            entry = host.entry('singularity')
            return entry.level, entry.message.partition(';')[0]

        host.show = show
        yield host


def test_the_level_is_that_of_the_sensors_in_use(device):
    # Four sensors cope; the figure and the message are those of the three motor joints.
    found = []
    for phi, text in (
        (20.0, 'clear of singularities'),
        (53.5, 'near a parallel singularity'),
        (49.36, 'at a parallel singularity'),
    ):
        assert device.show(turned(phi)) == (OK, text)
        found.append(device.last('dexterity').data[0])
    far, near, at = found
    assert far > 0.059 > near > 0.033 > at
    figures = device.figures('singularity')
    assert figures['mechanism'] == mechanism_checksum(complete(DIAGNOSTICS_SETTINGS, {}))
    assert float(figures['singularity at (deg)']) < 0.01
    # Without the fourth they do not; a sensor that there is not changes nothing.
    for text, phi, level, words in (
        ('degraded: joint_3b missing', 20.0, OK, 'clear of singularities'),
        ('degraded: joint_3a excluded', 49.36, ERROR, 'at a singularity of the sensors in use'),
        ('degraded: joint_3a excluded', 53.5, WARN, 'near a singularity of the sensors in use'),
        ('healthy', 49.36, OK, 'at a parallel singularity'),
    ):
        device.give('state', String(data=text))
        assert device.show(turned(phi)) == (level, words)
        figures = device.figures('singularity')
        with_all = figures[
            'dexterity of 4 sensors' if 'joint_3a' not in text else 'dexterity of 3 sensors'
        ]
        assert figures['dexterity of the sensors in use'] == with_all
    # Words of another program: nobody knows which sensors are in use.
    device.give('state', String(data='degraded joint_3a'))
    device.sent['dexterity'].clear()
    device.sent['joint_states'].clear()
    assert device.show(turned(20.0)) == (ERROR, "silent: unknown state 'degraded joint_3a'")
    assert not device.sent['dexterity']
    assert not device.sent['joint_states']
    device.give('state', String(data='healthy'))
    assert device.show(turned(20.0)) == (OK, 'clear of singularities')


def test_neither_an_old_orientation_nor_one_that_is_none_is_shown(device):
    device.run(0.2)
    assert device.entry('singularity').message == 'starting: no orientation yet'
    device.show(turned(20.0))
    device.run(3.0)
    assert device.entry('singularity').level == ERROR
    assert device.entry('singularity').message == 'no orientation'
    assert len(device.sent['dexterity']) == len(device.sent['joint_states']) == 1
    for quaternion, words in (
        ((1.0, 0.0, 0.0, 0.0), 'outside the working mode'),
        ((0.0, 0.0, 0.0, 2.0), 'is not a unit quaternion'),
        ((0.0, 0.0, 0.0, float('nan')), 'is not a unit quaternion'),
    ):
        level, text = device.show(quaternion)
        assert level == ERROR
        assert words in text
        assert device.node.dexterities is None
    assert len(device.sent['dexterity']) == len(device.sent['joint_states']) == 1
    device.show(turned(20.0))
    assert len(device.sent['dexterity']) == len(device.sent['joint_states']) == 2


def test_live_thresholds_are_used_and_those_that_contradict_are_refused(device):
    def change(name, value):
        return device.node.set_parameters_atomically([Parameter(name, value=value)])

    device.give('state', String(data='degraded: joint_3a excluded'))
    assert device.show(turned(53.5))[0] == WARN
    assert change('dexterity_error', 0.059).successful
    assert device.show(turned(53.5))[0] == ERROR
    assert "'dexterity_error' is 0.3" in change('dexterity_error', 0.3).reason
    assert not change('dexterity_warn', -1.0).successful


def test_all_nine_joints_are_those_of_the_orientation():
    """Of the mechanism as built; and the joints know no table."""
    built = random_built(np.random.default_rng(3), 0.2)
    given = {
        'geometry.base_axes': built.base.ravel().tolist(),
        'geometry.platform_axes': built.platform.ravel().tolist(),
        'geometry.proximal_deg': np.degrees(built.alpha).tolist(),
        'geometry.distal_deg': np.degrees(built.beta).tolist(),
        'mounting.base_zxz_deg': [90.0, 0.0, 0.0],
        'mounting.handle_zxz_deg': [0.0, 30.0, 0.0],
    }
    mounting = mounting_from(given)
    with hosted(
        Diagnostics,
        'sensors:=6',
        *(f'{name}:={value}' for name, value in given.items()),
        subscribes=True,
    ) as host:
        for phi in np.linspace(10.0, 60.0, 20):
            quaternion = tuple(turned(phi).tolist())
            when = host.time_ns()
            host.give('orientation', orientation(mounting.mounted(quaternion), when))
            host.run(0.1)
            assert host.last('dexterity').layout.dim[0].label == (
                'dexterity of 3 sensors (th1A th1B th1C), of 6 sensors (+ th3A th3B th3C)'
            )
            message = host.last('joint_states')
            assert stamp(message) == when
            assert message.name == list(MECHANISM_JOINT_NAMES)
            # Each leg carries the platform there: by formulas of the tests' own.
            for k in range(3):
                carried = built.chain(k, *message.position[3 * k : 3 * k + 3])
                assert np.abs(carried - kinematics.matrix_from_quaternion(quaternion)).max() < 1e-9
        host.subscribed = lambda topic: topic != 'joint_states'
        shown = len(host.sent['joint_states'])
        host.give('orientation', orientation(mounting.mounted(quaternion), when))
        host.run(0.1)
        assert len(host.sent['joint_states']) == shown


@pytest.mark.parametrize('topic', ['orientation', 'measured_js'])
def test_two_publishers_are_named_and_nothing_goes_out(device, topic):
    device.publishers[f'/{topic}'] = 'one', 'other'
    device.run(0.3)
    assert device.show(turned(20.0)) == (ERROR, f'2 publishers on /{topic}: /one, /other')
    assert not device.sent['dexterity']
    assert not device.sent['joint_states']
    device.publishers.clear()
    device.run(0.3)
    assert device.show(turned(20.0)) == (OK, 'clear of singularities')
    assert device.sent['dexterity']
    assert device.sent['joint_states']
