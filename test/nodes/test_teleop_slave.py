# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `teleop` makes of a slave's own messages, as dVRK and others publish them."""

from dataclasses import dataclass, field
import sys
import types

from geometry_msgs.msg import WrenchStamped
from mechanism import turn
import numpy as np
import pytest
from std_msgs.msg import Header, String
from teleop_rig import running


@dataclass(slots=True)
class OperatingState:
    """As in crtk_msgs."""

    header: Header = field(default_factory=Header)
    state: str = ''
    is_homed: bool = False
    is_busy: bool = False


@pytest.fixture
def rig():
    with running() as rig:
        yield rig


# K1: an invalid pose has the stamp 0


def test_k1_a_pose_with_stamp_0_is_none_to_engage_on(rig):
    rig.slave_stamp = 0
    rig.slave_goes_on = False
    rig.press('presence', True)
    rig.run(20)
    assert rig.state == 'disengaged: no pose of the slave'
    assert not rig.host.call('~/enable').success
    rig.run(20)
    assert rig.commands == []


def test_k1_a_pose_that_becomes_invalid_ends_it_at_once(rig):
    """The bridge goes on publishing: identity, position 0, stamp 0."""
    rig.engage()
    count = len(rig.commands)
    rig.slave = np.eye(3)
    rig.tip = (0.0, 0.0, 0.0)
    rig.slave_stamp = 0
    rig.slave_goes_on = False
    rig.run(10)
    assert len(rig.commands) == count
    assert rig.state == 'disengaged: no pose of the slave'


def test_k1_a_slave_that_never_stamps_is_followed_where_a_parameter_says_so():
    with running(teleop__slave_without_stamps=True) as rig:
        rig.slave_stamp = 0
        rig.slave_goes_on = False
        rig.engage()
        assert rig.commands


# K4: sign and frame of the torque

TORQUE = np.array([0.2, -0.1, 0.3])
FORCE = np.array([1.0, 2.0, -3.0])


def give_torque(rig, frame='', seconds=7):
    """Publish the slave's torque; return what went on to the hand, and its stamp."""
    felt = rig.host.sent['spatial/servo_cf']
    felt.clear()
    message = WrenchStamped()
    message.header.frame_id = frame
    message.header.stamp.sec = seconds
    torque = message.wrench.torque
    force = message.wrench.force
    torque.x, torque.y, torque.z = TORQUE.tolist()
    force.x, force.y, force.z = FORCE.tolist()
    rig.run(1)
    rig.host.give('slave/measured_cf', message)
    if not felt:
        return None
    (found,) = felt
    assert found.wrench.force.x == 0.0
    assert found.header.stamp.sec == seconds
    return np.array([found.wrench.torque.x, found.wrench.torque.y, found.wrench.torque.z])


@pytest.mark.parametrize(
    ('frame', 'about_the_tip'),
    [
        ('base', lambda rig: TORQUE),
        # body/measured_cf of dVRK.
        ('tool', lambda rig: rig.slave @ TORQUE),
        # spatial/measured_cf of dVRK: with the lever from the base to the tip.
        ('spatial', lambda rig: TORQUE - np.cross(rig.tip, FORCE)),
    ],
)
@pytest.mark.parametrize('scale', [0.5, -0.5])
def test_k4_the_torque_is_felt_as_its_frame_and_sign_say(frame, about_the_tip, scale):
    """The slave's base is turned by 90 deg about z."""
    with running(
        teleop__force_scale=scale,
        teleop__force_frame=frame,
        teleop__registration_zxz_deg=[90.0, 0.0, 0.0],
    ) as rig:
        rig.engage()
        expected = scale * turn([0.0, 0.0, -0.5 * np.pi]) @ about_the_tip(rig)
        np.testing.assert_allclose(give_torque(rig, 'psm_base'), expected, atol=1e-12)


def test_k4_a_torque_goes_to_the_hand_while_engaged_and_else_nothing():
    with running(teleop__force_scale=0.5) as rig:
        assert give_torque(rig) is None
        rig.engage()
        assert give_torque(rig) is not None
        assert give_torque(rig, 'psm_tool') is None
        rig.press('clutch', True)
        assert give_torque(rig) is None
        assert rig.state == 'clutched'
        rig.press('presence', False)
        assert give_torque(rig) is None
        assert rig.state.startswith('disengaged')


@pytest.mark.parametrize('accepted', [False, True])
def test_k1_a_torque_with_stamp_0_is_none(accepted):
    with running(teleop__force_scale=0.5, teleop__slave_without_stamps=accepted) as rig:
        rig.engage()
        found = give_torque(rig, seconds=0)
        assert (found is not None) is accepted
        rig.host.run(1.0)
        assert rig.host.figures('teleop')['torques that are invalid'] == str(int(not accepted))


# K6: a pedal that publishes its changes alone


@pytest.mark.parametrize(
    ('timeout', 'state'),
    [
        (0.5, 'disengaged: no presence'),
        (0.0, 'engaged'),
    ],
)
def test_k6_a_pedal_that_publishes_changes_leads_with_its_parameter(timeout, state):
    with running(teleop__presence_timeout=timeout) as rig:
        rig.engage()
        rig.run(100)
        assert rig.state == state


# K7: the slave's own operating state


@pytest.fixture
def crtk_msgs(monkeypatch):
    monkeypatch.setitem(sys.modules, 'crtk_msgs', types.ModuleType('crtk_msgs'))
    monkeypatch.setitem(
        sys.modules, 'crtk_msgs.msg', types.SimpleNamespace(OperatingState=OperatingState)
    )


@pytest.mark.parametrize(
    ('state', 'is_homed', 'why'),
    [
        ('DISABLED', False, 'slave DISABLED'),
        ('FAULT', True, 'slave FAULT'),
        ('ENABLED', False, 'slave not homed'),
        ('', False, 'slave without a state'),
    ],
)
def test_k7_a_slave_that_its_console_disables_is_not_followed(crtk_msgs, state, is_homed, why):
    """It goes on publishing where it is: without its state the offset would grow."""
    with running() as rig:
        hear = rig.host.callbacks['slave/operating_state']
        hear(OperatingState(state='ENABLED', is_homed=True))
        rig.engage()
        hear(OperatingState(state=state, is_homed=is_homed))
        assert rig.sends_nothing(turning=(0.0, 0.0, 0.02))
        assert rig.state == f'disengaged: {why}'
        assert rig.host.call('~/enable').message == why
        hear(OperatingState(state='ENABLED', is_homed=True))
        assert rig.sends_nothing()
        assert rig.state == f'disengaged: waiting for enable, after: {why}'
        rig.engage()


# The force feedback of the master


@pytest.mark.parametrize('text', ['fault: handle too fast', 'off'])
@pytest.mark.parametrize(('loss', 'holds'), [('hold', True), ('follow', False)])
def test_a_slave_is_held_while_the_force_is_lost_or_goes_on(text, loss, holds):
    with running(teleop__force_loss=loss) as rig:

        def tell(state):
            rig.host.nodes[0].resolve_topic_name('force_state')
            rig.host._deliver('/force_state', String(data=state))

        # The weight is borne in `ready`; a wrench that is missing fades alone.
        for state in ('off', 'ready'):
            tell(state)
        rig.engage()
        for state in ('engaged', 'fading: wrench missing or too old', 'ready'):
            tell(state)
            rig.run(5)
            assert rig.state == 'engaged'
        tell(text)
        rig.run(5)
        assert (rig.state == 'engaged') is not holds
        if holds:
            assert f'force: {text}' in rig.state
            tell('ready')
            assert rig.sends_nothing()
            rig.engage()
