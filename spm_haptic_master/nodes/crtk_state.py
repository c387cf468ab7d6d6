# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The CRTK face of a device: operating state and commands, and the lines about them.

`operating_state` and `state_command` have messages of crtk_msgs, of which there is no wheel.
Without it they are not there, and standard topics and services do the same.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial
import time
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from spm_haptic_master.nodes.state_commands import StateCommands
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.diagnostic_status import STEADY
from spm_haptic_master.ros.qos import EVENTS, STATE
from spm_haptic_master.supervision.orientation_state import OrientationState, silent
from spm_haptic_master.teleoperation.operating_state import Event, OperatingState
from std_msgs.msg import String, UInt64
from std_srvs.srv import Trigger

# Period at which the operating state is repeated (s): subscribers are volatile.
REPEAT_PERIOD = 0.1
# Longest wait at the end until the last state is acknowledged (s).
ACKNOWLEDGE_TIMEOUT = 0.2
# What is logged without crtk_msgs, once a service is called.
ABSENT = (
    'crtk_msgs is not installed: no operating_state, no state_command; the services enable '
    'and disable and the topic operating_state_text do the same'
)
# State of the orientation at the end of the process.
ENDED = silent('fkm has ended')


class CrtkState:
    """
    Publishes the operating state and takes its commands, by crtk_msgs and standard types.

    Parameters
    ----------
    node
        Node that has topics and services.
    frame_id
        frame_id of the messages.

    """

    def __init__(self, node: Node, frame_id: str) -> None:
        self._node = node
        self._state = OperatingState()
        self._lines = {}
        for level in ('error', 'warning', 'status'):
            self._lines[level] = node.create_publisher(String, level, EVENTS)
        self._text_out = node.create_publisher(String, 'operating_state_text', STATE)
        self._enabled_out = node.create_publisher(UInt64, 'enabled_at', STATE)
        # State, enabling and whether it is homed, as published last.
        self._published: tuple[str, int, bool] | tuple[None, ...] = (None,) * 3
        # Message of crtk_msgs; None where that is not installed.
        self._message: Any = None
        self._absence_logged = False
        self._commands: StateCommands | None = None
        with suppress(ImportError):
            from crtk_msgs import msg

            self._message = msg.OperatingState(is_busy=False)
            self._message.header.frame_id = frame_id
            self._out = node.create_publisher(msg.OperatingState, 'operating_state', EVENTS)
            self._commands = StateCommands(
                node=node,
                kind=msg.StringStamped,
                text_of=lambda message: str(message.string),
                execute=self.command,
            )
            node.create_timer(REPEAT_PERIOD, self._publish_message, clock=STEADY)
        for text in ('enable', 'disable'):
            node.create_service(Trigger, text, partial(self._serve, text))
        self._publish([])

    @property
    def name(self) -> str:
        """Return the state: DISABLED, ENABLED, PAUSED or FAULT."""
        return self._state.name

    def take(self, orientation: OrientationState) -> None:
        """
        Take the state of the orientation.

        Parameters
        ----------
        orientation : OrientationState
            State of the orientation: the operating state follows from it and from the commands.

        """
        self._publish(self._state.take(orientation))

    def command(self, text: str) -> tuple[bool, str]:
        """
        Execute a command.

        Parameters
        ----------
        text
            One of `COMMANDS`; another one has no effect.

        Returns
        -------
        bool
            Whether it has an effect, or its effect is already there.
        str
            The state, or why the command has no effect.

        """
        accepted, events = self._state.command(text, time.time_ns())
        self._publish(events)
        if accepted:
            return True, self.name
        _, refusal = events[-1]
        return False, refusal

    def warn(self, text: str) -> None:
        """
        Publish a warning.

        Parameters
        ----------
        text : str
            Words on the topic `warning`.

        """
        self._lines['warning'].publish(String(data=text))

    def end(self) -> None:
        """Publish that the device is no longer there, and wait until that has arrived."""
        self.take(ENDED)
        publishers = [self._text_out, self._enabled_out, self._lines['error']]
        if self._message is not None:
            publishers.append(self._out)
        longest = Duration(seconds=ACKNOWLEDGE_TIMEOUT)
        for publisher in publishers:
            publisher.wait_for_all_acked(longest)
        if self._commands is not None:
            self._commands.close()

    def _serve(
        self,
        text: str,
        _: Trigger.Request,
        answer: Trigger.Response,
    ) -> Trigger.Response:
        """
        Answer a service by a command.

        Parameters
        ----------
        text : str
            The command: enable or disable.
        answer : Trigger.Response
            Gets whether the command has an effect, and the state or the reason.

        Returns
        -------
        Trigger.Response
            The answer.

        """
        answer.success, answer.message = self.command(text)
        if self._message is None and not self._absence_logged:
            # Whoever enables the device may look for the topics of crtk_msgs.
            self._absence_logged = True
            node_log.info(self._node, ABSENT)
        return answer

    def _publish(self, events: list[Event]) -> None:
        """
        Publish the state first, where it has changed, then the lines.

        Parameters
        ----------
        events : list of Event
            Lines for clients: each a topic (`error`, `warning` or `status`) and its words.

        """
        state = self._state
        before = self._published
        self._published = state.name, state.enabling, state.is_homed
        if self._published != before:
            self._publish_message()
        if state.enabling != before[1]:
            self._enabled_out.publish(UInt64(data=state.enabling))
        if state.name != before[0]:
            self._text_out.publish(String(data=state.name))
        for level, text in events:
            self._lines[level].publish(String(data=text))

    def _publish_message(self) -> None:
        """Publish the state as crtk_msgs has it, where these are installed."""
        message = self._message
        if message is not None:
            message.header.stamp = self._node.get_clock().now().to_msg()
            message.state = self._state.name
            message.is_homed = self._state.is_homed
            self._out.publish(message)
