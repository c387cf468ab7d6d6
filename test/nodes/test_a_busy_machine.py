# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processes that the machine does not let run: the test stops them by a signal."""

from itertools import cycle
import signal
import time

from diagnostic_msgs.msg import DiagnosticArray
from harness import SIM, start_program
import pytest
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.task import Future
from spm_haptic_master.benchmark.child_process import private_environment
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.nodes import encoder_driver
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros.overload import START, TOO_BUSY
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s), and that a process is stopped.
PATIENCE = 60.0
STOPPED = 1.5


def logged(program):
    return [line.partition(']: ')[2] for line in program.stderr.splitlines()
            if line.startswith(('[WARN]', '[ERROR]'))]


class ScriptedSource(EncoderSource):
    """A source that reports what the test says."""

    fault = caution = None
    lost = 0.0

    def read(self, timeout):
        time.sleep(timeout)

    def statistics(self):
        return {}


class ScriptedDriver:
    """A driver of this process with a scripted source."""

    def __init__(self):
        self._executor = EventsExecutor()
        self._driver = encoder_driver.EncoderDriver(
            Parameters(arguments=['source:=sim']), Future())
        self._executor.add_node(self._driver)

    def run(self, condition, seconds=PATIENCE):
        """Let the driver report until a condition of its state holds."""
        end = time.monotonic() + seconds
        while not condition(self._driver.state) and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)
        return self._driver.state

    def close(self):
        self._executor.shutdown()
        self._driver.destroy_node()


@pytest.fixture
def scripted(monkeypatch):
    rclpy.init(args=[], domain_id=int(private_environment()['ROS_DOMAIN_ID']))
    source = ScriptedSource()
    monkeypatch.setattr(encoder_driver, 'make_source', lambda name, values: source)
    driver = ScriptedDriver()
    driver.source = source
    driver.run(lambda state: False, 2.0 * START)
    yield driver
    driver.close()
    rclpy.shutdown()


@pytest.mark.parametrize('kind', ['fault', 'caution'])
def test_what_appears_while_deadlines_are_missed_is_the_machines(scripted, kind):
    """A SYNC that came late by 0.3 s: what the encoders did meanwhile is no fault of theirs."""
    symptom = 'joint_1a: heartbeat lost'
    scripted.source.lost += 0.3
    assert scripted.run(lambda state: state.startswith(TOO_BUSY)).endswith(' s')
    setattr(scripted.source, kind, symptom)
    seen = set()
    scripted.run(lambda state: seen.add(state), 0.5)
    assert all(state.startswith(TOO_BUSY) and symptom not in state for state in seen), seen
    # What stays is one of theirs.
    assert symptom in scripted.run(lambda state: symptom in state)


def test_what_was_there_before_stays(scripted):
    scripted.source.fault = 'bus-off'
    scripted.run(lambda state: state == 'bus-off')
    scripted.source.lost += 0.3
    assert scripted.run(lambda state: TOO_BUSY in state).startswith('bus-off; ')


def test_a_caution_that_ends_while_it_is_read_does_not_end_the_driver(scripted, monkeypatch):
    """The thread of the samples goes on meanwhile."""
    cautions = cycle(['two answers from joint_3a in one cycle', None])
    monkeypatch.setattr(ScriptedSource, 'caution', property(lambda _: next(cautions)))
    seen = set()
    scripted.run(lambda state: seen.add(state) or len(seen) > 1)
    assert 'publishing' in seen
    assert any('two answers' in state for state in seen - {'publishing'})


def test_a_process_that_was_stopped_blames_the_machine(observer):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    # Latched: it is healthy before DDS may have matched this subscription.
    states = observer.collect(String, 'state', STATE)
    with start_program('fkm') as fkm, start_program(
            'encoder_driver', parameters={**SIM, 'rate': 200.0}) as driver:
        assert observer.spin_until(
            lambda: states and states[-1][1].data == 'healthy', PATIENCE), fkm.stderr
        observer.spin(2.0 * START)
        before = len(logged(fkm))
        del states[:], health[:]
        # Its own figures say it, whether or not a sample was too old.
        for program, name, words in (
                (fkm, 'fkm: timing', TOO_BUSY),
                (driver, 'encoder_driver: encoders',
                 f'{TOO_BUSY}: this process was due and did not run for more than 1 s')):
            program.send_signal(signal.SIGSTOP)
            observer.spin(STOPPED)
            program.send_signal(signal.SIGCONT)
            assert observer.spin_until(
                lambda name=name, words=words: any(
                    entry.name == name and words in entry.message
                    for _, array in health for entry in array.status), PATIENCE)
            assert observer.spin_until(
                lambda: not states or states[-1][1].data == 'healthy', PATIENCE)
    said = [*logged(fkm)[before:], *(message.data for _, message in states)]
    assert not any(words in line for line in said
                   for words in ('stale', 'clocks', 'too fast', 'jumped')), said
