# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the pipeline: what it measures and writes, in a short form; no timings."""

import csv
import re

import pytest
from spm_haptic_master.benchmark import comparison
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.tools.benchmark import main

pytestmark = pytest.mark.process


@pytest.mark.alone
@pytest.mark.evidence
def test_compare_prints_tables_and_ratios_and_writes_a_line_a_run(measured, tmp_path):
    out = measured(main, 'compare', '--seconds', '1', '--rounds', '1', '--output', str(tmp_path))
    assert re.search(r'^\d{4}-\d\d-\d\d, \d+ x .*, Python \d.*, rclpy \d', out)
    pipelines = [case.name for case in comparison.CASES]
    assert re.findall(r'^\| (.*?) \| [\d.]+ \|', out, re.MULTILINE) == pipelines
    assert len(re.findall(r'\d\.\d\d \(\d+\.\d\d \.\. \d+\.\d\d\)', out)) == 13
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
    assert (tmp_path / 'latency.png').exists() != ('no picture' in out)


@pytest.mark.alone
def test_headroom_prints_the_rates_held(measured, monkeypatch, tmp_path):
    monkeypatch.setattr(comparison, 'HEADROOM_RATES', (3000.0,))
    out = measured(main, 'headroom', '--seconds', '1', '--output', str(tmp_path))
    for case in ('master (composed)', 'three processes'):
        assert f'{case}, 3000 Hz' in out
    assert len(re.findall(r'holds (less than )?\d+ Hz', out)) == 2


@pytest.mark.parametrize(('args', 'words'), [
    (('everything',), 'expected compare, headroom'),
    (('compare', '-p', 'rate'), 'expected NAME:=VALUE'),
    (('compare', '--ros-args', '-p', 'ratte:=1'), "parameter 'ratte'"),
    (('compare', '-p', 'rate:=500'), 'expected --rate'),
])
def test_a_wrong_argument_is_reported(output_of, args, words):
    code, _, err = output_of(main, *args)
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
