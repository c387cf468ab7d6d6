# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The observer of the benchmark is scheduled as the processes that it observes."""

import os

import pytest
from spm_haptic_master.benchmark.comparison import MASTER
from spm_haptic_master.benchmark.pipeline import running


@pytest.mark.process
def test_the_observer_has_the_process_settings_of_the_nodes(tmp_path):
    core = max(os.sched_getaffinity(0))
    # The rate is none of the observer's parameters: it would refuse it.
    parameters = {'rate': '100.0', 'realtime.cpus': f"'{core}'"}
    with running(MASTER, parameters, tmp_path) as processes:
        assert set(processes) == {'observer', 'master'}
        for process in processes.values():
            for thread in os.listdir(f'/proc/{process.pid}/task'):
                assert os.sched_getaffinity(int(thread)) == {core}
