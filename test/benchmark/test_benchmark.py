# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the pipeline: what it measures and writes, in a short form; no timings."""

import csv
import re
import signal

from disturbance import Disturbance
import numpy as np
import pytest
from spm_haptic_master.benchmark import browser_process, comparison, run, soak, stalls, view_load
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.benchmark.disturbances import Schedule
from spm_haptic_master.tools.benchmark import main

pytestmark = pytest.mark.process

PIPELINES = [case.name for case in comparison.CASES]
RATES = (3000.0,)
# What the benchmark prints where the machine is too busy for the pipeline.
OVERLOADED = ('overloaded', 'no orientation within', 'did not end within')
# Length of a run (s).
SECONDS = 1.0


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Shorten what is not measured, and leave the handling of signals as it was."""
    monkeypatch.setattr(run, 'SETTLE', 0.3)
    monkeypatch.setattr(comparison, 'HEADROOM_RATES', RATES)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture
def benchmark(capsys, tmp_path):
    """Run the command line; return its exit code, stdout and stderr."""
    def benchmark(*args):
        capsys.readouterr()
        code = main(['benchmark', *args, '--output', str(tmp_path)])
        return code, *capsys.readouterr()
    return benchmark


def measured(benchmark, *args):
    """Return what the benchmark prints; skip the test where the machine was too busy for it."""
    with Disturbance() as machine:
        code, out, err = benchmark(*args)
    machine.expect(not any(words in err for words in OVERLOADED), err)
    assert (code, err) == (0, '')
    return out


@pytest.mark.alone
@pytest.mark.evidence
def test_compare_prints_tables_and_ratios_and_writes_a_line_a_run(benchmark, tmp_path):
    out = measured(benchmark, 'compare', '--seconds', str(SECONDS), '--rounds', '1')
    assert re.search(r'^\d{4}-\d\d-\d\d, \d+ x .*, Python \d.*, rclpy \d', out)
    assert len(PIPELINES) == 8
    for name in PIPELINES:
        assert re.search(rf'^\| {re.escape(name)} \| [\d.]+ \|', out, re.MULTILINE)
    assert len(re.findall(r'\d\.\d\d \(\d+\.\d\d \.\. \d+\.\d\d\)', out)) >= 10
    assert 'control thread, lateness' in out
    with open(tmp_path / 'runs.csv') as file:
        rows = list(csv.DictReader(file))
    assert [row['pipeline'] for row in rows] == PIPELINES
    for row in rows:
        quantiles = [float(row[f'latency {name} (us)'])
                     for name in ('p50', 'p90', 'p99', 'p99.9', 'max')]
        assert 0.0 < quantiles[0] and quantiles == sorted(quantiles)
        assert 0.0 < float(row['rate (Hz)']) < 1100.0
        assert 0 <= int(row['lost']) <= int(row['made'])
        assert 'observer' in row['CPU (%)']
    assert {name.split()[0] for name in rows[4]['CPU (%)'].split(' ')[::2]} \
        == {'fkm', 'diagnostics', 'encoder_driver', 'observer'}
    assert (tmp_path / 'latency.png').exists() != ('no picture' in out)


@pytest.mark.alone
def test_headroom_prints_the_rates_held(benchmark):
    out = measured(benchmark, 'headroom', '--seconds', str(SECONDS))
    for rate in RATES:
        assert f'master (composed), {rate:g} Hz' in out
        assert f'three processes, {rate:g} Hz' in out
    assert len(re.findall(r'holds (less than )?\d+ Hz', out)) == 2


@pytest.mark.alone
@pytest.mark.evidence
@pytest.mark.skipif(browser_process.browser() is None, reason='no Chromium is installed')
def test_view_prints_ratios_and_the_load_of_view(benchmark, monkeypatch):
    pytest.importorskip('viser', reason='viser is not installed (extra view)')
    monkeypatch.setattr(view_load, 'LOAD_TIME', 3.0)
    out = measured(benchmark, 'view', '--seconds', str(SECONDS), '--rounds', '1')
    assert 'realtime.priority 10, as make run' in out \
        or 'realtime.priority 0: SCHED_FIFO is not permitted' in out
    assert re.search(r'view with a browser: p50 \d+ .*, view [\d.]+ % of a core, '
                     r'[\d.]+ -> [\d.]+ MiB', out)
    for case in ('view without a browser', 'view with a browser'):
        for name in ('p50', 'p99'):
            assert re.search(rf'{name}, {case}, over alone: [\d.]+ \(', out)
        assert re.search(rf'CPU of view, {case}: [\d.]+ % of a core', out)


@pytest.fixture
def short_soak(monkeypatch):
    """Shorten a soak: "minutes" of a second, and failures and visitors every few of them."""
    monkeypatch.setattr(soak, 'SCHEDULE', Schedule(
        minute=1.0, failure_period=4.0, failure=1.0, visit_period=7.0, visit=6.0))


@pytest.mark.alone
@pytest.mark.evidence
def test_soak_survives_failures_of_the_bus(benchmark, short_soak):
    out = measured(benchmark, 'soak', '--minutes', '14', '--apart')
    for name in ('recorder', 'fkm', 'diagnostics', 'encoder_driver'):
        assert re.search(rf'resident memory of {name}: [\d.]+ MiB, growth', out)
    assert re.search(r'5 minutes: \d+ orientations; resident memory, MiB: observer [\d.]+', out)
    for part in ('first', 'last'):
        assert re.search(
            rf'latency, {part} 1.4 minutes: (p50 \d+ p99 \d+|no orientation \(control)', out)
    cycles, made, missing, rejected, recorded = map(int, re.search(
        r'samples: (\d+) cycles, (\d+) made, (\d+) without .* (\d+) rejected by fkm; (\d+) ',
        out).groups())
    assert 0 <= missing < made <= cycles + 1
    assert 0 <= rejected
    assert recorded > 0
    # Of 14 s: bus-off after 4, power lost after 8, and again.
    failures, opened = map(int, re.search(
        r'failures of the bus: (\d+); bus opened again (\d+) times; first', out).groups())
    assert failures >= 2
    assert opened >= 1
    assert re.search(r'came and went: [1-9]', out)
    assert re.search(r'while the bus was alive: \d+.*; of these without a rejected sample: \d+',
                     out)


def test_stalls_are_counted_only_while_the_bus_is_alive():
    """Orientations from 0 to 10 s and 14 to 16 s; the bus is dead from 10 to 13 s."""
    arrivals = np.concatenate([np.arange(0.0, 10.0, 0.5), np.arange(14.5, 16.0, 0.5)])
    gaps, restarts = stalls.stalls(arrivals, [(0.0, 10.0), (13.0, 20.0)])
    assert gaps == [(13.0, 1.5), (15.5, 4.5)]
    assert restarts == [1.5]
    assert stalls.stalls(arrivals, [(0.0, 10.0), (11.0, 13.0)]) == ([(11.0, 2.0)], [2.0])


def test_a_gap_is_explained_by_samples_rejected_in_it():
    seconds = np.arange(0.0, 20.0)
    # Rejected from 4 to 8 s.
    rejections = np.column_stack([seconds * 1e9, np.clip(seconds - 4.0, 0.0, 4.0) * 100.0])
    assert stalls.unexplained([(5.2, 1.5), (12.0, 2.5)], rejections) == [2.5]
    assert stalls.unexplained([(5.2, 1.5)], rejections[:0]) == [1.5]


@pytest.mark.parametrize(('args', 'words'), [
    (('everything',), 'expected compare, headroom, soak, teleop'),
    (('compare', '-p', 'rate'), 'expected NAME:=VALUE'),
    (('compare', '--ros-args', '-p', 'ratte:=1'), "parameter 'ratte'"),
    (('compare', '-p', 'rate:=500'), 'expected --rate'),
    (('compare', '--rounds', '0'), 'expected 1 or more'),
])
def test_a_wrong_argument_is_reported(benchmark, args, words):
    code, _, err = benchmark(*args)
    assert code == 1
    assert words in err


def test_two_runs_on_one_host_have_different_domains_and_buses(start_python):
    """The second of two processes gets what the first has not reserved, ids or not."""
    code = ('from spm_haptic_master.benchmark.child_process import *\n'
            'import time; e = private_environment()\n'
            'print(e["ROS_DOMAIN_ID"], e["CAN_CONFIG"], bus_channel(), flush=True)\n'
            'time.sleep(600)')
    programs = [start_python('-c', code) for _ in range(4)]
    assert all(wait_until(lambda p=program: p.stdout.count('\n'), 60.0)
               for program in programs), programs[0].stderr
    for which in zip(*(program.stdout.split(maxsplit=1) for program in programs), strict=True):
        assert len(set(which)) == len(programs)
