# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every test run speaks in a DDS domain of its own, on this host only."""

import os
from pathlib import Path
import signal
import sys

import pytest

sys.path.insert(0, str(Path(__file__).parent))

# Domains 1 .. 101 keep clear of the ephemeral ports on Linux; 0 is everybody's.
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 101)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# A socket on Linux hears every multicast group that somebody on the host has joined on its port:
# only a port of its own keeps one run's udp_multicast bus from another's.
os.environ['CAN_CONFIG'] = '{"port": %d}' % (20000 + os.getpid() % 10000)


# As from a terminal; what a shell runs in the background, and all it starts, would ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def start():
    """Start executables of the package; those still running at the test's end are stopped."""
    from harness import Program

    programs = []

    def start(name, *args, **kwargs):
        programs.append(Program(name, *args, **kwargs))
        return programs[-1]

    yield start
    for program in programs:
        program.stop()


@pytest.fixture
def observer():
    """Give a node that listens."""
    from harness import Observer

    observer = Observer()
    yield observer
    observer.close()


@pytest.fixture
def bus_channel():
    """Give a multicast group of this run's own: a CAN bus between processes."""
    pid = os.getpid()
    return f'239.74.{pid // 250 % 250}.{1 + pid % 250}'
