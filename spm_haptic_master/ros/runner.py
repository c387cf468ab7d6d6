# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From command line to exit code: how every executable starts, spins and ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from spm_haptic_master.parameters.resolver import NO_EFFECT, Parameters
from spm_haptic_master.ros import node_log, realtime
from spm_haptic_master.ros.duplicate_publishers import wait_until_alone
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.standard_streams import print_within, STANDARD_ERROR, STANDARD_OUTPUT

# Longest wait of the executor (s): without a time-out EventsExecutor uses a whole core while idle
# (rclpy 7.1.6), and signals are polled between its waits.
SPIN_TIMEOUT = 0.2
# Longest wait at the end for the log (s), and as long again for the last line.
LOG_TIMEOUT = 0.5
# After this time from the signal the process is stuck in a library: print its stacks (s).
END_TIMEOUT = 5.0
# Time for printing them (s). Then the kernel ends the process, whether stderr is read or not.
PRINT_TIMEOUT = 1.0
SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Environment variables that name a file of profiles: of Fast DDS 2, which Jazzy has, and of 3.
PROFILE_VARIABLES = (
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'FASTDDS_DEFAULT_PROFILES_FILE',
)
# Environment variable that says which hosts are heard.
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
# Environment variable that names hosts to be looked for.
STATIC_PEERS = 'ROS_STATIC_PEERS'
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
    Run nodes until a signal arrives or they are done.

    Parameters
    ----------
    name : str
        Name of the executable, in its errors.
    compose : callable
        Makes the nodes by its second argument. Its first is the future that ends the process:
        SourceEnded as its result is a normal end, another SpmError a failure. Nodes with a method
        `start` are started once the process is set up.
    args : list of str, optional
        The command line with the name, by default that of this process.
    owned : mapping, optional
        Topics that no other process may publish on, as of `wait_until_alone`.

    Returns
    -------
    int
        Exit code: 0 after a signal or a normal end, 1 after an error, which is printed.

    """
    words = sys.argv if args is None else args
    failure = _Process(name).run(compose, words, owned or {})
    # After an error of the program the limit stays: its traceback may wait for a reader.
    faulthandler.cancel_dump_traceback_later()
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    if failure is None:
        return 0
    if isinstance(failure, SourceEnded):
        print_within(STANDARD_OUTPUT, f'{name}: {failure}', LOG_TIMEOUT)
        return 0
    print_within(STANDARD_ERROR, f'{name}: {failure}', LOG_TIMEOUT)
    return 1


class _Process:
    """One process: its nodes, the signals that end it, and why it ended."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._nodes: list[ParameterNode] = []
        self._executor: Executor | None = None
        self._done = Future()
        self._signals: list[int] = []

    def run(
        self,
        compose: Callable[[Future, AddNode], object],
        args: Sequence[str],
        owned: Mapping[str, str],
    ) -> SpmError | None:
        """Start, spin and end the nodes; return why they ended, None after a signal."""
        failure: SpmError | None = None
        try:
            self._start(compose, args, owned)
            failure = self._spin()
        except (ExternalShutdownException, KeyboardInterrupt):
            pass
        except SpmError as error:
            failure = error
        finally:
            failure = self._end() or failure
        return failure

    def _start(
        self,
        compose: Callable[[Future, AddNode], object],
        args: Sequence[str],
        owned: Mapping[str, str],
    ) -> None:
        """Make and start the nodes; SpmError for arguments and settings that are refused."""
        command_line, parameters = self._read_arguments(args)
        _init(command_line)
        if owned:
            wait_until_alone(owned, lambda: self._signals)
        self._executor = executor = EventsExecutor()

        def add(kind: Callable[..., ParameterNode], *args: object) -> ParameterNode:
            node = kind(parameters, *args)
            self._nodes.append(node)
            node.declare(REALTIME_SETTINGS)
            executor.add_node(node)
            return node

        compose(self._done, add)
        self._check_parameters(parameters)
        values = [node.values for node in self._nodes]
        realtime.apply(self._nodes[0], realtime.agreed(values))
        for node in self._nodes:
            if hasattr(node, 'start'):
                node.start()

    def _read_arguments(self, args: Sequence[str]) -> tuple[list[str], Parameters]:
        """Return what ROS gets of a command line, and the parameters; signals are handled then."""
        # While the libraries read arguments, Ctrl-C is a KeyboardInterrupt.
        for number in SIGNALS:
            signal.signal(number, signal.default_int_handler)
        _, description = EXECUTABLES.get(self._name, ('', ''))
        nodes = [self._name]
        if self._name == 'master':
            nodes = [*PIPELINE, FOLLOWER]
        found = node_command_line(self._name, description, nodes, list(args))
        for number in SIGNALS:
            signal.signal(number, self._take_signal)
        return found

    def _take_signal(self, number: int, _: FrameType | None) -> None:
        """Note a signal, which `_spin` polls, and limit the end of the process."""
        # rclpy's own handlers would invalidate the context while a sample is being published.
        # This one must not complete the future: its lock may be held where the signal interrupts.
        if not self._signals:
            _limit_end()
        self._signals.append(number)

    def _check_parameters(self, parameters: Parameters) -> None:
        """Warn of parameters that no node has, and check that each live one is applied."""
        declared = {}
        for node in self._nodes:
            declared[node.get_fully_qualified_name()] = node.get_parameters_by_prefix('')
        for argument in parameters.unused(declared):
            node_log.warning(self._nodes[0], f'{argument}: {NO_EFFECT}')
        for node in self._nodes:
            node.check_live_settings()

    def _spin(self) -> SpmError | None:
        """Run the nodes until a signal arrives or they are done; return the future's result."""
        assert self._executor is not None
        while not (self._done.done() or self._signals):
            self._executor.spin_until_future_complete(self._done, timeout_sec=SPIN_TIMEOUT)
        result: SpmError | None = self._done.result()
        return result

    def _end(self) -> SpmError | None:
        """Destroy the nodes and leave the DDS domain; return an error of a node's end."""
        if not self._signals:
            _limit_end()
        # A second signal must not interrupt the clean-up.
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        try:
            self._clean_up()
        except SpmError as error:
            return error
        return None

    def _clean_up(self) -> None:
        """Destroy the nodes, end the log and leave the DDS domain, whatever fails of it."""
        with ExitStack() as stack:
            # The last step registered is done first: the driver, made last, calls the others.
            stack.callback(rclpy.utilities.try_shutdown)
            if self._executor is not None:
                stack.callback(self._executor.shutdown)
            # After the nodes, which log; before the shutdown, which gives rclpy its console again.
            stack.callback(node_log.end, LOG_TIMEOUT)
            for node in self._nodes:
                stack.callback(node.destroy_node)


def _init(command_line: list[str]) -> None:
    """Start rclpy and the log; InputError for arguments that rcl rejects."""
    # Fast DDS reads it when the first node is made.
    os.environ.update(dds_profile(os.environ))
    try:
        rclpy.init(
            args=[*command_line, '--ros-args', node_log.NO_CONSOLE],
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except (RuntimeError, UnicodeError) as error:  # from rcl: such as a wrong enclave
        reason = str(error).splitlines()[0]
        raise InputError(f'ROS arguments rejected: {reason}') from error
    node_log.begin(command_line)


def dds_profile(environment: Mapping[str, str]) -> dict[str, str]:
    """
    Return the variables that select the package's profile of Fast DDS.

    Sending through shared memory needs a mutex of each reader: a reader that is stopped while it
    holds it would stop samples, orientation and torques. So the profile has UDP alone. With the
    range LOCALHOST rmw would add shared memory again: there the profile itself has this host
    alone, and the range is SUBNET.

    And it announces the process four times a second: without it a process whose first
    announcement is lost waits 3 s for the next one.

    Parameters
    ----------
    environment : mapping
        The environment of the process, which may name a profile of the user.

    Returns
    -------
    dict
        Variables and values; empty if the user has a profile.

    """
    subnet = str(config_directory() / 'fastdds.xml')
    localhost = str(config_directory() / 'fastdds_localhost.xml')
    chosen = {environment[name] for name in PROFILE_VARIABLES if environment.get(name)}
    has_own = any(Path(name).exists() for name in PROFILES)
    if has_own or chosen - {subnet, localhost}:
        return {}
    # A static peer may be another host: only the range decides there.
    is_local = environment.get(RANGE) == 'LOCALHOST' and not environment.get(STATIC_PEERS)
    if is_local or localhost in chosen:
        profiles = dict.fromkeys(PROFILE_VARIABLES, localhost)
        return {**profiles, RANGE: 'SUBNET'}
    return dict.fromkeys(PROFILE_VARIABLES, subnet)
