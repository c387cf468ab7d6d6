# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Losses on a live bus, with real processes: what is published, and the time of each change."""

import signal

from diagnostic_msgs.msg import DiagnosticStatus
from disturbance import Disturbance, measure_undisturbed
from driver_watch import bus_parameters, RATE, Watch
from harness import start_program
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import parameter_arguments

pytestmark = [pytest.mark.process, pytest.mark.alone]

# can.timeout, and the time from there to /diagnostics (s).
TIMEOUT, REPORT = 0.03, 0.05
# Time by which a busy machine may be late (s), beside what a control thread was late.
BUSY = 0.1
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
GOING_ON = ('emcy:joint_1a@8+0.5=0x5000', 'offset:joint_3a@9+0.5=3', 'jump:joint_1b@9.6=20',
            'noise:joint_1c@9.8+0.4=1', 'stuck:joint_1a@10.3+0.7')
END = 11.3
LAYOUT = {'encoders.data_length': '[5, 5, 5, 5]', 'encoders.counter_byte': '[4, 4, 4, 4]',
          'encoders.counter_mask': '[0xFF, 0xFF, 0xFF, 0xFF]'}


def sim_bus(channel, *options, **layout):
    parameters = bus_parameters(channel) | layout
    return start_program('sim_bus', *parameter_arguments(parameters), *options)


def run_through_all_faults(channel):
    """Return what was published, and when each fault began and ended."""
    faults = [*SILENCING, *GOING_ON]
    # The faults' times count from the encoders' start: the driver must be up before.
    watch = Watch({**bus_parameters(channel), **LAYOUT})
    assert watch.observer.spin_until(watch.message, PATIENCE), watch.driver.stderr
    encoders = sim_bus(channel, *(word for fault in faults for word in ('--fault', fault)),
                       **LAYOUT, **{'sim.noise_deg': 0.0})
    assert watch.observer.spin_until(lambda: len(watch.samples) > 0, PATIENCE), encoders.stderr
    with Disturbance() as machine:
        watch.observer.spin(END)
    watch.lateness = machine.lateness
    watch.late = BUSY + 2.0 * machine.lateness
    watch.code = watch.close()
    encoders.stop(signal.SIGINT)
    watch.events = {}
    for line in encoders.stdout.splitlines():
        if line.endswith((' begins', ' ends')):
            when, text, what = line.split()
            watch.events[text, what] = float(when)
    return watch


def is_complete(watch):
    """Return whether no fault was passed over, nor many samples outside of them, by a stall."""
    faults = {(fault, what) for fault in (*SILENCING, *GOING_ON) for what in ('begins', 'ends')}
    if not faults <= watch.events.keys():
        return False
    stamps = watch.stamps()
    silent = sum(watch.events[fault, 'ends'] - watch.events[fault, 'begins']
                 for fault in SILENCING)
    expected = RATE * (stamps[-1] - stamps[0] - silent)
    begins = watch.events['jump:joint_1b@9.6=20', 'begins']
    return watch.lateness < TIMEOUT and len(stamps) > 0.9 * expected \
        and np.abs(stamps - begins).min() < 1.0 / RATE


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
    # Right until the fault, and nothing in it.
    assert stamps[stamps < begins + 0.01].max() > begins - 0.2 - session.late
    assert not ((stamps > begins + 0.01) & (stamps < ends - 0.01)).any()
    back = stamps[stamps > ends - 0.01].min() - ends
    print(f'{fault}: silent from {stamps[stamps < begins + 0.01].max() - begins:+.4f} s, '
          f'back after {back:.4f} s')
    assert back < 0.3 + session.late


@pytest.mark.parametrize('fault', SILENCING)
def test_the_reason_is_on_diagnostics_in_time(session, fault):
    stamps, begins, ends = around(session, fault)
    deadline = stamps[stamps < begins + 0.01].max() + TIMEOUT
    (arrived, _, message) = next(
        entry for entry in session.changes()
        if entry[0] > begins and entry[1] == DiagnosticStatus.ERROR)
    print(f'{fault}: "{message}" {1e3 * (arrived - deadline):+.1f} ms after the deadline')
    assert arrived - deadline < REPORT + session.late
    reported = [text for when, level, text in session.changes()
                if begins < when < ends and level == DiagnosticStatus.ERROR]
    assert any(SILENCING[fault] in text for text in reported)
    after = [text for when, level, text in session.changes()
             if when > ends and level != DiagnosticStatus.ERROR]
    assert after


def test_an_emergency_is_reported_in_words_while_samples_go_on(session):
    stamps, begins, ends = around(session, GOING_ON[0])
    assert ((stamps > begins) & (stamps < ends)).sum() > 0.5 * RATE * (ends - begins)
    reported = [text for when, level, text in session.changes()
                if begins < when < ends and level == DiagnosticStatus.WARN]
    # On a busy machine the answers come late at the same time: another caution beside it.
    assert any('joint_1a: EMCY 0x5000 device hardware, error register 0x01' in text
               for text in reported), reported


def test_wrong_angles_arrive_as_they_were_sent(session):
    """The driver rejects only what a frame shows to be wrong."""
    stamps = session.stamps()
    angles = np.degrees([message.position for _, message in session.samples])

    def during(fault, joint, margin=0.02):
        begins, ends = session.events[fault, 'begins'], session.events[fault, 'ends']
        return angles[(stamps > begins + margin) & (stamps < ends - margin), joint]

    # A step in the slow motion: fitted, because a busy machine may lose samples at the step.
    begins = session.events[GOING_ON[1], 'begins']
    near = np.abs(stamps - begins) < 0.3
    since, after = stamps[near] - begins, stamps[near] > begins
    terms = np.column_stack([np.ones(near.sum()), since, since ** 2, after])
    assert 10 < after.sum() < near.sum() - 10
    step = np.linalg.lstsq(terms, angles[near, 3], rcond=None)[0][-1]
    assert step == pytest.approx(3.0, abs=0.3)
    jumps = np.abs(np.diff(angles[:, 1])) > 15.0
    # One answer is off: both edges, or none where a busy machine lost that very sample.
    begins = session.events[GOING_ON[2], 'begins']
    lost = np.diff(stamps)[np.abs(stamps[:-1] - begins) < 0.1].max() > 1.5 / RATE
    assert jumps.sum() == 2 or (lost and jumps.sum() == 0)
    assert np.diff(during(GOING_ON[3], 2)).std() == pytest.approx(2.0 ** 0.5, rel=0.3)
    assert np.ptp(during(GOING_ON[4], 0)) == 0.0
    assert np.ptp(during(GOING_ON[4], 1)) > 0.0


def test_the_stamps_are_syncs_times_and_never_repeat(session):
    stamps = session.stamps()
    assert (np.diff(stamps) > 0.0).all()
    arrivals = np.array([arrived for arrived, _ in session.samples]) * 1e-9
    assert (arrivals > stamps).all()
    steps = np.diff(stamps) * RATE
    # On the producer's grid: whole periods, whatever was lost between.
    off = np.abs(steps - steps.round())
    assert np.percentile(off, 50) < 0.1


def test_the_driver_ends_well(session):
    assert session.code == 0
    entry = session.health[-1][1].status[0]
    keys = {value.key for value in entry.values}
    assert {'sets', 'SYNC sent', 'SYNC deadlines missed', 'joint_1a frame rate (Hz)',
            'joint_3a age (ms)', 'joint_1b missed cycles', 'joint_1c EMCY', 'joint_1c node 3',
            'joint_1c rejected: rolling counter unchanged', 'skew p50 / p99 / max (us)',
            'SYNC jitter p50 / p99 / max (us)', 'set rate (Hz)'} <= keys
