# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A wrench's way to the torque frames, measured in a short form."""

import subprocess
import sys

from benchmarks.force_latency import report
from disturbance import Disturbance
from harness import ROOT
import numpy as np
import pytest


@pytest.mark.process
@pytest.mark.alone
def test_a_change_of_the_wrench_is_measured_on_the_bus():
    command = [sys.executable, '-m', 'benchmarks.force_latency', '--rate', '250', '--changes', '4']
    with Disturbance() as machine:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=180)
    machine.expect(done.returncode == 0, done.stderr)
    (row,) = [line for line in done.stdout.splitlines() if 'torque frame on the bus |' in line]
    _, _, changes, p50, _, _ = row.split('|')
    assert int(changes) == 4
    # inf: no frame has followed.
    machine.expect(np.isfinite(float(p50)), row)


@pytest.mark.parametrize(
    ('p99', 'verdict'),
    [
        pytest.param(0.004, '5 ms: met', id='in time'),
        pytest.param(0.006, '5 ms: not met', id='late'),
        pytest.param(np.inf, '5 ms: not met', id='without a frame'),
    ],
)
def test_the_reach_is_that_of_undisturbed_moments(p99, verdict):
    motor = np.array([p99, p99, 0.1])
    is_quiet = np.array([True, True, False])
    text = report(motor, motor, is_quiet, 500.0)
    assert verdict in text


def test_a_machine_that_is_never_undisturbed_meets_nothing():
    text = report(np.array([0.001]), np.array([0.002]), np.array([False]), 500.0)
    assert '| the torque frame on the bus, machine undisturbed | 0 | | |' in text
    assert 'not met' in text
