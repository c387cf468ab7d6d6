# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Driver on one host, fkm and a listener on another, with a link between them that is cut.

The hosts are two network namespaces with a veth pair, each with a /dev/shm of its own, so that
Fast DDS has the network and nothing else. It takes root and iproute2; elsewhere it is skipped.
"""

from contextlib import ExitStack
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time
from typing import NamedTuple

from disturbance import measure_undisturbed
from harness import start_command
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import Program, wait_until
from spm_haptic_master.benchmark.run import count_samples, read_samples, read_statuses, READY

pytestmark = [pytest.mark.process, pytest.mark.alone, pytest.mark.evidence]

# Time of 1 kHz before the cut and after it (s), and of the cut.
STEADY, CUT = 4.0, 3.0
# Time that discovery may take, and the recovery after a cut (s).
PATIENCE = 60.0
# Time after the cut in which samples on their way still arrive (s).
ON_ITS_WAY = 0.1
# Part of the samples that a link may lose, and age of the oldest orientation (s).
LOST, OLDEST = 0.02, 0.3
ADDRESSES = {'driver': '10.77.0.1/24', 'controller': '10.77.0.2/24'}


def ip(*args: str) -> None:
    subprocess.run(['ip', *args], check=True, capture_output=True, text=True)


class Host:
    """A network namespace, and what runs in it."""

    def __init__(self, name: str, shared_memory: Path, stack: ExitStack):
        self.namespace = f'spm_{os.getpid()}_{name}'
        self.link = f'v{os.getpid()}{name[0]}'
        self._shared_memory = shared_memory
        shared_memory.mkdir()
        self._stack = stack
        ip('netns', 'add', self.namespace)
        stack.callback(ip, 'netns', 'del', self.namespace)

    def plug_in(self, address: str) -> None:
        """Bring its end of the link up."""
        ip('link', 'set', self.link, 'netns', self.namespace)
        ip('-n', self.namespace, 'address', 'add', address, 'dev', self.link)
        ip('-n', self.namespace, 'link', 'set', 'lo', 'up')
        self.switch('up')

    def switch(self, state: str) -> None:
        """Put its end of the link 'up' or 'down'."""
        ip('-n', self.namespace, 'link', 'set', self.link, state)

    def start(self, *command: str) -> Program:
        """Start a Python module of the package; it is killed at the end."""
        program = start_command(
            ['ip', 'netns', 'exec', self.namespace, 'sh', '-c',
             'mount --bind "$0" /dev/shm && exec "$@"', str(self._shared_memory),
             sys.executable, '-m', *command], ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET')
        self._stack.callback(program.kill)
        return program


@pytest.fixture
def hosts(tmp_path):
    """Give two hosts with a link between them."""
    if os.getuid() != 0 or shutil.which('ip') is None:
        pytest.skip('two network namespaces take root and iproute2')
    with ExitStack() as stack:
        try:
            both = {name: Host(name, tmp_path / name, stack) for name in ADDRESSES}
            ip('link', 'add', both['driver'].link, 'type', 'veth', 'peer', 'name',
               both['controller'].link)
            for name, address in ADDRESSES.items():
                both[name].plug_in(address)
        except subprocess.CalledProcessError as error:
            pytest.skip(f'no network namespaces here: {error.stderr.strip()}')
        yield both['driver'], both['controller']


class Steady(NamedTuple):
    """Delays of the orientations that arrived in a time (us), and the driver's counts in it."""

    name: str
    delays: np.ndarray
    made: int
    lost: int
    missed: int

    def __str__(self):
        p50, p99, most = np.percentile(self.delays, [50.0, 99.0, 100.0])
        return (f'{self.name}: delay p50 {p50:.0f} p99 {p99:.0f} max {most:.0f} us, '
                f'lost {self.lost} of {self.made}, deadlines missed {self.missed}')

    @property
    def complete(self):
        # Reliable: a link that is up loses only what a stalled machine costs.
        return len(self.delays) > 0.8 * 1000.0 * STEADY and self.lost <= LOST * self.made


class Cut(NamedTuple):
    """A link that was cut: ns since the Unix epoch, and the times around it."""

    arrivals: np.ndarray
    stamps: np.ndarray
    cut: int
    restored: int
    discovery: float
    steady: list[Steady]

    @property
    def complete(self):
        # Nothing old comes out, whatever waited on the other side.
        return all(steady.complete for steady in self.steady) \
            and (self.arrivals - self.stamps).max() < OLDEST * 1e9


def run_with_a_cut(driver_host, host, directory) -> Cut:
    directory.mkdir()
    began = time.monotonic()
    observer = host.start('spm_haptic_master.benchmark.measured_process', 'observer',
                          str(directory))
    fkm = host.start('spm_haptic_master', 'fkm')
    driver = driver_host.start(
        'spm_haptic_master', 'encoder_driver', '-p', 'source:=sim')
    assert wait_until(lambda: READY in observer.stdout, PATIENCE), observer.stderr
    discovery = time.monotonic() - began
    time.sleep(2.0)
    steady = time.time_ns()
    time.sleep(STEADY)
    host.switch('down')
    cut = time.time_ns()
    time.sleep(CUT)
    restored = time.time_ns()
    host.switch('up')
    time.sleep(STEADY)
    late = time.time_ns()
    time.sleep(STEADY)
    done = time.time_ns()
    time.sleep(1.5)
    assert [program.stop(signal.SIGINT) for program in (driver, fkm, observer)] == [0, 0, 0]

    arrivals, stamps = read_samples(directory)
    statuses = read_statuses(directory)
    both = []
    for name, begin, until in (('before the cut', steady, cut), ('after it', late, done)):
        inside = (arrivals >= begin) & (arrivals < until)
        counts = count_samples([each for each in statuses if begin <= each[0] < until], stamps)
        both.append(Steady(name, (arrivals - stamps)[inside] * 1e-3, *counts))
    return Cut(arrivals, stamps, cut, restored, discovery, both)


def test_driver_on_another_host_and_a_link_that_is_cut(hosts, tmp_path, capsys):
    found = measure_undisturbed(
        lambda: run_with_a_cut(*hosts, tmp_path / 'run'), lambda found: found.complete)
    back = found.arrivals[found.arrivals >= found.restored][0] - found.restored
    with capsys.disabled():
        print(f'\ntwo hosts: first orientation {found.discovery:.1f} s after starting',
              *found.steady, f'link cut for {CUT:g} s: silence, and the first orientation again '
              f'{back * 1e-9:.2f} s after it was restored', sep='\n')
    assert found.complete
    assert not ((found.arrivals >= found.cut + ON_ITS_WAY * 1e9)
                & (found.arrivals < found.restored)).any()
    assert (np.diff(found.stamps) > 0).all()
