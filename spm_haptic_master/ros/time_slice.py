# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The time slice of a thread under SCHED_OTHER, from Linux 6.12 on.

A thread with a shorter slice preempts those with longer ones when it wakes, as long as it has not
used more than its share of the processor; it needs no privilege. Neither Python nor its C library
(before glibc 2.41) has the call.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct

# Slices that Linux has (s): it takes the nearest of them.
SHORTEST, LONGEST = 1e-4, 0.1
# Numbers of the system calls sched_setattr and sched_getattr, by machine; of 64 bits only.
CALLS = {'x86_64': (314, 315), 'aarch64': (274, 275)}
# `struct sched_attr` (sched(7)) in its first version: size, policy, flags, nice, priority,
# runtime, deadline, period (ns).
ATTRIBUTES = struct.Struct('=IIQiIQQQ')


def set_time_slice(thread: int, seconds: float) -> None:
    """
    Set the time slice of a thread (id; 0: this one) under SCHED_OTHER; leave other policies.

    Linux before 6.12 ignores it. OSError: not permitted, no such thread, or another system than
    Linux on x86_64 and aarch64.
    """
    if os.sched_getscheduler(thread) != os.SCHED_OTHER:
        return
    attributes = ATTRIBUTES.pack(ATTRIBUTES.size, os.SCHED_OTHER, 0,
                                 os.getpriority(os.PRIO_PROCESS, thread), 0,
                                 round(1e9 * seconds), 0, 0)
    _call(0, thread, ctypes.create_string_buffer(attributes, len(attributes)), 0)


def time_slice(thread: int) -> float:
    """Return the time slice of a thread under SCHED_OTHER, s; 0 before Linux 6.12."""
    buffer = ctypes.create_string_buffer(ATTRIBUTES.size)
    _call(1, thread, buffer, ATTRIBUTES.size, 0)
    return 1e-9 * float(ATTRIBUTES.unpack(buffer.raw)[5])


def _call(which: int, *values: object) -> None:
    machine = platform.machine()
    bits = 8 * struct.calcsize('P')
    if platform.system() != 'Linux' or machine not in CALLS or bits != 64:
        raise OSError(f'unknown on {platform.system()} {machine}, {bits} bit')
    if ctypes.CDLL(None, use_errno=True).syscall(CALLS[machine][which], *values):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
