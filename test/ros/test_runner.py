# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From command line to exit code, in the process of the test; processes are in test/nodes."""

import faulthandler
import os
from pathlib import Path
import re
import signal

import pytest
import rclpy
from rclpy.executors import ExternalShutdownException
from spm_haptic_master.exceptions import InputError, SettingError, SourceEnded
from spm_haptic_master.parameters.setting import Setting
from spm_haptic_master.ros import duplicate_publishers, node_log, realtime, runner
from spm_haptic_master.ros.parameters import ParameterNode

# What begins the limit of the end, and what lifts it: alarm (s), then time, exit, descriptor.
BEGUN = [6.0, (5.0, True, 2)]
LIFTED = ['cancelled', 0.0]


@pytest.fixture
def ends(monkeypatch):
    """Give the timers of the end; what the process sets of itself is restored."""
    timers = []
    monkeypatch.setattr(signal, 'setitimer', lambda which, seconds: timers.append(seconds))
    monkeypatch.setattr(
        faulthandler,
        'dump_traceback_later',
        lambda seconds, **given: timers.append((seconds, *given.values())),
    )
    monkeypatch.setattr(
        faulthandler, 'cancel_dump_traceback_later', lambda: timers.append('cancelled')
    )
    for name in runner.PROFILE_VARIABLES:
        monkeypatch.setenv(name, '')
    for number in (*runner.SIGNALS, signal.SIGALRM):
        signal.signal(number, signal.SIG_IGN)
    return timers


@pytest.fixture
def applied(ends, monkeypatch):
    """Give the realtime settings that are applied, and the node that logs."""
    found = []
    monkeypatch.setattr(
        realtime, 'apply', lambda node, values: found.append((node.get_name(), values))
    )
    return found


class Worker(ParameterNode):
    """A node that notes what happens to it, and may fail in the end."""

    def __init__(self, parameters, events, failure=None):
        super().__init__('fkm', parameters)
        self.events = events
        self.failure = failure
        events.append('made')

    def start(self):
        self.events.append('started')

    def destroy_node(self):
        self.events.append('destroyed')
        super().destroy_node()
        if self.failure is not None:
            raise self.failure


def run(compose, *args, **owned):
    return runner.run('fkm', compose, ['fkm', *args], **owned)


def run_once(*args, result=None, failure=None):
    """Run a worker that is done at once; return the exit code and what happened to it."""
    events = []

    def compose(done, add):
        add(Worker, events, failure)
        done.set_result(result)

    return run(compose, *args), events


def printed(capfd):
    """Return stdout and stderr without what Fast DDS prints of ports of killed processes."""
    return [
        ''.join(line for line in text.splitlines(keepends=True) if 'RTPS_' not in line)
        for text in capfd.readouterr()
    ]


@pytest.mark.parametrize(
    ('result', 'failure', 'code', 'out', 'err'),
    [
        (SourceEnded('the end'), None, 0, 'fkm: the end\n', ''),
        (None, None, 0, '', ''),
        (InputError('no'), None, 1, '', 'fkm: no\n'),
        (None, InputError('no'), 1, '', 'fkm: no\n'),
    ],
)
def test_a_process_ends_with_its_result(
    ends, applied, monkeypatch, capfd, result, failure, code, out, err
):
    warnings = []
    monkeypatch.setattr(node_log, 'warning', lambda _, text: warnings.append(text))
    found = run_once(
        '-p', 'realtime.gc:=freeze', '-p', 'can.channel:=can1', result=result, failure=failure
    )
    assert warnings == [f'-p can.channel:=can1: {runner.NO_EFFECT}']
    assert found == (code, ['made', 'started', 'destroyed'])
    # The log has ended, and the process has left the DDS domain.
    assert not rclpy.ok()
    assert node_log._log is None
    assert printed(capfd) == [out, err]
    assert [(name, values['realtime.gc']) for name, values in applied] == [('fkm', 'freeze')]
    assert ends == [*BEGUN, *LIFTED]
    assert [signal.getsignal(number) for number in (*runner.SIGNALS, signal.SIGALRM)] == [
        signal.SIG_IGN,
        signal.SIG_IGN,
        signal.SIG_DFL,
    ]


@pytest.mark.parametrize('number', runner.SIGNALS)
def test_a_signal_is_a_normal_end_and_begins_its_limit(ends, applied, number):
    def compose(done, add):
        def interrupt():
            for _ in range(2):
                os.kill(os.getpid(), number)
            # The handler has run: the end is limited while the nodes still work.
            begun.append(list(ends))

        add(Worker, []).create_timer(0.01, interrupt)

    begun = []
    assert run(compose) == 0
    assert begun[0] == BEGUN
    assert ends == [*BEGUN, *LIFTED]


def test_a_failure_is_one_line_and_leaves_no_node(applied, monkeypatch, capfd):
    events = []

    def refused(done, add):
        add(Worker, events)
        raise SettingError('rate', -1, 'more')

    for args, line in (
        ((), "fkm: parameter 'rate' is -1; expected more\n"),
        (('-p', 'alert_limit:=1.0'), "'alert_limit' is 1.0"),
        (('--enclave', 'bad enclave'), 'fkm: ROS arguments rejected: '),
    ):
        assert run(refused, *args) == 1
        assert events == ['made', 'destroyed']
        _, err = printed(capfd)
        assert line in err
        assert err.count('\n') == 1

    # Ctrl-C while the arguments are read.
    monkeypatch.setattr(runner, 'node_command_line', lambda *_: signal.raise_signal(signal.SIGINT))
    assert run(refused) == 0


def test_a_live_setting_that_no_code_applies_ends_the_process_at_its_start(ends, applied):
    def compose(done, add):
        add(Worker, []).declare((Setting('level', float, 'A level', 1.0, live=True),))
        done.set_result(None)

    with pytest.raises(RuntimeError, match='no code applies.*level'):
        run(compose)


def test_a_bug_at_the_end_keeps_its_limit(ends, applied):
    with pytest.raises(RuntimeError, match='a bug'):
        run_once(failure=RuntimeError('a bug'))
    assert ends == BEGUN


def test_owned_topics_are_looked_for_before_the_nodes_are_made(applied, monkeypatch):
    looked = []

    def alone(topics, is_ended):
        looked.append((topics, is_ended()))
        raise ExternalShutdownException

    monkeypatch.setattr(runner, 'wait_until_alone', alone)
    assert run(lambda done, add: looked.append('made'), owned={'fkm': 'orientation'}) == 0
    assert looked == [({'fkm': 'orientation'}, [])]


LOCAL = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
SUBNET = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
PEERS = {'ROS_STATIC_PEERS': '192.168.1.20'}


@pytest.mark.parametrize(
    ('environment', 'name', 'more'),
    [
        ({}, 'fastdds.xml', {}),
        (SUBNET, 'fastdds.xml', {}),
        (LOCAL, 'fastdds_localhost.xml', SUBNET),
        # Another host: not this one alone.
        (LOCAL | PEERS, 'fastdds.xml', {}),
    ],
)
def test_no_process_has_shared_memory(tmp_path, monkeypatch, environment, name, more):
    """A9: with it a reader that is stopped stops samples, orientation and torques."""
    monkeypatch.chdir(tmp_path)
    found = runner.dds_profile(environment)
    paths = {found[variable] for variable in runner.PROFILE_VARIABLES}
    (path,) = paths
    assert Path(path).name == name
    assert found == more | dict.fromkeys(runner.PROFILE_VARIABLES, path)
    assert '<useBuiltinTransports>false<' in Path(path).read_text()
    # A process that this one starts has the same.
    inherited = environment | found
    assert inherited | runner.dds_profile(inherited) == inherited


def test_the_packages_profile_is_selected_where_the_user_has_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    profile = runner.dds_profile
    names = runner.PROFILE_VARIABLES
    selected = profile({})
    assert set(selected) == set(names)
    (path,) = set(selected.values())
    # A process that searches for others hears each of them twice.
    (period,) = re.findall(r'<sec>0</sec>\s*<nanosec>(\d+)</nanosec>', Path(path).read_text())
    assert 2e-9 * int(period) <= duplicate_publishers.LOOK
    assert [profile({name: 'mine.xml'}) for name in names] == [{}, {}]
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').touch()
    assert profile({}) == {}
