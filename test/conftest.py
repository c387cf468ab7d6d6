# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures of several rooms; every test run has a DDS domain and a CAN bus of its own."""

from multiprocessing.process import BaseProcess
import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest
from spm_haptic_master.benchmark import child_process

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))
os.environ.update(child_process.private_environment())

# Marks of tests that may start programs: they are not of `make quick`.
MARKS = ('process', 'packaging', 'linter')
# The test that runs, where it has none of the marks.
unmarked = []


def only_marked(start):
    """Return what starts a process, unless a file of the project does in a test without a mark."""
    def started(self, *args, **given):
        frame = sys._getframe(1)
        while frame.f_code.co_filename == subprocess.__file__:
            frame = frame.f_back
        file = Path(frame.f_code.co_filename)
        if unmarked and ROOT in file.parents and ROOT / '.venv' not in file.parents:
            pytest.fail(f'{unmarked[0]} starts a process and is not marked `process`')
        return start(self, *args, **given)
    return started


subprocess.Popen.__init__ = only_marked(subprocess.Popen.__init__)
BaseProcess.start = only_marked(BaseProcess.start)

# As from a terminal; what a shell runs in the background, and all it starts, would ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Note a test that may not start programs."""
    unmarked[:] = [] if any(map(item.get_closest_marker, MARKS)) else [item.nodeid]
    yield
    unmarked.clear()


@pytest.fixture
def start():
    """Start executables of the package; those still running at the test's end are stopped."""
    from harness import start_program

    programs = []

    def start(name, *args, **kwargs):
        programs.append(start_program(name, *args, **kwargs))
        return programs[-1]

    yield start
    for program in programs:
        program.stop()


@pytest.fixture
def start_python():
    """Start Python with arguments; what still runs at the test's end is killed."""
    from harness import start_command

    programs = []

    def start_python(*args, **kwargs):
        programs.append(start_command([sys.executable, *args], **kwargs))
        return programs[-1]

    yield start_python
    for program in programs:
        program.kill()


@pytest.fixture
def observer():
    """Give a node that collects messages."""
    from harness import Observer

    observer = Observer()
    yield observer
    observer.close()


@pytest.fixture(scope='session')
def bus_channel():
    """Give the channel of this run's own CAN bus between processes."""
    return child_process.bus_channel()


def pytest_terminal_summary(terminalreporter):
    """Print how many measurements a busy machine has prevented."""
    from disturbance import number_of_skips

    skipped = number_of_skips(terminalreporter.stats.get('skipped', ()))
    terminalreporter.write_line(f'skipped because the machine was too busy: {skipped}')
