# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures of several rooms; every test run has a DDS domain and a CAN bus of its own."""

import os
from pathlib import Path
import signal
import sys

import pytest
from spm_haptic_master.benchmark import child_process

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))
os.environ.update(child_process.private_environment())

# As from a terminal; what a shell runs in the background, and all it starts, would ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)


def ended(begin, end):
    """Yield what begins a program; each that it has begun is ended at the test's end."""
    programs = []

    def start(*args, **kwargs):
        programs.append(begin(*args, **kwargs))
        return programs[-1]

    yield start
    for program in programs:
        end(program)


@pytest.fixture
def start():
    """Start executables of the package; those still running at the test's end are stopped."""
    from harness import start_program

    yield from ended(start_program, child_process.Program.stop)


@pytest.fixture
def start_python():
    """Start Python with arguments; what still runs at the test's end is killed."""
    from harness import start_command

    yield from ended(lambda *args, **kwargs: start_command([sys.executable, *args], **kwargs),
                     child_process.Program.kill)


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
