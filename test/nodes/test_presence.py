# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that repeats a joystick's buttons as pedals."""

from contextlib import contextmanager

from in_process import hosted
import pytest
from sensor_msgs.msg import Joy
from spm_haptic_master.nodes.presence import Presence


@contextmanager
def joystick(**settings):
    """Yield a node; `hold` gives it buttons and returns the pedals that it makes of them."""
    with hosted(
        Presence, *(f'presence.{name}:={value}' for name, value in settings.items())
    ) as host:

        def pedals():
            return tuple(
                host.last(topic).buttons[0] for topic in ('presence', 'clutch') if host.sent[topic]
            )

        def hold(*buttons):
            host.give('joy', Joy(buttons=buttons))
            return pedals()

        host.pedals = pedals
        host.hold = hold
        host.run(0.2)
        yield host


def test_a_button_is_presence_and_another_one_the_clutch():
    with joystick(button=2, clutch_button=0) as joy:
        assert joy.pedals() == (0, 0)
        assert joy.entry('pedals').message == 'no joy'
        for buttons, pedals in (
            ((0, 0, 1), (1, 0)),
            ((1, 0, 1), (1, 1)),
            ((1, 1, 0), (0, 1)),
            # A tap and a joystick with fewer buttons press nothing.
            ((2, 0, 2), (0, 0)),
            ((1, 1), (0, 1)),
        ):
            assert joy.hold(*buttons) == pedals
        joy.run(0.2)
        assert joy.entry('pedals').message == 'joy has 2 buttons, expected more than 2'
        joy.hold(0, 0, 1)
        joy.run(0.2)
        assert joy.entry('pedals').message == 'pressed'


@pytest.mark.parametrize(('timeout', 'after'), [(0.4, 0), (0.0, 1)])
def test_a_held_button_is_repeated_unless_its_joystick_has_to_and_hangs(timeout, after):
    with joystick(joy_timeout=timeout, rate=50.0) as joy:
        assert joy.hold(1) == (1,)
        joy.sent['presence'].clear()
        joy.run(0.3)
        assert [each.buttons[0] for each in joy.sent['presence']] == [1] * 15
        joy.run(0.2)
        joy.sent['presence'].clear()
        joy.run(1.0)
        assert [each.buttons[0] for each in joy.sent['presence']] == [after] * 50
        # A joystick that goes releases its buttons at once.
        joy.hold(1)
        joy.restart_publisher('joy')
        assert joy.pedals() == (0,)
