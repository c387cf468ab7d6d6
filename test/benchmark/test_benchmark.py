# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the pipeline: what it measures and writes, in a short form; no timings."""

import csv
import re
import subprocess
import sys

from harness import environment, ROOT
import pytest

PIPELINES = ['bare relay', 'driver and fkm', 'driver and fkm, all outputs observed',
             'bare relay and listener', 'three processes', 'master (composed)', 'bare, composed']


def benchmark(*args, timeout=300):
    return subprocess.run(
        [sys.executable, '-m', 'spm_haptic_master', 'benchmark', *args], cwd=ROOT,
        env=environment(), capture_output=True, text=True, timeout=timeout)


# Where the machine is so busy that not one orientation arrives in a second, there is no table.
@pytest.mark.flaky(reruns=2)
def test_compare_prints_tables_and_ratios_and_writes_a_line_a_run(tmp_path):
    done = benchmark('compare', '--seconds', '1', '--rounds', '1', '--output', str(tmp_path))
    assert (done.returncode, done.stderr) == (0, '')
    assert re.search(r'^\d{4}-\d\d-\d\d, \d+ x .*, Python \d.*, rclpy \d', done.stdout)
    for name in PIPELINES:
        assert re.search(rf'^\| {re.escape(name)} \| [\d.]+ \|', done.stdout, re.MULTILINE)
    assert len(re.findall(r'\d\.\d\d \(\d+\.\d\d \.\. \d+\.\d\d\)', done.stdout)) >= 10
    assert 'control thread, lateness' in done.stdout
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
    assert (tmp_path / 'latency.png').exists() != ('no picture' in done.stdout)


@pytest.mark.flaky(reruns=2)
def test_headroom_and_soak_say_what_holds(tmp_path):
    done = benchmark('headroom', 'soak', '--seconds', '1', '--minutes', '0.05',
                     '--output', str(tmp_path), '-p', 'realtime.gc:=disable')
    assert (done.returncode, done.stderr) == (0, '')
    for rate in (2000, 3000, 4000, 5000):
        assert f'master (composed), {rate} Hz' in done.stdout
        assert f'three processes, {rate} Hz' in done.stdout
    assert len(re.findall(r'holds (less than )?\d+ Hz', done.stdout)) == 2
    assert re.search(r'resident memory of master: [\d.]+ MiB, growth', done.stdout)
    assert re.search(r'drift of the grid: [-+][\d.]+ us', done.stdout)
    assert 'garbage collections of master: 0\n' in done.stdout


@pytest.mark.parametrize(('args', 'words'), [
    (('everything',), 'expected compare, headroom or soak'),
    (('compare', '-p', 'rate'), 'expected NAME:=VALUE'),
    (('compare', '-p', 'ratte:=1'), "parameter 'ratte'"),
    (('compare', '-p', 'rate:=500'), 'expected --rate'),
    (('compare', '--rounds', '0'), 'expected 1 or more'),
])
def test_a_wrong_argument_is_told_in_words(tmp_path, args, words):
    done = benchmark(*args, '--output', str(tmp_path))
    assert done.returncode == 1
    assert words in done.stderr
