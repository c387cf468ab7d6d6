# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A program that asks the running nodes: their topics, parameters and services."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import signal
import sys
import time
from typing import Any

import rclpy
from rclpy.executors import Executor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
import rclpy.utilities
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.standard_streams import discard, STANDARD_OUTPUT

# Time between two evaluations of what a program waits for (s).
POLL_PERIOD = 0.05


# Package of the services of parameters, and how often one is asked before there is no answer.
PARAMETERS = 'rcl_interfaces.'
PARAMETER_ATTEMPTS = 4


class Client:
    """
    A node without a log that waits for messages and answers.

    Parameters
    ----------
    name : str
        Name of the node.

    """

    # Longest wait for a topic, node or service, and for its answer (s).
    PATIENCE = 5.0

    def __init__(self, name: str) -> None:
        self.node: Node = rclpy.create_node(name, enable_rosout=False)
        self._executor: Executor = EventsExecutor()
        self._executor.add_node(self.node)

    def wait(self, condition: Callable[[], Any], seconds: float) -> Any:
        """Receive until a condition holds or a time, s, is over; return the condition's value."""
        end = time.monotonic() + seconds
        while not (found := condition()):
            remaining = end - time.monotonic()
            if remaining <= 0.0:
                break
            self._executor.spin_once(timeout_sec=min(POLL_PERIOD, remaining))
        return found

    def ask(self, service: str, kind: Any, **fields: object) -> Any:
        """
        Call a service and return its answer.

        Parameters
        ----------
        service : str
            Full name.
        kind : type
            Type of the service.
        **fields
            Fields of the request.

        Raises
        ------
        InputError
            There is no such service, or no answer, within `PATIENCE`.

        """
        client = self.node.create_client(kind, service)
        if not self.wait(client.service_is_ready, self.PATIENCE):
            raise InputError(f'{service}: no such node or service within {self.PATIENCE:g} s')
        request = kind.Request(**fields)
        # A server that was found first may be one that is gone. Parameters may be asked for again;
        # another request might be done twice.
        attempts = 1
        if kind.__module__.startswith(PARAMETERS):
            attempts = PARAMETER_ATTEMPTS
        for _ in range(attempts):
            answer = client.call_async(request)
            if self.wait(answer.done, self.PATIENCE / attempts):
                return answer.result()
        raise InputError(f'{service}: no answer within {self.PATIENCE:g} s')


def run(
    name: str,
    program: Callable[[], int],
    ros_arguments: Sequence[str] = (),
) -> int:
    """
    Run a program with rclpy and return its exit code.

    Parameters
    ----------
    name : str
        The program, in its errors.
    program : callable
        Returns the exit code; InputError is one line on stderr and exit code 1.
    ros_arguments : sequence of str
        Arguments of ROS, such as '--ros-args', '-r', '__ns:=/left'.

    Returns
    -------
    int
        The exit code; 0 after Ctrl-C, and where the reader of the output has ended.

    """
    try:
        rclpy.init(args=list(ros_arguments), signal_handler_options=SignalHandlerOptions.NO)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.default_int_handler)
        code = program()
        sys.stdout.flush()
        return code
    except InputError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    except BrokenPipeError:
        # Python would flush the rest at its end, and print a traceback.
        discard(STANDARD_OUTPUT)
        return 0
    finally:
        rclpy.utilities.try_shutdown()
