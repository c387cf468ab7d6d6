# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From command line to exit code: every executable starts, spins and ends the same way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
import os
import signal
import sys
from types import FrameType
from typing import Any, Protocol, TypeVar

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from spm_haptic_master.exceptions import InputError, SourceEnded, SpmError
from spm_haptic_master.executables import EXECUTABLES, FOLLOWER, PIPELINE
from spm_haptic_master.parameters.arguments import node_command_line
from spm_haptic_master.parameters.nodes import REALTIME_SETTINGS
from spm_haptic_master.parameters.resolver import NO_EFFECT, Parameters
from spm_haptic_master.ros import discovery, node_log, realtime
from spm_haptic_master.ros.duplicate_publishers import wait_until_alone
from spm_haptic_master.ros.end_limit import EndLimit
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.standard_streams import (
    keep_open,
    print_within,
    STANDARD_ERROR,
    STANDARD_OUTPUT,
)

# Longest wait of the executor (s): without a time-out EventsExecutor uses a whole core while idle
# (rclpy 7.1.6), and signals are polled between its waits.
SPIN_TIMEOUT = 0.2
# Longest wait at the end for the log (s), and as long again for the last line.
LOG_TIMEOUT = 0.5

# Signals that end a process.
SIGNALS = (signal.SIGINT, signal.SIGTERM)

NodeType = TypeVar('NodeType', bound=ParameterNode)


class AddNode(Protocol):
    """Function that makes a node with the parameters of the process, adds and returns it."""

    def __call__(self, kind: Callable[..., NodeType], /, *args: object) -> NodeType:
        """Add a node: its parameters are the first argument of its class, `args` the others."""


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
    nodes: list[Node] = []
    process_settings: list[dict[str, Any]] = []
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

    keep_open()
    try:
        read = _read_arguments(name, args, handle)
        if read is None:
            return 0
        command_line, parameters = read
        _init(command_line)
        if owned:
            wait_until_alone(owned, lambda: signals)
        executor = EventsExecutor()

        def add(kind: Callable[..., NodeType], *args: object) -> NodeType:
            node = kind(parameters, *args)
            nodes.append(node)
            process_settings.append(node.declare(REALTIME_SETTINGS))
            executor.add_node(node)
            return node

        compose(done, add)
        for argument in parameters.unused({
                node.get_fully_qualified_name(): node.get_parameters_by_prefix('')
                for node in nodes}):
            node_log.warning(nodes[0], f'{argument}: {NO_EFFECT}')
        realtime.apply(nodes[0], realtime.agreed(process_settings))
        for node in nodes:
            if hasattr(node, 'start'):
                node.start()
        while not (done.done() or signals):
            executor.spin_until_future_complete(done, timeout_sec=SPIN_TIMEOUT)
        failure = done.result()
    except ExternalShutdownException:
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


def _clean_up(nodes: list[Node], executor: Executor | None, limit: EndLimit) -> None:
    """Destroy the nodes, end the log and leave the DDS domain, whatever fails of it."""
    with ExitStack() as stack:
        # What is registered last is done first: the driver, made last, calls the other nodes.
        def step(what: str, action: Callable[[], object]) -> None:
            stack.callback(limit.take, what, action)

        step('the DDS domain', rclpy.try_shutdown)
        if executor is not None:
            step('its callbacks', executor.shutdown)
        # After the nodes, which log; before the shutdown, which gives rclpy its console again.
        step('its log', partial(node_log.end, LOG_TIMEOUT))
        for node in nodes:
            step(f'node {node.get_fully_qualified_name()}', node.destroy_node)


def _read_arguments(name: str, args: list[str] | None,
                    handle: Callable[[int, FrameType | None], None],
                    ) -> tuple[list[str], Parameters] | None:
    """Return command line and parameters; None after a signal. Later ones are handled."""
    nodes = (*PIPELINE, FOLLOWER) if name == 'master' else (name,)
    _, description = EXECUTABLES.get(name, ('', ''))
    for number in SIGNALS:
        signal.signal(number, signal.default_int_handler)
    try:
        found = node_command_line(name, description, nodes, sys.argv if args is None else args)
        for number in SIGNALS:
            signal.signal(number, handle)
        return found
    except KeyboardInterrupt:
        return None


def _init(command_line: list[str]) -> None:
    # Fast DDS reads it when the first node is made.
    os.environ.update(discovery.profile(os.environ))
    try:
        rclpy.init(args=[*command_line, '--ros-args', node_log.NO_CONSOLE],
                   signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, UnicodeError) as error:  # from rcl: such as a wrong enclave
        raise InputError(f'ROS arguments rejected: {str(error).splitlines()[0]}') from error
    node_log.begin(command_line)
