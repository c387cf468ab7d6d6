# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node `teleop` with a test in the place of the master, the slave and the surgeon."""

from harness import stamp
from mechanism import zxz
import numpy as np
import pytest
from sensor_msgs.msg import Joy
from spm_haptic_master.ros.duplicate_publishers import CURE
from std_msgs.msg import UInt64
from teleop_rig import POSITION, running


@pytest.fixture
def rig():
    with running() as rig:
        yield rig


def test_it_follows_by_the_law_in_the_frame_and_at_the_position_of_the_slave():
    """The slave's base is turned by 90 deg about z."""
    registration = zxz(0.5 * np.pi, 0.0, 0.0)
    with running(teleop__registration_zxz_deg=[90.0, 0.0, 0.0]) as rig:
        rig.run(10)
        assert rig.state == 'disengaged: no presence'
        rig.press('presence', True)
        rig.run(10)
        assert rig.state.startswith('disengaged: waiting for enable')
        assert rig.commands == []
        assert rig.twists == []
        rig.engage()
        master = rig.master
        slave = rig.slave
        before = len(rig.commands)
        rig.run(15, turning=(0.004, -0.002, 0.001))
        assert len(rig.commands) == before + 15
        for message, got in zip(rig.commands, rig.matrices, strict=True):
            # Each by its own orientation, of which it has the stamp.
            hand = rig.sent[stamp(message)] @ master.T
            np.testing.assert_allclose(
                got, registration @ hand @ registration.T @ slave, atol=1e-12
            )
            assert message.header.frame_id == 'psm_base'
            p = message.pose.position
            assert (p.x, p.y, p.z) == POSITION
        rig.host.run(1.0)
        figures = rig.host.figures('teleop')
        assert figures['engaged or clutched off (times)'] == '1'
        assert float(figures['angle from master to slave (deg)']) > 1.0


def second_publisher(topic):
    def end(rig):
        rig.host.publishers[f'/{topic}'] = 'one', 'other'
        rig.run(23)

    return end, f'2 publishers on /{topic}: /one, /other; {CURE}'


@pytest.mark.parametrize(
    ('end', 'reason'),
    [
        (lambda rig: rig.tell('silent: solver failed'), 'silent: solver failed'),
        (lambda rig: rig.tell('healthy again'), "silent: unknown state 'healthy again'"),
        *(
            (lambda rig, joy=joy: rig.host.give('presence', joy), 'no presence')
            for joy in (Joy(), Joy(buttons=[2]), Joy(buttons=[-1, 1]))
        ),
        *map(
            second_publisher,
            ('slave/measured_cp', 'orientation', 'state', 'enabled_at', 'servo_cp'),
        ),
        (lambda rig: setattr(rig.host.node._inputs, 'unheard', lambda: 'not heard'), 'not heard'),
        (lambda rig: setattr(rig, 'frame', 'camera'), 'another frame of the slave'),
        # As a bridge does that has lost its slave.
        (lambda rig: setattr(rig, 'slave_goes_on', False), 'no pose of the slave'),
        (lambda rig: setattr(rig, 'level', 0.6), 'protection level above the limit'),
        (lambda rig: rig.run(30, turning=(0.0, 0.0, 0.02)), 'the slave does not follow'),
    ],
)
def test_what_ends_it_ends_it_until_enable(end, reason):
    with running(teleop__protection_limit_deg=0.5, teleop__tracking_limit_deg=20.0) as rig:
        rig.level = 0.4
        rig.engage()
        end(rig)
        rig.run(30)
        assert rig.sends_nothing()
        waits = 'waiting for enable, after: '
        assert rig.state.replace(waits, '') == f'disengaged: {reason}', rig.state
        assert rig.host.entry('teleop').message == rig.state


def test_the_clutch_and_the_presence(rig):
    rig.engage()
    rig.press('clutch', True)
    assert rig.sends_nothing(turning=(0.0, 0.0, 0.02))
    assert rig.state == 'clutched'
    count = len(rig.commands)
    rig.press('clutch', False)
    rig.run(5)
    np.testing.assert_allclose(rig.matrices[count], rig.slave, atol=1e-12)
    rig.press('presence', False)
    assert rig.sends_nothing()
    rig.press('presence', True)
    assert rig.sends_nothing()
    assert rig.state == 'disengaged: waiting for enable, after: no presence'
    rig.engage()
    assert rig.host.call('~/disable').success
    assert rig.sends_nothing()


@pytest.mark.parametrize('ends', [True, False])
def test_a_pedal_that_ends_or_hangs_while_pressed_ends_it(ends):
    with running(teleop__presence_timeout=0.5) as rig:
        # It takes 0.4 s, in which the pedal is silent.
        rig.engage()
        if ends:
            rig.host.restart_publisher('presence')
        rig.run(1 if ends else 15)
        assert rig.state == 'disengaged: no presence'
        assert rig.sends_nothing()


def test_a_clutch_stays_pressed_until_it_is_released_or_ends(rig):
    rig.engage()
    rig.press('clutch', True)
    # A message without a button is no release.
    rig.host.give('clutch', Joy())
    rig.run(100)
    assert rig.state == 'clutched'
    rig.host.restart_publisher('clutch')
    rig.run(1)
    assert rig.state == 'disengaged: waiting for enable, after: clutch gone while pressed'
    # It counts as released.
    rig.engage()


@pytest.mark.parametrize(('given', 'frame'), [("''", 'psm_base'), ('wrist', 'wrist')])
def test_the_twist_continues_to_zero_and_stops(given, frame):
    """In the frame of the slave, or in that given, as the commands."""
    with running(teleop__acceleration_limit=20.0, teleop__frame_id=given) as rig:
        rig.engage()
        rig.run(30, turning=(0.0, 0.003, 0.0))
        # It fades from two and a half periods without a command on.
        count = len(rig.twists)
        rig.host.run(0.01)
        assert len(rig.twists) == count
        rig.host.run(0.02)
        assert len(rig.twists) > count
        rig.press('presence', False)
        rig.host.run(0.5)
        rates = [message.twist.angular.y for message in rig.twists]
        assert max(rates) > 0.1
        assert rates[-4:] == [0.0] * 4
        assert {message.header.frame_id for message in (*rig.twists, *rig.commands)} == {frame}
        count = len(rig.twists)
        rig.run(20)
        assert len(rig.twists) == count


def test_a_subscriber_of_the_twist_that_comes_back_starts_from_rest():
    """What the twist was when nobody followed it any more is no motion of now."""
    with running(teleop__acceleration_limit=20.0) as rig:
        rig.engage()
        rig.run(30, turning=(0.0, 0.01, 0.0))
        assert rig.twists[-1].twist.angular.y == pytest.approx(1.0)
        rig.host.subscribed = lambda topic: 'delta_twist_cmds' not in topic
        rig.run(100)
        rig.host.subscribed = lambda topic: True
        count = len(rig.twists)
        rig.run(5)
        rates = [message.twist.angular.y for message in rig.twists[count:]]
        assert rates == pytest.approx([0.0] * len(rates), abs=1e-9)
        assert len(rates) == 5


def test_an_old_enable_that_arrives_now_engages_nothing(rig, monkeypatch):
    """In simulated time, of an hour after 1970; a person enables in the present."""
    rig.now = lambda: round(3600e9) + rig.host.time_ns() % 10**12
    monkeypatch.setattr(rig.host.node, 'clock_reader', lambda: rig.now)
    rig.press('presence', True)
    for age in (0, 3600):
        rig.host.give('enabled_at', UInt64(data=rig.host.time_ns() - age * 10**9))
        rig.run(10)
        assert rig.state.startswith('disengaged: waiting for enable')
    rig.host.give('enabled_at', UInt64(data=rig.host.time_ns()))
    rig.run(20)
    assert rig.state == 'engaged'


def test_the_state_is_repeated_and_a_process_that_was_stopped_goes_on_with_nothing(rig):
    rig.engage()
    rig.host.sent['teleop_state'].clear()
    rig.run(100)
    assert [each.data for each in rig.host.sent['teleop_state']] == ['engaged'] * 5
    rig.host.pause(1.0)
    assert rig.sends_nothing(turning=(0.01, 0.0, 0.0))
    assert rig.state.startswith('disengaged: waiting for enable, after: ')


def test_a_process_that_is_stopped_as_it_decides_says_nothing(rig, monkeypatch):
    """The command was right when it was made; it goes out when the process is let go on."""
    rig.engage()
    take = rig.host.node._machine.take_master
    stopped = [0.2]

    def slow(*given):
        command = take(*given)
        rig.host.pause(stopped.pop() if stopped else 0.0)
        return command

    monkeypatch.setattr(rig.host.node._machine, 'take_master', slow)
    count = len(rig.commands)
    rig.orientation(rig.host.time_ns())
    assert not stopped
    assert len(rig.commands) == count


def test_a_stale_orientation_is_none(rig):
    rig.engage()
    count = len(rig.commands)
    for offset in (-2, 2):
        rig.orientation(rig.host.time_ns() + offset * 10**9)
    # They keep nothing alive either.
    rig.host.run(0.1)
    assert len(rig.commands) == count
    assert rig.state == 'disengaged: no orientation'
    rig.host.run(1.0)
    assert rig.host.figures('teleop')['stale orientations'] == '2'
