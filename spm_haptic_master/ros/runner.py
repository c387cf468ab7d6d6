# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From command line to exit code: every executable starts, spins and ends the same way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
import faulthandler
from functools import partial
import os
import signal
import sys
import threading
import time
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from spm_haptic_master.exceptions import InputError, SourceEnded, SpmError
from spm_haptic_master.executables import EXECUTABLES, FOLLOWER, PIPELINE
from spm_haptic_master.parameters.arguments import node_command_line
from spm_haptic_master.parameters.nodes import REALTIME_SETTINGS
from spm_haptic_master.parameters.resolver import NO_EFFECT
from spm_haptic_master.ros import discovery, node_log, realtime
from spm_haptic_master.ros.duplicate_publishers import wait_until_alone
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.standard_streams import print_within, STANDARD_ERROR, STANDARD_OUTPUT

# Longest wait of the executor (s): without a time-out EventsExecutor uses a whole core while idle
# (rclpy 7.1.6), and signals are polled between its waits.
SPIN_TIMEOUT = 0.2
# Longest wait at the end for the log (s), and as long again for the last line.
LOG_TIMEOUT = 0.5

# Longest end of a process (s), from the signal on: a longer one hangs in a library.
END_TIMEOUT = 5.0
# Time for the line that says so (s). As long after it the stacks are printed by a thread that
# needs no interpreter, and as long after that the kernel ends the process, whether stderr was read
# or not.
PRINT_TIMEOUT = 1.0
# Signals that end a process.
SIGNALS = (signal.SIGINT, signal.SIGTERM)

# Makes, adds and returns a node of a class, which gets the parameters of the process and then the
# other arguments.
AddNode = Callable[..., Any]


class EndLimit:
    """The end of a process takes `END_TIMEOUT` at most: it then reports what it waits for."""

    def __init__(self, name: str) -> None:
        self._name = name
        # When the end must be over, s, monotonic; None before it begins.
        self._until: float | None = None
        self._over = threading.Event()
        # The step of the end that is being done.
        self.waits_for = 'its nodes'

    def begin(self) -> float:
        """Begin to count, at the first call, also of a signal handler; return `_until`."""
        if self._until is None:
            self._until = time.monotonic() + END_TIMEOUT
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, END_TIMEOUT + 2.0 * PRINT_TIMEOUT)
            faulthandler.dump_traceback_later(
                END_TIMEOUT + PRINT_TIMEOUT, exit=True, file=STANDARD_ERROR)
        return self._until

    def watch(self) -> None:
        """Begin to count, and report by name what is waited for; not from a signal handler."""
        threading.Thread(target=self._run, args=[self.begin()], name='end', daemon=True).start()

    def lift(self) -> None:
        """Let the process take its time."""
        self._over.set()
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _run(self, until: float) -> None:
        if self._over.wait(until - time.monotonic()):
            return
        print_within(STANDARD_ERROR, f'{self._name}: still waiting for {self.waits_for} '
                     f'{END_TIMEOUT:g} s after the end began: it ends without', PRINT_TIMEOUT)
        faulthandler.dump_traceback(file=STANDARD_ERROR)
        os._exit(1)


def run(name: str, compose: Callable[[Future, AddNode], object],
        args: list[str] | None = None, owned: Mapping[str, str] | None = None) -> int:
    """
    Run nodes on one EventsExecutor until a signal arrives or until they are done.

    `compose` makes the nodes by its second argument. Its first is the future that ends the
    process: SourceEnded as its result is a normal end, another SpmError a failure. Nodes with a
    method `start` are started once the process is set up. Nobody else may publish on the topics
    `owned` when the nodes are made; see `wait_until_alone`. Return the exit code: 0 after SIGINT,
    SIGTERM or a normal end, 1 after an error, which is reported in one line.
    """
    nodes: list[ParameterNode] = []
    executor = None
    failure: SpmError | None = None
    done = Future()
    signals: list[int] = []
    limit = EndLimit(name)

    # rclpy's own handlers would invalidate the context while a sample is being published. These
    # must not complete the future: its lock may be held where the signal interrupts.
    def handle(number: int, _: FrameType | None) -> None:
        signals.append(number)
        limit.begin()

    try:
        for number in SIGNALS:
            signal.signal(number, signal.default_int_handler)
        _, description = EXECUTABLES.get(name, ('', ''))
        command_line, parameters = node_command_line(
            name, description, (*PIPELINE, FOLLOWER) if name == 'master' else (name,),
            sys.argv if args is None else args)
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
        for argument in parameters.unused({
                node.get_fully_qualified_name(): node.get_parameters_by_prefix('')
                for node in nodes}):
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
        limit.watch()
        # A second signal must not interrupt the clean-up.
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        try:
            _clean_up(nodes, executor, limit)
        except SpmError as error:
            failure = failure or error
    # After an error of the program the limit stays: its traceback may wait for a reader.
    limit.lift()
    if isinstance(failure, SourceEnded):
        print_within(STANDARD_OUTPUT, f'{name}: {failure}', LOG_TIMEOUT)
    elif failure is not None:
        print_within(STANDARD_ERROR, f'{name}: {failure}', LOG_TIMEOUT)
        return 1
    return 0


def _clean_up(nodes: list[ParameterNode], executor: Executor | None, limit: EndLimit) -> None:
    """Destroy the nodes, end the log and leave the DDS domain, whatever fails of it."""
    with ExitStack() as stack:
        # What is registered last is done first: the driver, made last, calls the other nodes.
        def step(what: str, action: Callable[[], object]) -> None:
            stack.callback(action)
            stack.callback(setattr, limit, 'waits_for', what)

        step('the DDS domain', rclpy.try_shutdown)
        if executor is not None:
            step('its callbacks', executor.shutdown)
        # After the nodes, which log; before the shutdown, which gives rclpy its console again.
        step('its log', partial(node_log.end, LOG_TIMEOUT))
        for node in nodes:
            step(f'node {node.get_fully_qualified_name()}', node.destroy_node)


def _init(command_line: list[str]) -> None:
    # Fast DDS reads it when the first node is made.
    os.environ.update(discovery.profile(os.environ))
    try:
        rclpy.init(args=[*command_line, '--ros-args', node_log.NO_CONSOLE],
                   signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, UnicodeError) as error:  # from rcl: such as a wrong enclave
        raise InputError(f'ROS arguments rejected: {str(error).splitlines()[0]}') from error
    node_log.begin(command_line)
