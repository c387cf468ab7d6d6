# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig's knobs for the process: scheduling, cores, locked memory, garbage collection."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import ctypes
import gc
import os

from rclpy.node import Node

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.nodes.parameters import REALTIME_SETTINGS
from spm_haptic_master.settings import Values

# sys/mman.h: what is mapped now, and what will be.
MCL_CURRENT, MCL_FUTURE = 1, 2


def agreed(values: Sequence[Mapping[str, object]]) -> dict[str, object]:
    """
    Return the settings of a process from those of its nodes: the one that is not the default.

    Raises
    ------
    SettingError
        Two nodes of the process ask for different ones.

    """
    result = {}
    for setting in REALTIME_SETTINGS:
        wanted = {each[setting.name] for each in values} - {setting.default}
        if len(wanted) > 1:
            raise SettingError(setting.name, sorted(wanted),
                               'the same on every node of one process')
        result[setting.name] = wanted.pop() if wanted else setting.default
    return result


def check_cpus(text: str) -> set[int]:
    """
    Return the cores that a list such as '2' or '0,2-3' names.

    Raises
    ------
    SettingError
        For what is no such list, or a core that this process may not have.

    """
    cores: set[int] = set()
    allowed = os.sched_getaffinity(0)
    try:
        for part in text.split(','):
            first, _, last = part.partition('-')
            cores |= set(range(int(first), int(last or first) + 1))
    except ValueError:
        cores = set()
    if not cores or not cores <= allowed:
        raise SettingError('realtime.cpus', text, "cores such as '0' or '0,2-3', of those allowed: "
                           + ', '.join(map(str, sorted(allowed))))
    return cores


def apply(node: Node, values: Values) -> None:
    """
    Set the process up; a privilege that is missing is told by a warning of `node`.

    Every thread there is gets priority and cores, and those to come inherit them.

    Parameters
    ----------
    node : Node
        Who warns.
    values : mapping
        Value of each of `REALTIME_SETTINGS`, by name.

    Raises
    ------
    SettingError
        For cores that do not exist.

    """
    warn = node.get_logger().warning
    if values['realtime.cpus']:
        cores = check_cpus(values['realtime.cpus'])
        _for_each_thread(lambda thread: os.sched_setaffinity(thread, cores))
    if values['realtime.priority']:
        parameter = os.sched_param(values['realtime.priority'])
        try:
            _for_each_thread(
                lambda thread: os.sched_setscheduler(thread, os.SCHED_FIFO, parameter))
        except PermissionError:
            warn(f'realtime.priority {parameter.sched_priority} not set: no right to SCHED_FIFO; '
                 "it takes CAP_SYS_NICE, or 'rtprio' for this user in /etc/security/limits.conf")
    if values['realtime.lock_memory']:
        _lock_memory(warn)
    if values['realtime.gc'] != 'normal':
        gc.collect()
        gc.freeze()
        if values['realtime.gc'] == 'disable':
            gc.disable()


def _for_each_thread(action: Callable[[int], None]) -> None:
    for thread in os.listdir('/proc/self/task'):
        with suppress(ProcessLookupError):  # it ended meanwhile
            action(int(thread))


def _lock_memory(warn) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE):
        warn(f'realtime.lock_memory not set: {os.strerror(ctypes.get_errno())}; it takes '
             "CAP_IPC_LOCK, or 'memlock unlimited' for this user in /etc/security/limits.conf")
