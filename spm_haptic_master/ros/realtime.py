# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Settings of the process: scheduling, cores, locked memory, garbage collection.

Since Linux 6.12 a thread under SCHED_OTHER with a shorter time slice preempts others when it
wakes; it needs no privilege. Neither Python nor glibc before 2.41 has the call.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import ctypes
from functools import partial
import gc
import os
import platform
import struct
from typing import Any

from rclpy.node import Node
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.nodes import REALTIME_SETTINGS
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import node_log

SLICE = REALTIME_SETTINGS[0]
# Shortest slice that Linux has (s).
SHORTEST = 1e-4
# Flags of mlockall (sys/mman.h): pages mapped now, and pages mapped later.
MCL_CURRENT = 1
MCL_FUTURE = 2
# Numbers of the system calls sched_setattr and sched_getattr, by machine.
SET_ATTRIBUTES = {
    'x86_64': 314,
    'aarch64': 274,
}
GET_ATTRIBUTES = {
    'x86_64': 315,
    'aarch64': 275,
}
# `struct sched_attr` (sched(7)) in its first version: size, policy, flags, nice, priority,
# runtime, deadline, period (ns).
ATTRIBUTES = struct.Struct('=IIQiIQQQ')


def agreed(values: Sequence[Values]) -> dict[str, Any]:
    """
    Return the settings of a process, which each of its nodes may give.

    Parameters
    ----------
    values : sequence of mapping
        The checked values of each node.

    Returns
    -------
    dict
        A value of each setting of the process, by name.

    Raises
    ------
    SettingError
        Two nodes have different values, other than the default.

    """
    result: dict[str, Any] = {}
    for setting in REALTIME_SETTINGS:
        given = {each[setting.name] for each in values}
        chosen = given - {setting.default}
        if len(chosen) > 1:
            raise SettingError(
                name=setting.name,
                value=sorted(chosen),
                expected='the same on every node of one process',
            )
        result[setting.name] = setting.default
        if chosen:
            result[setting.name] = chosen.pop()
    return result


def check_cpus(text: str) -> set[int]:
    """
    Return the cores of a list.

    Parameters
    ----------
    text : str
        Numbers and ranges, such as '0,2-3'.

    Returns
    -------
    set of int
        The cores.

    Raises
    ------
    SettingError
        The text is no such list, or this process may not run on one of them.

    """
    allowed = os.sched_getaffinity(0)
    with suppress(ValueError):
        cores: set[int] = set()
        for part in text.split(','):
            first, _, last = part.partition('-')
            span = range(int(first), int(last or first) + 1)
            # One by one: the end of a span may be any number.
            if not span or not all(core in allowed for core in span):
                raise ValueError(text)
            cores.update(span)
        return cores
    listed = ', '.join(map(str, sorted(allowed)))
    raise SettingError(
        name='realtime.cpus',
        value=text,
        expected=f"cores such as '0' or '0,2-3', of those allowed: {listed}",
    )


def apply(node: Node, values: Values) -> None:
    """
    Set up this process and its threads.

    Parameters
    ----------
    node : Node
        Warns where a privilege is missing.
    values : mapping
        Checked values of the settings of a process, as of `agreed`.

    Raises
    ------
    SettingError
        A core is not allowed, or the time slice is too short.

    """
    warn = partial(node_log.warning, node)
    if values['realtime.cpus']:
        cores = check_cpus(values['realtime.cpus'])
        _for_each_thread(lambda thread: os.sched_setaffinity(thread, cores))
    _set_slice(values['realtime.slice'], warn)
    if values['realtime.priority']:
        parameter = os.sched_param(values['realtime.priority'])
        try:
            _for_each_thread(
                lambda thread: os.sched_setscheduler(thread, os.SCHED_FIFO, parameter)
            )
        except PermissionError:
            warn(
                f'realtime.priority {parameter.sched_priority} not set: SCHED_FIFO is not '
                "permitted; it requires CAP_SYS_NICE, or 'rtprio' for this user in "
                '/etc/security/limits.conf'
            )
    if values['realtime.lock_memory']:
        _lock_memory(warn)
    if values['realtime.gc'] != 'normal':
        gc.collect()
        gc.freeze()
        if values['realtime.gc'] == 'disable':
            gc.disable()


def _lock_memory(warn: Callable[[str], object]) -> None:
    """Keep the pages of this process in memory, or say why not."""
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(MCL_CURRENT | MCL_FUTURE):
        reason = os.strerror(ctypes.get_errno())
        warn(
            f'realtime.lock_memory not set: {reason}; it requires '
            "CAP_IPC_LOCK, or 'memlock unlimited' for this user in /etc/security/limits.conf"
        )


def _set_slice(seconds: float, warn: Callable[[str], object]) -> None:
    """Set the time slice of all threads; the default one only where that is possible."""
    if not seconds:
        return
    if seconds < SHORTEST:
        raise SettingError(
            name=SLICE.name,
            value=seconds,
            expected=f'0, or {SHORTEST:g} to {SLICE.maximum:g}',
        )
    length = round(1e9 * seconds)
    try:
        # A process that was started with less priority is not to preempt others.
        if os.getpriority(os.PRIO_PROCESS, 0) > 0:
            raise OSError('the process has less priority (nice)')
        if os.sched_getscheduler(0) != os.SCHED_OTHER:
            raise OSError('the process is not under SCHED_OTHER')
        _for_each_thread(lambda thread: _set_thread_slice(thread, length))
        found = ctypes.create_string_buffer(ATTRIBUTES.size)
        _call(GET_ATTRIBUTES, 0, found, ATTRIBUTES.size, 0)
        if ATTRIBUTES.unpack(found.raw)[5] != length:
            raise OSError('Linux before 6.12 has none')
    except OSError as error:
        if seconds != SLICE.default:
            warn(f'realtime.slice {seconds:g} not set: {error.strerror or error}')


def _for_each_thread(action: Callable[[int], None]) -> None:
    """Call an action with the id of each thread of this process."""
    for thread in os.listdir('/proc/self/task'):
        with suppress(ProcessLookupError):  # the thread has ended
            action(int(thread))


def _set_thread_slice(thread: int, length: int) -> None:
    """Set the time slice of a thread under SCHED_OTHER, ns; Linux before 6.12 ignores it."""
    if os.sched_getscheduler(thread) == os.SCHED_OTHER:
        niceness = os.getpriority(os.PRIO_PROCESS, thread)
        attributes = ATTRIBUTES.pack(ATTRIBUTES.size, os.SCHED_OTHER, 0, niceness, 0, length, 0, 0)
        buffer = ctypes.create_string_buffer(attributes, len(attributes))
        _call(SET_ATTRIBUTES, thread, buffer, 0)


def _call(numbers: Mapping[str, int], *values: object) -> None:
    """Make a system call by its numbers on machines; OSError if it fails."""
    machine = platform.machine()
    if machine not in numbers:
        raise OSError(f'unknown on {machine}')
    library = ctypes.CDLL(None, use_errno=True)
    if library.syscall(numbers[machine], *values):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
