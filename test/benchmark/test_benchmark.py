# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the pipeline: what a run counts, what it prints and writes; no timings."""

import csv
from dataclasses import replace
import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

from benchmarks.pipeline import __main__ as pipeline_command
from benchmarks.pipeline import child_process, comparison, measured_process, run
from benchmarks.pipeline.__main__ import main
from benchmarks.pipeline.child_process import Program, wait_until
from benchmarks.pipeline.comparison import disturbance, machine, published
from benchmarks.pipeline.run import Case, count_samples, measure, PipelineError, Run
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import QuaternionStamped
import numpy as np
import pytest
import rclpy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from spm_haptic_master.parameters.resolver import Parameters

MS = 1_000_000
ONE = Case('one', ('fkm',))


@pytest.mark.process
@pytest.mark.alone
@pytest.mark.evidence
def test_all_pipelines_run(measured, tmp_path):
    # The driver reports its counts once a second, and two of them are needed.
    out = measured(main, '--seconds', '2', '--rounds', '1', '--output', str(tmp_path))
    assert re.findall(r'^\| (.*?) \| [\d.]+ \|', out, re.MULTILINE) == [
        case.name for case in comparison.CASES
    ]


class Pipeline:
    """Programs that do not run: an observer that has received every sample but one."""

    def __init__(self, monkeypatch):
        self.started = {}
        self.signals = []
        # Exit codes of programs that end at once, in the window, and at the end.
        self.early = {}
        self.within = {}
        self.late = {}
        self.directory = None
        self.output = run.READY
        self.samples = None
        self.slept = []
        self.ticks = [
            {7: (1, 100), 8: (1, 10), 9: (1, 1), 10: (1, 50), os.getpid(): (1, 5)},
            {7: (1, 130), 8: (1, 30), 9: (1, 41), 10: (1, 75), os.getpid(): (1, 900)},
        ]
        self.now = 10**18
        monkeypatch.setattr(run, 'start_process', self.start)
        monkeypatch.setattr(run, 'all_processes', lambda: self.ticks.pop(0))
        monkeypatch.setattr(run, 'Control', lambda: SimpleNamespace(stop=lambda: np.zeros(3)))
        monkeypatch.setattr(run, 'wait_until', lambda condition, seconds: condition())
        monkeypatch.setattr(
            run, 'time', SimpleNamespace(time_ns=lambda: self.now, sleep=self.sleep)
        )

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += round(seconds * 1e9)

    def start(self, name, directory, parameters):
        self.directory, self.started[name] = directory, parameters

        def poll():
            ends = self.late if self.signals else self.within if self.slept else self.early
            return ends.get(name, 0 if self.signals else None)

        def wait():
            if poll() == -signal.SIGKILL:
                raise TimeoutError('was killed')

        return SimpleNamespace(
            pid=7 + len(self.started) - 1,
            stdout=self.output,
            stderr=f'{name} says',
            wait=wait,
            poll=poll,
            send_signal=lambda number: self.signals.append((name, number)),
        )

    def during(self, seconds, processes, directory):
        """Write what an observer writes: samples 1 ms apart, 0.4 ms old, one of which is lost."""
        stamps = np.delete(self.now + np.arange(-50, 2050) * MS, 500)
        begin = int(stamps[0])
        margin = round(run.STATUS_PERIOD * 1e9)
        ends = self.now - margin, self.now + round(seconds * 1e9) + margin
        self.sleep(seconds)
        pairs = np.column_stack([stamps + 400_000, stamps])[: self.samples]
        # Of the last sample more than its arrival is not written yet.
        (directory / run.SAMPLES_FILE).write_bytes(pairs.tobytes() + bytes(9))
        reports = (
            [(ends[0] - 1, 'old', {'sets': '0'}), (ends[1] + 1, 'new', {'sets': '0'})]
            + [(at, 'at an end of the window', {}) for at in ends]
            + [
                (begin + ms * MS + MS // 2, 'encoders', {'sets': str(ms), 'missed deadlines': '3'})
                for ms in (10, 1090)
            ]
        )
        (directory / run.STATUSES_FILE).write_text(
            ''.join(json.dumps(each) + '\n' for each in reports)
        )


@pytest.fixture
def pipeline(monkeypatch):
    return Pipeline(monkeypatch)


WITH_OWN = Case('one', ('fkm', 'encoder_driver'), own={'fkm': {'fkm:max_age': 1.0}})


@pytest.fixture
def measured_run(pipeline, capsys):
    """Measure a run of one case, of which a process had to be killed."""
    pipeline.late = {'fkm': -signal.SIGKILL}
    return measure(WITH_OWN, 2.0, 500.0, {'realtime.priority': '3'}, pipeline.during)


@pytest.mark.usefixtures('measured_run')
def test_the_processes_of_a_run_start_with_its_parameters_and_end_in_reverse(pipeline, capsys):
    # The observer is scheduled as the nodes, and knows no rate.
    assert pipeline.started == {
        'observer': {'realtime.priority': '3'},
        'fkm': {'source': 'sim', 'rate': 500.0, 'realtime.priority': '3', 'fkm:max_age': 1.0},
        'encoder_driver': {'source': 'sim', 'rate': 500.0, 'realtime.priority': '3'},
    }
    assert pipeline.signals == [
        (name, signal.SIGINT) for name in ('encoder_driver', 'fkm', 'observer')
    ]
    assert not pipeline.directory.exists()
    assert capsys.readouterr().err == 'one: fkm: was killed\n'


def test_a_run_counts_what_its_processes_did_within_its_window(measured_run):
    found = measured_run
    assert (found.case, found.rate, found.span) == (WITH_OWN, 500.0, 2.0)
    assert len(found.stamps) == 1999
    assert found.achieved == 999.5
    np.testing.assert_allclose(found.latencies, 400.0)
    assert (found.made, found.lost, found.missed) == (1080, 1, 0)
    # Per cent of a core, in ticks of 10 ms; this process counts for nothing.
    assert found.load == {'observer': 15.0, 'fkm': 10.0, 'encoder_driver': 20.0}
    assert found.others == 12.5
    assert len(found.statuses) == 4


@pytest.mark.usefixtures('measured_run')
def test_a_run_waits_for_the_count_of_the_driver(pipeline):
    """It is reported once a second, after the window too."""
    settled, window, after = pipeline.slept
    assert settled == run.SETTLE
    assert window == 2.0
    assert after >= 1.0


@pytest.mark.parametrize(
    ('trouble', 'words'),
    [
        ({'output': ''}, 'one: no orientation within 30 s\nobserver saysfkm says'),
        *(
            ({when: {'fkm': 0}}, 'one: fkm ended by itself\nobserver saysfkm says')
            for when in ('early', 'within')
        ),
        ({'late': {'fkm': 3}}, 'one: fkm ended with 3\nobserver saysfkm says'),
        ({'samples': 0}, 'one: overloaded: of 1080 samples not one orientation arrived in 1.0 s'),
    ],
)
def test_a_pipeline_that_fails_is_named_with_its_errors(pipeline, trouble, words):
    vars(pipeline).update(trouble)
    with pytest.raises(PipelineError, match=words):
        measure(ONE, 1.0, 500.0, {}, pipeline.during)
    assert len(pipeline.signals) == 2


def test_a_program_is_started_stopped_and_killed_with_its_output(tmp_path):
    code = (
        'import os, sys, time; print("out", flush=True); '
        'print(os.environ["ROS_DOMAIN_ID"], os.getsid(0), os.getcwd(), file=sys.stderr)'
    )
    own = child_process.private_environment()['ROS_DOMAIN_ID']
    with Program([sys.executable, '-c', f'{code}; time.sleep(60)'], directory=tmp_path) as program:
        assert wait_until(lambda: program.stderr.count('\n'), 60.0)
        # Reading moves nothing.
        assert program.stdout == program.stdout == 'out\n'
        assert program.stderr == f'{own} {os.getsid(0)} {tmp_path}\n'
        assert program.poll() is None
    assert program.poll() == -signal.SIGTERM
    stubborn = Program(
        [
            sys.executable,
            '-c',
            'import signal, time; signal.signal('
            'signal.SIGTERM, signal.SIG_IGN); print(1, flush=True); time.sleep(60)',
        ]
    )
    assert wait_until(lambda: stubborn.stdout, 60.0)
    with pytest.raises(TimeoutError, match='within 0.1 s and was killed'):
        stubborn.stop(timeout=0.1)
    assert stubborn.poll() == -signal.SIGKILL
    assert not wait_until(lambda: False, 0.0)


def test_parameters_are_words_of_a_command():
    assert child_process.executable('fkm', '--x', parameters={'a': True, 'b.c': 0.5})[3:] == [
        'fkm',
        '--x',
        '--ros-args',
        '-p',
        'a:=true',
        '-p',
        'b.c:=0.5',
    ]


def test_two_runs_on_one_host_have_different_domains_and_buses(monkeypatch):
    code = (
        'from benchmarks.pipeline.child_process import *\n'
        'e = private_environment()\nprint(e["ROS_DOMAIN_ID"], e["CAN_CONFIG"], bus_channel())'
    )
    other = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True).stdout
    own = child_process.private_environment()
    assert other.split()[-1] != child_process.bus_channel()
    assert not {own['ROS_DOMAIN_ID'], own['CAN_CONFIG']} & set(other.split(maxsplit=1))
    assert 1 <= int(other.split()[0]) <= 101
    assert '"port": 20' in other
    # And so has one after the other.
    domains = set()
    for pid in (110, 160):
        monkeypatch.setattr(child_process.os, 'getpid', lambda pid=pid: pid)
        domains.add(child_process._domain.__wrapped__()[0])
    assert len(domains) == 2


@pytest.fixture
def node(stack):
    """Make nodes of the benchmark by name, in this process."""
    rclpy.init(domain_id=int(child_process.private_environment()['ROS_DOMAIN_ID']))
    stack.callback(rclpy.try_shutdown)

    def node(kind, *args, **given):
        made = kind(Parameters(arguments=[f'{k}:={v}' for k, v in given.items()]), *args)
        stack.callback(made.destroy_node)
        return made

    return node


def callback(node, topic):
    (found,) = (each for each in node.subscriptions if each.topic_name == topic)
    return found.callback


def test_a_bare_pipeline_passes_positions_on_at_the_rate(node):
    relay = node(measured_process.BareRelay)
    listener = node(measured_process.BareListener)
    assert '/orientation' in [each.topic_name for each in listener.subscriptions]
    sent = []
    relay._publisher.publish = lambda message: sent.append(serialize_message(message))
    joints = JointState(position=[0.1, 0.2, 0.3, 0.4])
    joints.header.stamp.sec = 7
    callback(relay, '/measured_js')(joints)
    expected = QuaternionStamped(header=joints.header)
    expected.header.frame_id = 'spm_base'
    q = expected.quaternion
    q.x, q.y, q.z, q.w = joints.position
    assert sent == [serialize_message(expected)]
    driver = node(measured_process.BareDriver, rate=200.0)
    made = []
    driver._publisher.publish = made.append
    before = driver._sets
    assert wait_until(lambda: len(made) >= 20, 60.0)
    assert driver._sets - before == pytest.approx(len(made), abs=2)
    # Not faster than its rate.
    assert driver._grid._period == 1.0 / 200.0
    reported = []
    driver._status.publish = lambda *entry: reported.append(entry)
    driver._report()
    assert reported[0][2]['sets'] >= 20
    assert set(reported[0][2]) == {'sets', 'missed deadlines'}


@pytest.mark.parametrize(
    ('name', 'program', 'nodes'),
    [
        ('bare_master', 'bare_master', ['BareRelay', 'BareListener', 'BareDriver']),
        ('bare_relay', 'bare_relay', ['BareRelay']),
        ('observer_of_all', 'observer', ['Observer']),
    ],
)
def test_a_process_runs_the_nodes_of_its_name(monkeypatch, name, program, nodes):
    ran = []
    added = []
    monkeypatch.setattr(measured_process.runner, 'run', lambda *given: ran.append(given) or 3)
    monkeypatch.setattr(sys, 'argv', ['module', name, 'DIR', '-p', 'a:=1'])
    assert measured_process.main() == 3
    ((started, compose, args),) = ran
    compose(None, lambda kind, *more: added.append((kind.__name__, *map(str, more))))
    assert (started, args) == (program, [name, '-p', 'a:=1'])
    assert added == [(each, name, 'DIR') if each == 'Observer' else (each,) for each in nodes]


def test_an_executable_runs_as_by_itself(monkeypatch):
    monkeypatch.setattr('spm_haptic_master.nodes.sim_slave.main', lambda args: args)
    monkeypatch.setattr(sys, 'argv', ['module', 'sim_slave', 'DIR', '-p', 'a:=1'])
    assert measured_process.main() == ['sim_slave', '-p', 'a:=1']


def test_an_observer_writes_arrivals_and_statuses(node, tmp_path, capsys):
    observer = node(measured_process.Observer, 'observer_of_all', tmp_path)
    assert {each.topic_name for each in observer.subscriptions} >= {
        '/orientation',
        '/diagnostics',
        '/measured_cp',
        '/pose_with_covariance',
        '/measured_cv',
    }
    message = QuaternionStamped()
    message.header.stamp.sec = 5
    message.header.stamp.nanosec = 6
    began = time.time_ns()
    for _ in range(3):
        callback(observer, '/orientation')(message)
    assert capsys.readouterr().out == f'{run.READY}\n'
    # The first is written at once.
    assert run.read_samples(tmp_path).shape == (2, 1)
    array = DiagnosticArray(
        status=[DiagnosticStatus(name='fkm: timing', values=[KeyValue(key='sets', value='3')])]
    )
    array.header.stamp.sec = 9
    array.header.stamp.nanosec = 7
    callback(observer, '/diagnostics')(array)
    observer._samples_file.close()
    observer._statuses_file.close()
    arrivals, stamps = run.read_samples(tmp_path)
    assert stamps.tolist() == [5_000_000_006] * 3
    assert 0 <= min(arrivals) - began < 60e9
    assert [json.loads(line) for line in (tmp_path / run.STATUSES_FILE).open()] == [
        [9 * 10**9 + 7, 'fkm: timing', {'sets': '3'}]
    ]


def test_samples_are_lost_that_were_counted_and_did_not_arrive():
    stamps = np.delete(np.arange(1, 100) * MS + 500_000, [40, 41])[::-1]
    statuses = [
        (ms * MS, 'encoders', {'sets': str(1000 + ms), 'missed deadlines': str(missed)})
        for ms, missed in ((10, 3), (50, 4), (90, 7))
    ]
    assert count_samples([(11 * MS, 'fkm', {}), *statuses], stamps) == (80, 2, 4)
    assert count_samples(statuses, np.arange(1, 100) * MS + 500_000) == (80, 0, 4)
    # One of the window's ends is not certain: a sample was stamped just before it.
    statuses.append((91_700_000, 'encoders', {'sets': '1200'}))
    assert count_samples(statuses, stamps) == (80, 2, 4)
    with pytest.raises(PipelineError, match='fewer than two counts'):
        count_samples(statuses[:1], stamps)


def run_of(case, latency, lost=0, late=0.0, others=0.0):
    return Run(
        case,
        1000.0,
        3.0,
        latency + np.arange(101.0),
        np.zeros(101),
        200,
        lost,
        5,
        {case.processes[0]: 12.5},
        others,
        np.full(10, late),
        [],
    )


@pytest.mark.parametrize(
    ('late', 'others', 'words'),
    [
        (1000.0, 20.0, ''),
        (1001.0, 20.0, 'control thread p99 1001 us late'),
        (1000.0, 21.0, 'other programs 21 % of a core'),
    ],
)
def test_a_machine_that_was_busy_is_named(late, others, words):
    assert disturbance(run_of(ONE, 100.0, late=late, others=others)) == words


@pytest.fixture
def rounds(monkeypatch, tmp_path, capsys):
    """Compare two rounds of invented runs; return what was measured, the output, the rows."""
    measured = []
    latencies = iter(range(100, 10_000, 100))

    def measure(case, seconds, rate, parameters):
        measured.append((case.name, seconds, rate, parameters))
        found = run_of(
            case,
            next(latencies),
            lost=1,
            others=30.0 * (len(measured) == 3),
        )
        statuses = [(1, 'fkm: timing', {'latency p50 (us)': '80'}), (2, 'x', {})]
        return replace(found, load=dict.fromkeys(case.processes, 12.5), statuses=statuses)

    monkeypatch.setattr(comparison, 'measure', measure)
    directory = tmp_path / 'new' / 'directory'
    comparison.compare(2.0, 2, 500.0, {'a': '1'}, directory)
    with (directory / 'runs.csv').open() as file:
        rows = [*csv.DictReader(file)]
    return measured, capsys.readouterr().out, rows


def test_all_rounds_are_compared(rounds):
    measured, out, _ = rounds
    assert measured == 2 * [(case.name, 2.0, 500.0, {'a': '1'}) for case in comparison.CASES]
    # Latencies of 100 .. 200 us and 800 .. 900 us: the median of the rounds of each percentile.
    assert (
        '| bare relay | 33.7 | 500 | 540 | 549 | 550 | 550 | 2 of 400 | 10 '
        '| bare_relay 12.5, bare_driver 12.5 |'
    ) in out
    # 250 over 150, and 950 over 850.
    assert re.search(r'p50, driver and fkm over bare relay +1.39 \(1.12 .. 1.67\)', out)
    assert (
        'round 1 of 2, driver and fkm: p50 250 p90 290 p99 299 p99.9 300 max 300 us, lost 1\n'
        in out
    )
    assert '1.39 (1.12 .. 1.67), reach 1.15: not met\n' in out
    assert '1.00 (1.00 .. 1.00), reach 1.45: met\n' in out
    assert '1 of 14 runs disturbed' in out


def test_all_rounds_are_written(rounds):
    _, _, rows = rounds
    assert [row['pipeline'] for row in rows] == 2 * [case.name for case in comparison.CASES]
    disturbed = [row['disturbed'] for row in rows if row['disturbed']]
    assert disturbed == ['other programs 30 % of a core']
    first = rows[0]
    assert first['latency p99 (us)'] == '199'
    assert first['made'] == '200'
    assert first['lost'] == '1'


@pytest.mark.usefixtures('rounds')
def test_one_round_alone_is_compared_too(tmp_path):
    """Into a directory that exists."""
    comparison.compare(2.0, 1, 500.0, {}, tmp_path)


def test_the_publication_by_fkm_is_its_median_and_the_machine_is_named(monkeypatch):
    entries = [(1, 'fkm: timing', {'latency p50 (us)': text}) for text in ('70', '90', '80')] + [
        (1, 'other: timing', {'latency p50 (us)': '1'}),
        (2, 'fkm: timing', {}),
    ]
    assert published(replace(run_of(ONE, 1.0), statuses=entries)) == 80.0
    assert np.isnan(published(run_of(ONE, 1.0)))
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_nothing')
    assert re.fullmatch(
        r'\d{4}-\d\d-\d\d, \d+ x \S.*, Linux \d.*, Python 3[\d.]+, '
        r'rclpy \d[\d.]*, rmw_nothing \(version unknown\)',
        machine(),
    )
    assert (', virtual machine,' in machine()) == (
        ' hypervisor ' in Path('/proc/cpuinfo').read_text()
    )


def test_a_control_thread_measures_its_lateness(monkeypatch):
    waited = []
    monkeypatch.setattr(
        run,
        'DeadlineGrid',
        lambda period: SimpleNamespace(
            lateness=0.002 + period, wait=lambda seconds: (time.sleep(seconds), waited.append(1))
        ),
    )
    control = run.Control()
    assert wait_until(lambda: len(waited) > 3, 60.0)
    # us, at a period of 5 ms.
    np.testing.assert_allclose(control.stop()[:3], [7000.0] * 3)
    assert not control._thread.is_alive()


def test_the_cpu_time_of_a_process_is_counted_in_ticks():
    parent, ticks = run.all_processes()[os.getpid()]
    assert parent == os.getppid()
    # The priority, 20, is the field after them.
    assert ticks == pytest.approx(sum(os.times()[:4]) / run.TICK, abs=15)


@pytest.mark.parametrize(
    ('args', 'words'),
    [
        (('-p', 'rate'), 'expected NAME:=VALUE'),
        (('-p', 'rate:=500'), 'expected --rate'),
        (('--ros-args', '-p', 'ratte:=1'), "parameter 'ratte'"),
        (('--rounds', '0'), '--rounds 0; expected 1 or more'),
        (('--rate', '0'), 'a number above 0'),
    ],
)
def test_a_wrong_argument_of_the_benchmark_is_reported(capsys, args, words):
    assert main(['bench-pipeline', *args]) == 1
    assert words in capsys.readouterr().err


def test_the_benchmark_measures_as_it_is_told(monkeypatch, capsys):
    calls = []
    monkeypatch.setattr(pipeline_command, 'compare', lambda *args: calls.append(args))
    assert main(['bench-pipeline', '--ros-args']) == 0
    assert (
        main(
            [
                'bench-pipeline',
                '--rounds',
                '1',
                '--seconds',
                '2',
                '--rate',
                '50',
                '-p',
                'realtime.gc:=disable',
                '--output',
                'x',
            ]
        )
        == 0
    )
    defaults, given = ([*map(str, args)] for args in calls)
    assert defaults == ['20.0', '5', '1000.0', '{}', 'build/bench-pipeline']
    assert given == ['2.0', '1', '50.0', "{'realtime.gc': 'disable'}", 'x']
    assert capsys.readouterr().out.count('\n') == 2
