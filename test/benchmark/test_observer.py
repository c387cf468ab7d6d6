# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The observer of the benchmark is scheduled as the processes that it observes."""

import os
import platform

import pytest
from spm_haptic_master.benchmark.comparison import MASTER
from spm_haptic_master.benchmark.run import running
from spm_haptic_master.ros.realtime import time_slice

# Slice that nothing else has (s).
SLICE = 0.05


@pytest.mark.process
@pytest.mark.skipif(os.getpriority(os.PRIO_PROCESS, 0) > 0,
                    reason='this process has less priority')
@pytest.mark.skipif(tuple(map(int, platform.release().split('.')[:2])) < (6, 12),
                    reason='Linux before 6.12 has no time slices')
def test_the_observer_has_the_slice_of_the_nodes(tmp_path):
    # The rate is none of the observer's parameters: it would refuse it.
    parameters = {'rate': '100.0', 'realtime.slice': str(SLICE)}
    with running(MASTER, parameters, tmp_path) as processes:
        assert set(processes) == {'observer', 'master'}
        for process in processes.values():
            assert time_slice(process.pid) == pytest.approx(SLICE, abs=1e-9)
