# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From command line to exit code: every executable starts, spins and ends the same way."""

from __future__ import annotations

from collections.abc import Callable
import faulthandler
import signal
import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from spm_haptic_master.exceptions import InputError, SourceEnded, SpmError
from spm_haptic_master.nodes import realtime
from spm_haptic_master.nodes.parameters import declare, REALTIME_SETTINGS

# s. EventsExecutor spins idle at full load when it has no time-out (rclpy 7.1.6); and a signal is
# looked for when it comes back from waiting.
SPIN_TIMEOUT = 0.2
# s; an end that takes longer hangs in a library: the process tells where, and ends all the same.
END_TIMEOUT = 10.0


def run(name: str, compose: Callable[[Future, Callable[[Node], Node]], None],
        args: list[str] | None = None) -> int:
    """
    Run nodes on one EventsExecutor until a signal or until they are done.

    Parameters
    ----------
    name : str
        The executable, named in what goes wrong.
    compose : callable
        Makes the nodes and hands each to its second argument, which returns it. The first is the
        future that ends the process: with SourceEnded normally, with another SpmError as a
        failure. Nodes with a method `start` are started once the process is set up.
    args : list of str, optional
        Command line, sys.argv by default.

    Returns
    -------
    int
        Exit code: 0 after SIGINT, SIGTERM or a normal end, 1 after an error (told in one line).

    """
    nodes: list[Node] = []
    wishes: list[dict[str, object]] = []
    executor = None
    failure: SpmError | None = None
    done = Future()
    signals: list[int] = []

    # Our own handlers: rclpy's would take the context away while a sample is being published. They
    # leave the future alone: it has a lock, which may be held right where the signal comes in.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: (signals.append(number), _must_end()))
    try:
        _init(args)
        executor = EventsExecutor()

        def add(node: Node) -> Node:
            nodes.append(node)
            wishes.append(declare(node, REALTIME_SETTINGS))
            executor.add_node(node)
            return node

        compose(done, add)
        realtime.apply(nodes[0], realtime.agreed(wishes))
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
        _must_end()
        # From here on a second signal must not cut the clean-up short.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        # The last made, the driver, first: its thread calls the others.
        for node in reversed(nodes):
            node.destroy_node()
        if executor is not None:
            executor.shutdown()
        rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
    if isinstance(failure, SourceEnded):
        print(f'{name}: {failure}', flush=True)
    elif failure is not None:
        print(f'{name}: {failure}', file=sys.stderr)
        return 1
    return 0


def _must_end() -> None:
    faulthandler.dump_traceback_later(END_TIMEOUT, exit=True)


def _init(args: list[str] | None) -> None:
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rcl's own: a bad --ros-args, a parameter file that is not there
        raise InputError(f'ROS arguments refused: {str(error).splitlines()[0]}') from error
