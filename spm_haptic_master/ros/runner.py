# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From command line to exit code: how every executable starts, spins and ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
import faulthandler
import os
from pathlib import Path
import signal
import sys
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
import rclpy.utilities
from spm_haptic_master.exceptions import InputError, SourceEnded, SpmError
from spm_haptic_master.executables import EXECUTABLES, FOLLOWER, PIPELINE
from spm_haptic_master.parameters.arguments import node_command_line
from spm_haptic_master.parameters.files import config_directory
from spm_haptic_master.parameters.nodes import REALTIME_SETTINGS
from spm_haptic_master.parameters.resolver import NO_EFFECT
from spm_haptic_master.ros import node_log, realtime
from spm_haptic_master.ros.duplicate_publishers import wait_until_alone
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.standard_streams import print_within, STANDARD_ERROR, STANDARD_OUTPUT

# Longest wait of the executor (s): without a time-out EventsExecutor uses a whole core while idle
# (rclpy 7.1.6), and signals are polled between its waits.
SPIN_TIMEOUT = 0.2
# Longest wait at the end for the log (s), and as long again for the last line.
LOG_TIMEOUT = 0.5
# Longest end of a process after the signal (s): a longer one hangs in a library, as the stacks of
# its threads show.
END_TIMEOUT = 5.0
# Time for printing them (s). Then the kernel ends the process, whether stderr is read or not.
PRINT_TIMEOUT = 1.0
SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Environment variables that name a file of profiles: of Fast DDS 2, which Jazzy has, and of 3.
PROFILE_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
# Files of profiles that Fast DDS reads in the working directory.
PROFILES = ('DEFAULT_FASTRTPS_PROFILES.xml', 'DEFAULT_FASTDDS_PROFILES.xml')

# Makes, adds and returns a node of a class, from the parameters of the process and its arguments.
AddNode = Callable[..., Any]


def _limit_end() -> None:
    """Have the process end within `END_TIMEOUT`, or print its stacks and end with code 1."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, END_TIMEOUT + PRINT_TIMEOUT)
    faulthandler.dump_traceback_later(END_TIMEOUT, exit=True, file=STANDARD_ERROR)


def run(
    name: str,
    compose: Callable[[Future, AddNode], object],
    args: list[str] | None = None,
    owned: Mapping[str, str] | None = None,
) -> int:
    """
    Run nodes until a signal arrives or they are done; return the exit code, 1 after an error.

    `compose` makes the nodes by its second argument. Its first is the future that ends the
    process: SourceEnded as its result is a normal end, another SpmError a failure. Nodes with a
    method `start` are started once the process is set up; `owned` as of `wait_until_alone`.
    """
    nodes: list[ParameterNode] = []
    executor = None
    failure: SpmError | None = None
    done = Future()
    signals: list[int] = []

    # rclpy's own handlers would invalidate the context while a sample is being published. These
    # must not complete the future: its lock may be held where the signal interrupts.
    def handle(number: int, _: FrameType | None) -> None:
        if not signals:
            _limit_end()
        signals.append(number)

    try:
        for number in SIGNALS:
            signal.signal(number, signal.default_int_handler)
        _, description = EXECUTABLES.get(name, ('', ''))
        command_line, parameters = node_command_line(
            name,
            description,
            (*PIPELINE, FOLLOWER) if name == 'master' else (name,),
            sys.argv if args is None else args,
        )
        for number in SIGNALS:
            signal.signal(number, handle)
        _init(command_line)
        if owned:
            wait_until_alone(owned, lambda: signals)
        executor = EventsExecutor()

        def add(kind: Callable[..., ParameterNode], *args: object) -> ParameterNode:
            node = kind(parameters, *args)
            nodes.append(node)
            node.declare(REALTIME_SETTINGS)
            executor.add_node(node)
            return node

        compose(done, add)
        for argument in parameters.unused(
            {node.get_fully_qualified_name(): node.get_parameters_by_prefix('') for node in nodes}
        ):
            node_log.warning(nodes[0], f'{argument}: {NO_EFFECT}')
        realtime.apply(nodes[0], realtime.agreed([node.values for node in nodes]))
        for node in nodes:
            if hasattr(node, 'start'):
                node.start()
        while not (done.done() or signals):
            executor.spin_until_future_complete(done, timeout_sec=SPIN_TIMEOUT)
        failure = done.result()
    except (ExternalShutdownException, KeyboardInterrupt):
        pass
    except SpmError as error:
        failure = error
    finally:
        if not signals:
            _limit_end()
        # A second signal must not interrupt the clean-up.
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        try:
            _clean_up(nodes, executor)
        except SpmError as error:
            failure = failure or error
    # After an error of the program the limit stays: its traceback may wait for a reader.
    faulthandler.cancel_dump_traceback_later()
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    if failure is None:
        return 0
    is_end = isinstance(failure, SourceEnded)
    print_within(STANDARD_OUTPUT if is_end else STANDARD_ERROR, f'{name}: {failure}', LOG_TIMEOUT)
    return 0 if is_end else 1


def _clean_up(nodes: list[ParameterNode], executor: Executor | None) -> None:
    """Destroy the nodes, end the log and leave the DDS domain, whatever fails of it."""
    with ExitStack() as stack:
        # The last step registered is done first: the driver, made last, calls the other nodes.
        stack.callback(rclpy.utilities.try_shutdown)
        if executor is not None:
            stack.callback(executor.shutdown)
        # After the nodes, which log; before the shutdown, which gives rclpy its console again.
        stack.callback(node_log.end, LOG_TIMEOUT)
        for node in nodes:
            stack.callback(node.destroy_node)


def _init(command_line: list[str]) -> None:
    # Fast DDS reads it when the first node is made.
    os.environ.update(discovery_profile(os.environ))
    try:
        rclpy.init(
            args=[*command_line, '--ros-args', node_log.NO_CONSOLE],
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except (RuntimeError, UnicodeError) as error:  # from rcl: such as a wrong enclave
        raise InputError(f'ROS arguments rejected: {str(error).splitlines()[0]}') from error
    node_log.begin(command_line)


def discovery_profile(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that select the package's profile; none if the user has one."""
    # Without it a process whose first announcement is lost waits 3 s for the next one.
    if any(environment.get(name) for name in PROFILE_VARIABLES) or any(
        Path(name).exists() for name in PROFILES
    ):
        return {}
    return dict.fromkeys(PROFILE_VARIABLES, str(config_directory() / 'fastdds.xml'))
