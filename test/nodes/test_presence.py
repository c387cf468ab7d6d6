# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that repeats a joystick's buttons as pedals."""

from contextlib import contextmanager

from diagnostic_msgs.msg import DiagnosticArray
from harness import start_program, status
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Joy

pytestmark = pytest.mark.process

# Time that a busy machine may need (s).
PATIENCE = 60.0
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Joystick:
    """Publishes `joy`, and keeps what the node makes of it."""

    def __init__(self, observer, qos):
        self._observer = observer
        self._out = observer.node.create_publisher(Joy, 'joy', qos)
        self.pedals = {topic: observer.collect(Joy, topic) for topic in ('presence', 'clutch')}
        self.health = observer.collect(DiagnosticArray, '/diagnostics')

    def hold(self, *buttons):
        self._out.publish(Joy(buttons=buttons))

    def unplug(self):
        self._observer.node.destroy_publisher(self._out)

    def now(self, topic):
        arrived = self.pedals[topic]
        return arrived[-1][1].buttons[0] if arrived else None

    def awaits(self, presence, clutch=None, held=None):
        """Return whether the pedals become these while buttons are held."""
        def reached():
            if held is not None:
                self.hold(*held)
            return (self.now('presence'), self.now('clutch')) == (presence, clutch)

        return self._observer.spin_until(reached, PATIENCE)

    def counts(self, seconds):
        """Return the presences that arrive within a time."""
        del self.pedals['presence'][:]
        self._observer.spin(seconds)
        return [message.buttons[0] for _, message in self.pedals['presence']]


@contextmanager
def joystick(observer, qos=10, **parameters):
    with start_program('presence', parameters={
            f'presence.{name}': value for name, value in parameters.items()}) as program:
        yield Joystick(observer, qos)
        assert program.stop() == 0
        assert 'Traceback' not in program.stderr


@pytest.mark.parametrize('qos', [10, BEST_EFFORT])
def test_a_button_is_presence_and_another_one_the_clutch(observer, qos):
    with joystick(observer, qos, button=2, clutch_button=0) as joy:
        assert joy.awaits(0, 0)
        assert joy.awaits(1, 0, held=(0, 0, 1))
        assert joy.awaits(1, 1, held=(1, 0, 1))
        assert joy.awaits(0, 1, held=(1, 1, 0))
        # A tap and a joystick with fewer buttons press nothing.
        assert joy.awaits(0, 0, held=(2, 0, 2))
        assert joy.awaits(0, 1, held=(1, 1))
        assert observer.spin_until(
            lambda: joy.hold(1, 1) or (entry := status(joy.health, 'presence: pedals'))
            and entry.message == 'joy has 2 buttons, expected more than 2', PATIENCE)


def test_a_joystick_that_hangs_holds_nothing(observer):
    with joystick(observer, joy_timeout=0.4) as joy:
        assert joy.awaits(1, held=(1,))
        # The publisher is there and silent.
        assert joy.awaits(0)
        assert joy.counts(0.5)
        assert set(joy.counts(0.5)) == {0}


def test_a_joystick_that_publishes_changes_only_is_repeated(observer):
    with joystick(observer, joy_timeout=0.0, rate=50.0) as joy:
        assert joy.awaits(1, held=(1,))
        found = joy.counts(2.0)
        # Each at least as often as teleop.presence_timeout asks for.
        assert len(found) >= 4 and set(found) == {1}
        joy.unplug()
        assert joy.awaits(0)
