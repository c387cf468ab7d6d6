# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the realtime settings ask of Linux, and the warning where it refuses."""

import ctypes
from functools import partial
import gc
import os
import struct
from types import SimpleNamespace

import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.ros import node_log, realtime
from spm_haptic_master.ros.realtime import agreed, check_cpus

OFF = {
    'realtime.slice': 0.0,
    'realtime.priority': 0,
    'realtime.cpus': '',
    'realtime.lock_memory': False,
    'realtime.gc': 'normal',
}


class Linux:
    """The calls to the kernel, of a process that runs as most do; each test may deny some."""

    def __init__(self, monkeypatch):
        self.called = []
        self.denied = ()
        self.warnings = []
        self.policies = {}
        self.niceness = 0
        self.slices = {}
        self.machine = 'x86_64'
        for module, name, fake in (
            (os, 'sched_setaffinity', partial(self._set, 'sched_setaffinity')),
            (os, 'sched_setscheduler', partial(self._set, 'sched_setscheduler')),
            (os, 'sched_getscheduler', lambda of: self.policies.get(of, os.SCHED_OTHER)),
            (os, 'getpriority', lambda *_: self.niceness),
            (os, 'sched_getaffinity', lambda of: set() if of else {0, 1, 2, 3}),
            (os, 'listdir', lambda path: ['11', '12', '13']),
            (ctypes, 'CDLL', self._library),
            (ctypes, 'get_errno', lambda: self.error),
            (realtime.platform, 'machine', lambda: self.machine),
            (node_log, 'warning', lambda _, text: self.warnings.append(text)),
            *((gc, name, partial(self._call, name)) for name in ('collect', 'freeze', 'disable')),
        ):
            monkeypatch.setattr(module, name, fake)

    def _library(self, name, use_errno=False):
        self.error = 1 if use_errno else 0
        return SimpleNamespace(mlockall=partial(self._call, 'mlockall'), syscall=self._syscall)

    def _call(self, name, *given):
        if given[:1] == (13,):
            raise ProcessLookupError  # the thread has ended
        if name in self.denied:
            return -1
        self.called.append((name, *given))
        return 0

    def _set(self, name, thread, *given):
        if self._call(name, thread, *given):
            raise PermissionError

    def _syscall(self, number, thread, attributes, *rest):
        """Take sched_setattr and sched_getattr, as struct sched_attr of sched(7) has them."""
        if 'syscall' in self.denied:
            return -1
        if thread == 13:
            raise ProcessLookupError
        layout = struct.Struct('=IIQiIQQQ')
        assert (number, *rest) in ((314, 0), (315, 48, 0))
        if number == 314:
            *before, slice_, runtime, period = layout.unpack(attributes.raw)
            assert (*before, runtime, period) == (48, os.SCHED_OTHER, 0, self.niceness, 0, 0, 0)
            self.slices[thread] = slice_
        else:
            slice_ = 0 if 'slices' in self.denied else self.slices.get(11, 0)
            attributes.raw = layout.pack(48, 0, 0, 0, 0, slice_, 0, 0)
        return 0


@pytest.fixture
def linux(monkeypatch):
    return Linux(monkeypatch)


def test_every_thread_gets_what_the_settings_ask_for(linux):
    realtime.apply(None, OFF)
    assert (linux.called, linux.slices, linux.warnings) == ([], {}, [])
    realtime.apply(
        None,
        {
            'realtime.slice': 0.05,
            'realtime.priority': 7,
            'realtime.cpus': '1,3',
            'realtime.lock_memory': True,
            'realtime.gc': 'disable',
        },
    )
    parameter = os.sched_param(7)
    assert linux.called == [
        *(('sched_setaffinity', thread, {1, 3}) for thread in (11, 12)),
        *(('sched_setscheduler', thread, os.SCHED_FIFO, parameter) for thread in (11, 12)),
        ('mlockall', 3),
        ('collect',),
        ('freeze',),
        ('disable',),
    ]
    assert (linux.slices, linux.warnings) == ({11: 50_000_000, 12: 50_000_000}, [])
    # A thread of another policy keeps it, and all keep their niceness.
    linux.niceness = -5
    linux.policies = {12: os.SCHED_BATCH}
    linux.called.clear()
    realtime.apply(None, {**OFF, 'realtime.gc': 'freeze', 'realtime.slice': 1e-4})
    assert linux.called == [('collect',), ('freeze',)]
    assert linux.slices == {11: 100_000, 12: 50_000_000}


@pytest.mark.parametrize(
    ('changed', 'to', 'name', 'value', 'reason'),
    [
        (
            'denied',
            ('sched_setscheduler',),
            'priority',
            80,
            'priority 80 not set: SCHED_FIFO is not permitted; it requires CAP_SYS_NICE, or ',
        ),
        (
            'denied',
            ('mlockall',),
            'lock_memory',
            True,
            'lock_memory not set: Operation not permitted; it requires CAP_IPC_LOCK, or ',
        ),
        *(
            (changed, to, 'slice', 0.05, f'slice 0.05 not set: {reason}')
            for changed, to, reason in (
                ('denied', ('slices',), 'Linux before 6.12 has none'),
                ('denied', ('syscall',), 'Operation not permitted'),
                ('machine', 'm68k', 'unknown on m68k'),
                ('niceness', 1, 'the process has less priority (nice)'),
                ('policies', {0: os.SCHED_BATCH}, 'the process is not under SCHED_OTHER'),
            )
        ),
    ],
)
def test_what_a_rig_asks_for_and_cannot_have_is_a_warning(linux, changed, to, name, value, reason):
    """The default slice is for those who can have it; the others are as they would be without."""
    setattr(linux, changed, to)
    realtime.apply(None, {**OFF, 'realtime.slice': 1e-4})
    assert linux.warnings == []
    realtime.apply(None, {**OFF, f'realtime.{name}': value})
    (warning,) = linux.warnings
    assert warning.startswith(f'realtime.{reason}')


@pytest.mark.parametrize(
    ('text', 'cores'),
    [
        ('0', {0}),
        ('0,1', {0, 1}),
        ('0-1', {0, 1}),
        ('0,2-3', {0, 2, 3}),
    ],
)
def test_a_list_of_cores_is_read(linux, text, cores):
    assert check_cpus(text) == cores


@pytest.mark.parametrize(
    ('name', 'value', 'expected'),
    [
        ('slice', 9e-5, '0, or 0.0001 to 0.1'),
        *(
            ('cpus', text, 'cores .*, of those allowed: 0, 1, 2, 3')
            for text in ('x', '-1', '1-0', '0,', '4', '0-4', '0;1', '3,4')
        ),
    ],
)
def test_what_linux_does_not_have_is_refused(linux, name, value, expected):
    with pytest.raises(SettingError, match=f"'realtime.{name}' is {value!r}; expected {expected}"):
        realtime.apply(None, {**OFF, f'realtime.{name}': value})


def test_nodes_of_one_process_agree():
    assert agreed([OFF, OFF]) == OFF
    assert agreed([OFF, {**OFF, 'realtime.priority': 80}]) == {
        **OFF,
        'realtime.priority': 80,
        'realtime.slice': 0.0,
    }
    with pytest.raises(SettingError, match='the same on every node of one process'):
        agreed([{**OFF, 'realtime.gc': 'disable'}, {**OFF, 'realtime.gc': 'freeze'}])
