# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that repeats the buttons of a joystick as the pedals of `teleop`."""

from __future__ import annotations

import time

from sensor_msgs.msg import Joy
from spm_haptic_master.parameters.nodes import PRESENCE_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros import runner
from spm_haptic_master.ros.diagnostic_status import OK, StatusPublisher, STEADY, WARN
from spm_haptic_master.ros.inputs import Inputs
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import EVENTS

# Value of a button that is pressed.
PRESSED = 1


class Presence(ParameterNode):
    """
    Publishes `presence`, and `clutch` if it has a button, from the latest `joy`.

    Both are repeated, so that `teleop` notices when they end. A joystick that is silent for
    `presence.joy_timeout`, or whose publisher has gone, presses nothing.

    Parameters
    ----------
    parameters : Parameters
        Values from files and arguments; SettingError if one is invalid.

    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('presence', parameters)
        values = self.declare(PRESENCE_SETTINGS)
        self._timeout: float = values['presence.joy_timeout']
        # Publishers and buttons; presence first: its release ends all following.
        buttons = {
            'presence': values['presence.button'],
            'clutch': values['presence.clutch_button'],
        }
        self._outs = []
        for topic, button in buttons.items():
            if button >= 0:
                out = self.create_publisher(Joy, topic, EVENTS)
                self._outs.append((out, button))
        # Buttons of the latest message, None without a publisher, and when it came, s, monotonic.
        self._buttons: tuple[int, ...] | None = None
        self._heard_at = 0.0
        self._inputs = Inputs(self)
        self._inputs.subscribe(Joy, 'joy', self._on_joy, EVENTS, gone=self._lose)
        self._status = StatusPublisher(
            node=self,
            aspect='pedals',
            hardware_id='joystick',
            logs=False,
        )
        self.create_timer(1.0 / values['presence.rate'], self._repeat, clock=STEADY)

    def _on_joy(self, message: Joy) -> None:
        """Take the buttons, and publish a change at once."""
        before = self._buttons
        self._buttons = tuple(message.buttons)
        self._heard_at = time.monotonic()
        if self._buttons != before:
            self._publish()

    def _lose(self) -> None:
        """Release every button: the publisher of the joystick has gone."""
        self._buttons = None
        self._publish()

    def _repeat(self) -> None:
        """Publish the buttons again, and report."""
        if self._timeout and time.monotonic() - self._heard_at > self._timeout:
            self._buttons = None
        self._publish()
        level, text = self._condition()
        if self._status.is_due(level, text):
            pressed = str(self._buttons or 'none')
            self._status.publish(level, text, {'buttons': pressed})

    def _condition(self) -> tuple[bytes, str]:
        """
        Return level and text of the entry on /diagnostics.

        Returns
        -------
        tuple of bytes and str
            WARN without a joystick, or with one that has too few buttons; else OK and whether
            presence is pressed.

        """
        unheard = self._inputs.unheard()
        if unheard or self._buttons is None:
            return WARN, unheard or 'no joy'
        buttons = [button for _, button in self._outs]
        if max(buttons) >= len(self._buttons):
            return (
                WARN,
                f'joy has {len(self._buttons)} buttons, expected more than {max(buttons)}',
            )
        if self._is_pressed(buttons[0]):
            return OK, 'pressed'
        return OK, 'released'

    def _publish(self) -> None:
        """Publish each pedal."""
        message = Joy()
        message.header.stamp = self.get_clock().now().to_msg()
        for out, button in self._outs:
            message.buttons = [int(self._is_pressed(button))]
            out.publish(message)

    def _is_pressed(self, button: int) -> bool:
        """Return whether a button, from 0, is pressed; False of one that does not exist."""
        buttons = self._buttons or ()
        return button < len(buttons) and buttons[button] == PRESSED


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('presence', lambda _, add: add(Presence), args)
