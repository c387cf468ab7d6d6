# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Losses on a live bus, with real processes: what is published, and the time of each change."""

import signal

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from disturbance import Disturbance, measure_undisturbed
from harness import Observer, stamp, start_program
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import parameter_arguments
from spm_haptic_master.parameters.files import simulated_rig

pytestmark = [pytest.mark.process, pytest.mark.alone]

STATUS = 'encoder_driver: encoders'
# Rate of SYNC (Hz).
RATE = 500.0
# can.timeout, and the time from there to /diagnostics (s).
TIMEOUT, REPORT = 0.03, 0.05
# Time by which a machine at work is late (s).
BUSY = 0.1
# Time by which sim_bus may print late that a fault has ended (s).
PRINTED = 0.1
# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# All of a fault's kinds that silence the driver: what the reason says. The rolling counter is in
# the encoders' fifth byte.
SILENCING = {
    'dropout:joint_3a@2+0.6': 'joint_3a silent (no frames)',
    'reboot:joint_1b@3.2+0.6': 'joint_1b silent (no frames)',
    'silence@4.4+0.6': 'all encoders silent (no frames)',
    'busoff@5.6+0.6': 'bus-off',
    'counter:joint_1c@6.8+0.6': 'joint_1c silent (frames rejected, rolling counter unchanged)',
}
# What the driver cannot see, or only reports.
GOING_ON = EMERGENCY, OFFSET = 'emcy:joint_1a@8+0.5=0x5000', 'offset:joint_3a@8.7+0.5=3'
END = 9.8
LAYOUT = {'encoders.data_length': '[5, 5, 5, 5]', 'encoders.counter_byte': '[4, 4, 4, 4]',
          'encoders.counter_mask': '[0xFF, 0xFF, 0xFF, 0xFF]'}


def bus_parameters(channel):
    return {'can.interface': 'udp_multicast', 'can.channel': channel, 'rate': RATE}


class Watch:
    """A driver as SYNC master, and all that it publishes."""

    def __init__(self, parameters):
        self.observer = Observer()
        self.samples = self.observer.collect(JointState, 'measured_js')
        self.health = self.observer.collect(DiagnosticArray, '/diagnostics')
        self.driver = start_program('encoder_driver', parameters={
            'source': 'can', 'can.sync': 'produce', **simulated_rig(), **parameters})

    def stamps(self):
        """Return the samples' stamps, s."""
        return np.array([stamp(message) for _, message in self.samples]) * 1e-9

    def changes(self):
        """Return (arrival in s, level, message) of each change on /diagnostics."""
        found = []
        for arrived, array in self.health:
            for entry in array.status:
                if entry.name == STATUS and (not found or found[-1][2] != entry.message):
                    found.append((arrived * 1e-9, entry.level, entry.message))
        return found

    def close(self):
        code = self.driver.stop()
        self.observer.close()
        return code


def sim_bus(channel, *options, **layout):
    parameters = bus_parameters(channel) | layout
    return start_program('sim_bus', *parameter_arguments(parameters), *options)


def run_through_all_faults(channel):
    """Return what was published, and when each fault began and ended."""
    faults = [*SILENCING, *GOING_ON]
    # The faults' times count from the encoders' start: the driver must be up before.
    watch = Watch({**bus_parameters(channel), **LAYOUT})
    assert watch.observer.spin_until(watch.changes, PATIENCE), watch.driver.stderr
    encoders = sim_bus(channel, *(word for fault in faults for word in ('--fault', fault)),
                       **LAYOUT, **{'sim.noise_deg': 0.0})
    assert watch.observer.spin_until(lambda: len(watch.samples) > 0, PATIENCE), encoders.stderr
    with Disturbance() as watch.machine:
        watch.observer.spin(END)
    watch.code = watch.close()
    encoders.stop(signal.SIGINT)
    watch.events = {}
    for line in encoders.stdout.splitlines():
        if line.endswith((' begins', ' ends')):
            when, text, what = line.split()
            watch.events[text, what] = float(when)
    return watch


def during(watch, fault):
    """Return which samples were surely taken during a fault: whether each one was."""
    stamps, begins, ends = around(watch, fault)
    return (stamps > begins + 0.01) & (stamps < ends - PRINTED)


def is_complete(watch):
    """Return whether no fault was passed over, and most samples came."""
    if len(watch.events) < 2 * len((*SILENCING, *GOING_ON)):
        return False
    stamps = watch.stamps()
    silent = sum(watch.events[fault, 'ends'] - watch.events[fault, 'begins']
                 for fault in SILENCING)
    return len(stamps) > 0.9 * RATE * (stamps[-1] - stamps[0] - silent)


@pytest.fixture(scope='module')
def session(bus_channel):
    """One run through all faults."""
    return measure_undisturbed(lambda: run_through_all_faults(bus_channel), is_complete)


def around(session, fault):
    """Return the stamps, and when the fault began and ended."""
    return session.stamps(), session.events[fault, 'begins'], session.events[fault, 'ends']


@pytest.mark.parametrize('fault', SILENCING)
def test_nothing_goes_out_and_all_comes_back(session, fault):
    stamps, begins, ends = around(session, fault)
    # Nothing during the fault, and right until it.
    assert not during(session, fault).any()
    last = stamps[stamps < begins + 0.01].max() - begins
    back = stamps[stamps > ends - PRINTED].min() - ends
    print(f'{fault}: silent from {last:+.4f} s, back after {back:.4f} s')
    session.machine.expect(last > -0.2 - BUSY, last)
    session.machine.expect(back < 0.3 + BUSY, back)


@pytest.mark.parametrize('fault', SILENCING)
def test_the_reason_is_on_diagnostics_in_time(session, fault):
    stamps, begins, ends = around(session, fault)
    deadline = stamps[stamps < begins + 0.01].max() + TIMEOUT
    (arrived, _, message) = next(
        entry for entry in session.changes()
        if entry[0] > begins and entry[1] == DiagnosticStatus.ERROR)
    print(f'{fault}: "{message}" {1e3 * (arrived - deadline):+.1f} ms after the deadline')
    session.machine.expect(arrived - deadline < REPORT + BUSY, arrived - deadline)
    reported = [text for when, level, text in session.changes()
                if begins < when < ends and level == DiagnosticStatus.ERROR]
    session.machine.expect(any(SILENCING[fault] in text for text in reported), reported)
    after = [text for when, level, text in session.changes()
             if when > ends and level != DiagnosticStatus.ERROR]
    assert after


def test_an_emergency_is_reported_in_words_while_samples_go_on(session):
    _, begins, ends = around(session, EMERGENCY)
    assert during(session, EMERGENCY).any()
    reported = [text for when, level, text in session.changes()
                if begins < when < ends and level == DiagnosticStatus.WARN]
    session.machine.expect(
        any('joint_1a: EMCY 0x5000 device hardware, error register 0x01' in text
            for text in reported), reported)


def test_wrong_angles_arrive_as_they_were_sent(session):
    """The driver rejects only what a frame shows to be wrong."""
    stamps = session.stamps()
    angles = np.degrees([message.position[3] for _, message in session.samples])
    begins = session.events[OFFSET, 'begins']
    # Without those around the step, which may be printed late.
    near = (np.abs(stamps - begins) < 0.3) & (np.abs(stamps - begins) > 0.05)
    since = stamps[near] - begins
    terms = np.column_stack([np.ones(near.sum()), since, since**2, since > 0.0])
    *_, step = np.linalg.lstsq(terms, angles[near], rcond=None)[0]
    assert step == pytest.approx(3.0, abs=0.3)


def test_the_stamps_are_syncs_times_and_never_repeat(session):
    stamps = session.stamps()
    assert (np.diff(stamps) > 0.0).all()
    arrivals = np.array([arrived for arrived, _ in session.samples]) * 1e-9
    assert (arrivals > stamps).all()
    steps = np.diff(stamps) * RATE
    # On the producer's grid: whole periods, whatever was lost between.
    off = np.abs(steps - steps.round())
    assert np.percentile(off, 50) < 0.1


def test_the_driver_ends_well_and_has_figures_of_bus_and_encoders(session):
    assert session.code == 0
    keys = {value.key for value in session.health[-1][1].status[0].values}
    assert {'sets', 'SYNC sent', 'joint_1a frame rate (Hz)', 'joint_1c EMCY',
            'joint_1c rejected: rolling counter unchanged', 'set rate (Hz)'} <= keys
