# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Driver on one host, fkm and a listener on another, with a link between them that is cut.

The hosts are two network namespaces with a veth pair, each with a /dev/shm of its own, so that
Fast DDS has the network and nothing else. It takes root and iproute2; elsewhere it is skipped.
"""

from contextlib import ExitStack
import os
import shutil
import signal
import subprocess
import sys
import time

from benchmarks.pipeline.child_process import Program, wait_until
from benchmarks.pipeline.run import read_samples, READY
from disturbance import Disturbance
from harness import start_command
import numpy as np
import pytest
from spm_haptic_master.ros.runner import PROFILE_VARIABLES

pytestmark = [pytest.mark.process, pytest.mark.alone, pytest.mark.evidence]

# Time of 1 kHz before the cut and after it (s), and of the cut.
STEADY = 4.0
CUT = 3.0
# Time that discovery may take, and the recovery after a cut (s).
PATIENCE = 60.0
# Time after the cut in which samples on their way still arrive (s).
ON_ITS_WAY = 0.1
# Fewest samples of a second on a link that is up, and age of the oldest orientation (s).
COMPLETE = 800.0
OLDEST = 0.3
ADDRESSES = {'driver': '10.77.0.1/24', 'controller': '10.77.0.2/24'}


def ip(*args: str) -> None:
    subprocess.run(
        ['ip', *args],
        check=True,
        capture_output=True,
        text=True,
    )


class Host:
    """A network namespace, and what runs in it."""

    def __init__(self, name: str, stack: ExitStack):
        self.namespace = f'spm_{os.getpid()}_{name}'
        self.link = f'v{os.getpid()}{name[0]}'
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
            [
                'ip',
                'netns',
                'exec',
                self.namespace,
                sys.executable,
                '-m',
                *command,
            ],
            ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET',
            # The tests' own one is of this host alone.
            **dict.fromkeys(PROFILE_VARIABLES, ''),
        )
        self._stack.callback(program.kill)
        return program


@pytest.fixture
def hosts():
    """Give two hosts with a link between them."""
    if os.getuid() != 0 or shutil.which('ip') is None:
        pytest.skip('two network namespaces take root and iproute2')
    with ExitStack() as stack:
        try:
            both = {name: Host(name, stack) for name in ADDRESSES}
            ip(
                'link',
                'add',
                both['driver'].link,
                'type',
                'veth',
                'peer',
                'name',
                both['controller'].link,
            )
            for name, address in ADDRESSES.items():
                both[name].plug_in(address)
        except subprocess.CalledProcessError as error:
            pytest.skip(f'no network namespaces here: {error.stderr.strip()}')
        yield both['driver'], both['controller']


def run_with_a_cut(driver_host, host, directory):
    """Return arrivals and stamps (ns since the Unix epoch), when the link was cut and restored."""
    directory.mkdir()
    observer = host.start('benchmarks.pipeline.measured_process', 'observer', str(directory))
    programs = [
        driver_host.start('spm_haptic_master', 'encoder_driver', '-p', 'source:=sim'),
        host.start('spm_haptic_master', 'fkm'),
        observer,
    ]
    assert wait_until(lambda: READY in observer.stdout, PATIENCE), observer.stderr
    time.sleep(2.0 + STEADY)
    host.switch('down')
    cut = time.time_ns()
    time.sleep(CUT)
    restored = time.time_ns()
    host.switch('up')
    time.sleep(2.0 * STEADY)
    assert [program.stop(signal.SIGINT) for program in programs] == [0, 0, 0]
    return *read_samples(directory), cut, restored


def test_driver_on_another_host_and_a_link_that_is_cut(hosts, tmp_path, capsys):
    def complete(found):
        """Reliable: a link that is up loses only what a stalled machine costs."""
        arrivals, stamps, cut, restored = found
        # Nothing old comes out, whatever waited on the other side.
        return (arrivals - stamps).max() < OLDEST * 1e9 and all(
            ((stamps > begin) & (stamps < begin + STEADY * 1e9)).sum() > COMPLETE * STEADY
            for begin in (cut - STEADY * 1e9, restored + STEADY * 1e9)
        )

    with Disturbance() as machine:
        found = run_with_a_cut(*hosts, tmp_path / 'run')
    machine.expect(complete(found))
    arrivals, stamps, cut, restored = found
    back = (arrivals[arrivals >= restored][0] - restored) * 1e-9
    p50, p99 = np.percentile((arrivals - stamps)[arrivals < cut], [50.0, 99.0]) * 1e-3
    with capsys.disabled():
        print(
            f'\ntwo hosts: delay p50 {p50:.0f} p99 {p99:.0f} us; link cut for {CUT:g} s: '
            f'silence, and the first orientation {back:.2f} s after it was restored'
        )
    assert not ((arrivals >= cut + ON_ITS_WAY * 1e9) & (arrivals < restored)).any()
    assert (np.diff(stamps) > 0).all()
