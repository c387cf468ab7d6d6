# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Encoders that fail in turn on a bus between processes: six go on, and the bus comes back."""

import signal

from diagnostic_msgs.msg import DiagnosticArray
from disturbance import SKIPPED
from geometry_msgs.msg import QuaternionStamped
from harness import Observer, start_program
import numpy as np
import pytest
from recording import stamps
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import parameter_arguments
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytestmark = pytest.mark.process

# Rate of SYNC (Hz), slow enough for a busy machine.
RATE = 200.0
# Time that a busy machine may need for a program, and for a change (s).
PATIENCE, MARGIN = 60.0, 0.3
# The state during each fault of one sensor, and what the driver says while it is silent.
FAULTS = {'unplug:joint_3b@2+1.5': 'degraded: joint_3b missing',
          'emcy:joint_1b@5+1.5=0x5000': 'degraded: joint_1b missing',
          'offset:joint_3a@8+1.5=3': 'degraded: joint_3a excluded'}
THREE = 'dropout:joint_1a@12+1', 'dropout:joint_3b@12+1', 'dropout:joint_3c@12+1'
SILENCING = {THREE[0]: 'joint_3b', 'busoff@15+1': 'bus-off'}
END = 18.0


class Session:
    """What was published, and when each fault began and ended (s)."""

    def __init__(self, channel):
        observer = Observer()
        samples, orientations, health = (observer.collect(kind, topic) for kind, topic in (
            (JointState, 'measured_js'), (QuaternionStamped, 'orientation'),
            (DiagnosticArray, '/diagnostics')))
        states = observer.collect(String, 'state', STATE)
        bus = {'can.interface': 'udp_multicast', 'can.channel': channel, 'rate': RATE,
               'sensors': 6, 'encoders.window': 0.005}
        # A pause of a busy machine is no silence.
        programs = [
            start_program('fkm', parameters={
                'rate': RATE, 'sensors': 6, 'sample_timeout': 0.5, 'max_age': 2.0}),
            start_program('encoder_driver', parameters={
                'source': 'can', 'can.sync': 'produce', 'can.timeout': 0.2, **simulated_rig(6),
                **bus})]
        try:
            assert observer.spin_until(
                lambda: states and observer.node.count_publishers('measured_js'), PATIENCE)
            encoders = start_program('sim_bus', *parameter_arguments(
                bus | {'sim.trajectory': 'sweep'}), *(
                    word for fault in (*FAULTS, *SILENCING, *THREE[1:])
                    for word in ('--fault', fault)))
            programs.append(encoders)
            assert observer.spin_until(lambda: samples, PATIENCE), encoders.stderr
            observer.spin(END)
        finally:
            self.codes = [program.stop(signal.SIGINT) for program in reversed(programs)]
            observer.close()
        self.sampled, self.oriented = stamps(samples) * 1e-9, stamps(orientations) * 1e-9
        self.missing = np.isnan([message.position for _, message in samples])
        self.states = [(arrived * 1e-9, message.data) for arrived, message in states]
        self.entries = [(arrived * 1e-9, entry.message) for arrived, array in health
                        for entry in array.status if entry.name == 'encoder_driver: encoders']
        self.events = {}
        for line in encoders.stdout.splitlines():
            if line.endswith((' begins', ' ends')):
                when, text, what = line.split()
                self.events[text, what] = float(when)

    def span(self, fault):
        """Return when a fault surely was present, s."""
        return self.events[fault, 'begins'] + MARGIN, self.events[fault, 'ends'] - MARGIN

    def during(self, fault, times):
        begin, end = self.span(fault)
        return (times > begin) & (times < end)

    def reasons(self, fault):
        """Return what the driver reported while a fault was present."""
        return [text for time, text in self.entries
                if self.events[fault, 'begins'] < time < self.events[fault, 'ends']]


def skip_if_the_machine_is_blamed(reasons):
    """Skip where the driver itself reports that it did not run; fail where it does not."""
    assert any('this machine is too busy' in text for text in reasons), reasons
    pytest.skip(f'{SKIPPED}{reasons}')


@pytest.fixture(scope='module')
def session(bus_channel):
    return Session(bus_channel)


@pytest.mark.parametrize('fault', FAULTS)
def test_six_sensors_go_on_without_the_faulty_one(session, fault):
    kept = session.during(fault, session.sampled)
    # A machine that stands still loses samples, but not half of them.
    if kept.sum() <= 0.25 * RATE:
        skip_if_the_machine_is_blamed(session.reasons(fault))
    assert np.isin(session.sampled[kept], session.oriented).mean() > 0.9
    begin, end = session.span(fault)
    assert [state for time, state in session.states if time < end][-1] == FAULTS[fault]
    assert any(time > end and state == 'healthy' for time, state in session.states)
    joint = ALL_JOINT_NAMES.index(fault.partition(':')[2].partition('@')[0])
    assert session.missing[kept, joint].all() == FAULTS[fault].endswith('missing')
    assert np.delete(session.missing[kept], joint, axis=1).mean() < 0.05


@pytest.mark.parametrize('fault', SILENCING)
def test_three_of_six_or_the_bus_missing_are_silence_with_the_reason(session, fault):
    for times in (session.sampled, session.oriented):
        assert not session.during(fault, times).any()
        assert (times > session.events[fault, 'ends']).any()
    assert session.states[0][1] == 'starting' and session.states[-1][1] == 'healthy'
    assert session.codes[1:] == [0, 0]
    named = session.reasons(fault)
    if not any(SILENCING[fault] in text for text in named):
        skip_if_the_machine_is_blamed(named)
