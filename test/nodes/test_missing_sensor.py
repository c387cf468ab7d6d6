# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Six encoders on a bus between processes, and one of them not there: the samples go on."""

import signal

from diagnostic_msgs.msg import DiagnosticStatus
from driver_watch import STATUS, Watch
from harness import start_program
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import parameter_arguments
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.files import simulated_rig

pytestmark = pytest.mark.process

# Rate of SYNC (Hz), slow enough for a busy machine, and the window of an answer (s).
RATE, WINDOW = 25.0, 0.08
# Time that a busy machine may need for a program, and for a change on /diagnostics (s).
PATIENCE, MARGIN = 60.0, 0.25
UNPLUGGED, EMERGENCY = 'unplug:joint_3b@3+3.2', 'emcy:joint_1b@7+3.2=0x5000'
LATE, THREE = 'late:joint_3c@11+5=0.05', 'emcy:joint_1a@18+2=0x5000'
# With the one above, three of six.
MORE = ('dropout:joint_3a@18+2', 'dropout:joint_3c@18+2')
LOSSES = tuple(f'loss:{joint}@21+4=5' for joint in ALL_JOINT_NAMES)
END = 25.5


@pytest.fixture(scope='module')
def session(bus_channel):
    """Run through all faults; return what was published, and when each began and ended."""
    bus = {'can.interface': 'udp_multicast', 'can.channel': bus_channel, 'rate': RATE,
           'sensors': 6, 'encoders.window': WINDOW}
    watch = Watch({**simulated_rig(6), **bus, 'can.timeout': 0.2})
    assert watch.observer.spin_until(watch.message, PATIENCE), watch.driver.stderr
    encoders = start_program('sim_bus', *parameter_arguments(bus), *(
        word for fault in (UNPLUGGED, EMERGENCY, LATE, THREE, *MORE, *LOSSES)
        for word in ('--fault', fault)))
    assert watch.observer.spin_until(lambda: watch.samples, PATIENCE), encoders.stderr
    watch.observer.spin(END)
    watch.code = watch.close()
    encoders.stop(signal.SIGINT)
    watch.events = {}
    for line in encoders.stdout.splitlines():
        if line.endswith((' begins', ' ends')):
            when, text, what = line.split()
            watch.events[text, what] = float(when)
    watch.missing = np.isnan([message.position for _, message in watch.samples])
    return watch


def during(session, fault, after=MARGIN):
    """Return which joints have no reading, in the samples while a fault is present."""
    stamps = session.stamps()
    begins, ends = session.events[fault, 'begins'], session.events[fault, 'ends']
    found = session.missing[(stamps > begins + after) & (stamps < ends - MARGIN)]
    # A machine that stands still loses samples, but not half of them.
    assert len(found) > 0.5 * RATE * (ends - begins - after - MARGIN)
    return found


def entries(session, fault, after=MARGIN):
    """Return the driver's entries on /diagnostics while a fault is present."""
    begins, ends = session.events[fault, 'begins'], session.events[fault, 'ends']
    return [entry for arrived, array in session.health for entry in array.status
            if entry.name == STATUS and begins + after < arrived * 1e-9 < ends]


def figures(entry):
    return {value.key: value.value for value in entry.values}


def counted(session, fault, *names):
    """Return by how much counters grew while a fault was present."""
    found = [figures(entry) for entry in entries(session, fault)]
    return [int(found[-1].get(name, 0)) - int(found[0].get(name, 0)) for name in names]


@pytest.mark.parametrize(('fault', 'joint', 'reason'), [
    (UNPLUGGED, 'joint_3b', 'joint_3b: '),
    (EMERGENCY, 'joint_1b', 'joint_1b: EMCY 0x5000 device hardware')])
def test_the_samples_go_on_without_its_joint(session, fault, joint, reason):
    missing = during(session, fault)
    index = ALL_JOINT_NAMES.index(joint)
    assert missing[:, index].all()
    # What else a busy machine loses is one frame here and there.
    assert np.delete(missing, index, axis=1).mean() < 0.05
    found = entries(session, fault)
    assert {entry.level for entry in found} == {DiagnosticStatus.WARN}
    assert all(reason in entry.message for entry in found)
    assert any(joint in figures(entry)['joints missing'] for entry in found)


@pytest.mark.parametrize('fault', [UNPLUGGED, EMERGENCY])
def test_no_set_waits_for_it(session, fault):
    """By what the driver counts: all but a few sets go out with their last answer."""
    sets, held = counted(session, fault, 'sets', 'sets at the end of the cycle')
    assert sets > 0.25 * RATE
    assert held < 0.25 * sets


def test_an_encoder_that_is_late_by_a_cycle_is_found_within_seconds(session):
    """By the SYNC that is left out each second while an encoder is in doubt."""
    missing = during(session, LATE, after=2.2)
    assert missing[:, ALL_JOINT_NAMES.index('joint_3c')].all()
    assert any('joint_3c: answers late by whole cycles' in entry.message
               for entry in entries(session, LATE, 2.2))
    assert int(figures(entries(session, LATE)[-1])['SYNC left out']) > 0


def test_three_of_six_missing_are_silence_with_the_reasons(session):
    begins, ends = session.events[THREE, 'begins'], session.events[THREE, 'ends']
    stamps = session.stamps()
    assert not ((stamps > begins + MARGIN) & (stamps < ends - MARGIN)).any()
    assert (stamps > ends).any()
    found = [entry for entry in entries(session, THREE, 2.0 * MARGIN)
             if entry.level == DiagnosticStatus.ERROR]
    assert found and any('joint_3a' in entry.message and 'joint_3c' in entry.message
                         for entry in found)


def test_lost_frames_cost_single_joints(session):
    missing = during(session, LOSSES[0], after=2.0 * MARGIN)
    assert 0.005 < missing.mean() < 0.25
    sets, cycles = counted(session, LOSSES[0], 'sets', 'cycles')
    assert cycles > RATE and sets > 0.95 * cycles


def test_it_is_healthy_before_and_ends_well(session):
    before = session.missing[session.stamps() < session.events[UNPLUGGED, 'begins'] - MARGIN]
    assert len(before) > RATE and before.mean() < 0.05
    assert session.code == 0
