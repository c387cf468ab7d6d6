# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the pipeline: what a run counts, what it prints and writes; no timings."""

import csv
import os
import platform
import re

import numpy as np
import pytest
from spm_haptic_master.benchmark import comparison
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.benchmark.comparison import disturbance, MASTER, ratio, table
from spm_haptic_master.benchmark.run import Case, count_samples, PipelineError, Run, running
from spm_haptic_master.ros.realtime import time_slice
from spm_haptic_master.tools.benchmark import main

MS = 1_000_000
ONE, OTHER = Case('one', ('fkm',)), Case('other', ('bare_relay',))


@pytest.mark.process
@pytest.mark.alone
@pytest.mark.evidence
def test_compare_prints_tables_and_ratios_and_writes_a_line_a_run(measured, tmp_path):
    out = measured(main, '--seconds', '1', '--rounds', '1', '--output', str(tmp_path))
    assert re.search(r'^\d{4}-\d\d-\d\d, \d+ x .*, Python \d.*, rclpy \d', out)
    pipelines = [case.name for case in comparison.CASES]
    assert re.findall(r'^\| (.*?) \| [\d.]+ \|', out, re.MULTILINE) == pipelines
    assert len(re.findall(r'\d\.\d\d \(\d+\.\d\d \.\. \d+\.\d\d\)', out)) == 11
    with open(tmp_path / 'runs.csv') as file:
        rows = list(csv.DictReader(file))
    assert [row['pipeline'] for row in rows] == pipelines
    for row in rows:
        quantiles = [float(row[f'latency {name} (us)'])
                     for name in ('p50', 'p90', 'p99', 'p99.9', 'max')]
        assert 0.0 < quantiles[0] and quantiles == sorted(quantiles)
        assert 0.0 < float(row['rate (Hz)']) < 1100.0
        assert 0 <= int(row['lost']) <= int(row['made'])
    assert [name.split()[0] for name in rows[4]['CPU (%)'].split(' ')[::2]] \
        == ['observer', 'fkm', 'diagnostics', 'encoder_driver']


@pytest.mark.process
def test_two_runs_on_one_host_have_different_domains_and_buses(start_python):
    code = ('from spm_haptic_master.benchmark.child_process import *\n'
            'import time; e = private_environment()\n'
            'print(e["ROS_DOMAIN_ID"], e["CAN_CONFIG"], bus_channel(), flush=True)\n'
            'time.sleep(600)')
    programs = [start_python('-c', code) for _ in range(2)]
    assert all(wait_until(lambda p=program: p.stdout.count('\n'), 60.0)
               for program in programs), programs[0].stderr
    for one, other in zip(*(program.stdout.split(maxsplit=1) for program in programs),
                          strict=True):
        assert one != other


def status(ms, sets, missed):
    return ms * MS, 'encoders', {'sets': str(sets), 'missed deadlines': str(missed)}


def test_samples_are_lost_that_were_counted_and_did_not_arrive():
    stamps = np.delete(np.arange(1, 100) * MS + 500_000, [40, 41])[::-1]
    statuses = [status(10, 1010, 3), (11 * MS, 'fkm', {}), status(50, 1050, 4),
                status(90, 1090, 7)]
    assert count_samples(statuses, stamps) == (80, 2, 4)
    # One of the window's ends is not certain: a sample was stamped just before it.
    assert count_samples([*statuses, (91_700_000, 'encoders', {'sets': '1200'})], stamps) == (
        80, 2, 4)
    with pytest.raises(PipelineError, match='fewer than two counts'):
        count_samples(statuses[:2], stamps)


def run_of(case, latency, lost=0, late=0.0, others=0.0):
    return Run(case, 1000.0, 2.0, latency + np.arange(101.0), np.zeros(101), 200, lost, 5,
               {case.processes[0]: 12.5}, others, np.full(10, late), [])


def test_the_table_has_medians_of_the_rounds_and_all_that_was_lost():
    runs = [run_of(ONE, 100.0), run_of(OTHER, 200.0), run_of(ONE, 300.0, lost=2),
            run_of(OTHER, 100.0), run_of(ONE, 200.0), run_of(OTHER, 400.0)]
    assert table(runs).splitlines()[2:] == [
        '| one | 50.5 | 250 | 290 | 299 | 300 | 300 | 2 of 600 | 15 | fkm 12.5 |',
        '| other | 50.5 | 250 | 290 | 299 | 300 | 300 | 0 of 600 | 15 | bare_relay 12.5 |']
    assert ratio(runs, ONE, OTHER, lambda run: run.latencies[0]) == '0.50 (0.50 .. 3.00)'


@pytest.mark.parametrize(('late', 'others', 'words'), [
    (1000.0, 20.0, ''), (1001.0, 20.0, 'control thread p99 1001 us late'),
    (1000.0, 21.0, 'other programs 21 % of a core')])
def test_a_machine_that_was_busy_is_named(late, others, words):
    assert disturbance(run_of(ONE, 100.0, late=late, others=others)) == words


@pytest.mark.process
@pytest.mark.skipif(os.getpriority(os.PRIO_PROCESS, 0) > 0,
                    reason='this process has less priority')
@pytest.mark.skipif(tuple(map(int, platform.release().split('.')[:2])) < (6, 12),
                    reason='Linux before 6.12 has no time slices')
def test_the_observer_has_the_slice_of_the_nodes(tmp_path):
    slice_ = 0.05  # s; that of nothing else
    # The rate is none of the observer's parameters: it would refuse it.
    parameters = {'source': 'sim', 'rate': '100.0', 'realtime.slice': str(slice_)}
    with running(MASTER, parameters, tmp_path) as processes:
        assert set(processes) == {'observer', 'master'}
        for process in processes.values():
            assert time_slice(process.pid) == pytest.approx(slice_, abs=1e-9)
