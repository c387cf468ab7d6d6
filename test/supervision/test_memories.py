# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the supervision remembers ends with what set it, and no skipped sample is forgotten."""

from types import SimpleNamespace

from device import about, encoders, joint_angles, random_pose, run, vibration
import numpy as np
import pytest
from rig import Rig
from spm_haptic_master.parameters.fkm import SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.fault import FaultLatch
from spm_haptic_master.supervision.parity import ParityWindow, WINDOW_SAMPLES
from spm_haptic_master.supervision.protection import Integrity
from spm_haptic_master.supervision.sample_clock import SampleClock
from spm_haptic_master.supervision.supervisor import make_supervisor
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, withheld

SECOND = 10**9
UNDETERMINED = Symptom(Reason.INCONSISTENT, severity=Severity.LATCH)


def latched(stamp):
    """Return a latch of four sensors with a fault of an undetermined one."""
    used = SimpleNamespace(parity_count=1, members=(0, 1, 2, 3))
    sensors = SimpleNamespace(used=used, standing=lambda stamp, onset: [])
    joints = SimpleNamespace(
        left=lambda used: [],
        alone=lambda used: [],
        departure=lambda sensor: 0,
        has_returned=lambda sensor, departure: True,
    )
    latch = FaultLatch(sensors, joints, 1.0)
    latch.latch(stamp, UNDETERMINED)
    return latch


def clears(latch, stamp):
    """Return whether a consistent sample ends the fault; the others have checked no sensor."""
    return latch.end_if_over(SimpleNamespace(is_cleared=lambda sensor, since: False), stamp)


def test_an_acknowledgement_does_not_end_what_came_after_it():
    latch = latched(0)
    latch.acknowledge()
    latch.note_bad(SimpleNamespace(stamp=SECOND // 2), [UNDETERMINED])
    assert not clears(latch, SECOND)
    assert not clears(latch, 3 * SECOND)
    # A second one does end it, after the recovery.
    latch.acknowledge()
    assert clears(latch, 3 * SECOND)


def test_recovery_is_time_in_which_no_sample_is_withheld():
    latch = latched(0)
    latch.acknowledge()
    assert not clears(latch, SECOND)
    latch.note_bad(SimpleNamespace(stamp=2 * SECOND), [withheld(Reason.MISSING, '')])
    assert not clears(latch, 3 * SECOND)
    assert clears(latch, 4 * SECOND)


def test_a_clock_that_is_set_back_after_one_sample_restarts():
    clock = SampleClock()
    clock.step(1000 * SECOND)
    ticks = [clock.step(900 * SECOND + index * 1_000_000) for index in range(150)]
    assert any(tick.restarts for tick in ticks)
    assert not ticks[-1].is_old


@pytest.mark.parametrize('value', [np.nan, 1e7, 1e300])
def test_readings_of_no_size_that_an_angle_has_are_skipped_as_missing_ones(value):
    """In motion the other joints were said to have jumped, to be acknowledged, for ever."""

    def spoil(readings):
        readings[1000:1020, 1] = value

    found = run('fast', seconds=3.0, spoil=spoil)
    assert found.states[-1] == 'healthy'


def test_one_such_reading_of_six_leaves_out_its_sensor():
    def spoil(readings):
        readings[1000:, 4] = 1e7

    found = run('fast', sensors=6, seconds=2.0, spoil=spoil)
    assert found.states[-1] == 'degraded: joint_3b missing'


def test_recovery_is_time_in_which_the_orientation_is_determined_as_well():
    latch = latched(0)
    latch.acknowledge()
    assert not clears(latch, SECOND)
    latch.note_withheld()
    assert not clears(latch, 3 * SECOND)


# Finding 4: what a jump explains ----------------------------------------------------------------


def jumped(*symptoms):
    """Return a latch in which joint_1c jumps in a bad sample of these symptoms, and back."""
    latch = latched(0)
    latch.end()
    latch._joints.alone = latch._joints.left = lambda used: [2]
    latch.note_bad(SimpleNamespace(stamp=SECOND), list(symptoms))
    latch._joints.alone = latch._joints.left = lambda used: []
    assert latch.fault is not None
    return latch


def ends(latch, stamp):
    """Return whether the fault ends a recovery after a stamp, with no sensor checked."""
    return clears(latch, stamp) or clears(latch, stamp + SECOND)


JUMP = Symptom(Reason.JUMPED, '', 2, Severity.LATCH)


def test_a_jump_that_returned_ends_its_fault_without_a_check():
    assert ends(jumped(JUMP), 2 * SECOND)


@pytest.mark.parametrize(
    'other',
    [
        Symptom(Reason.DRIFTED, severity=Severity.LATCH),
        Symptom(Reason.FROZEN, sensor=1, severity=Severity.LATCH),
        Symptom(Reason.JUMPED, sensor=1, severity=Severity.LATCH),
    ],
)
def test_a_jump_that_returned_ends_no_fault_of_another_kind_or_sensor(other):
    """A joint that was shaken while another drifted ended the drift's fault without a check."""
    assert not ends(jumped(other), 2 * SECOND)


def test_a_jump_that_returned_does_not_explain_what_came_after_it():
    latch = jumped(JUMP)
    latch.note_bad(SimpleNamespace(stamp=SECOND + SECOND // 10), [UNDETERMINED])
    assert not ends(latch, 2 * SECOND)


# Finding 15: samples in a row --------------------------------------------------------------------


def test_bad_samples_with_a_long_gap_between_are_not_in_a_row():
    """One bad sample, 10 s of a missing reading and two more were a fault."""
    latch = latched(0)
    latch.end()
    bad = [Symptom(Reason.INCONSISTENT)]
    latch.note_bad(SimpleNamespace(stamp=SECOND), bad)
    for second in range(2, 12):
        latch.note_bad(SimpleNamespace(stamp=second * SECOND), [withheld(Reason.MISSING, '')])
    for stamp in (12 * SECOND, 12 * SECOND + 1_000_000):
        latch.note_bad(SimpleNamespace(stamp=stamp), bad)
    assert latch.fault is None
    assert latch.onset == 12 * SECOND
    latch.note_bad(SimpleNamespace(stamp=12 * SECOND + 2_000_000), bad)
    assert latch.fault is not None


def test_a_sample_that_is_not_determined_is_no_clean_one_of_the_start():
    rig = Rig(pose=(0.0, 0.0, 20.0), healthy=False)
    rig.samples(2)
    clean = rig.supervisor.latch.consistent
    rig.supervisor._sensors.used.solve = lambda sample: None
    rig.supervisor._sensors.used.estimate = None
    rig.samples(1)
    assert rig.supervisor.latch.consistent == clean


# Findings 9, 13, 16, 17, 18, 22 ------------------------------------------------------------------


@pytest.mark.parametrize('period', [10_000_000, 20_000_000, 40_000_000])
def test_a_window_of_checks_is_as_many_samples_as_that_of_the_parity(period):
    """Two samples 20 ms apart were a window at 100 Hz, and its level counted on ten."""
    exposure = Exposure(4, 0.02)
    for sample in range(12):
        stamp = SECOND + sample * period
        exposure.note_consistent(stamp, [0.001] * 4, 0.01)
        is_checked = exposure.times(stamp) == (0.0,) * 4
        assert is_checked == (sample + 1 >= WINDOW_SAMPLES)


def test_a_start_that_is_always_interrupted_says_by_what():
    """With every fourth sample bad it said `starting` for ever."""
    rig = Rig(healthy=False)
    states = set()
    for _ in range(500):
        rig.samples(3)
        states.add(rig.state)
        rig.sample(th1b=11.5)
        states.add(rig.state)
    assert states == {'starting', 'silent: inconsistent angles'}
    rig.samples(110)
    assert rig.state == 'healthy'


def test_a_sample_that_fits_no_orientation_lifts_no_bound_of_the_noise():
    """One before each sixteenth sample let every joint's limit widen under a vibration."""
    supervisor = make_supervisor(complete(SUPERVISION_SETTINGS, {}))
    rng = np.random.default_rng(4)
    rotations = about(random_pose(rng), rng.normal(size=3), vibration(200.0, 1.2))
    factors = []
    for index, angles in enumerate(encoders(joint_angles(rotations))):
        if index % 16 == 14:
            angles[1] += 2.0
        supervisor.take(SECOND + index * 1_000_000, tuple(angles.tolist()))
        factors.append(supervisor.joints.factors)
    assert np.max(factors) == 1.0


def test_lost_samples_are_no_lateness_of_later_ones():
    """0.3 s of lost samples let each later pair of near stamps count as a period apart."""
    clock = SampleClock()
    stamps = [1_000_000 * index for index in range(1, 100)]
    stamps += [400_000_000 + 1_000_000 * index for index in range(50)]
    for stamp in stamps:
        clock.step(stamp)
    assert clock.step(stamps[-1] + 300_000).elapsed == pytest.approx(300e-6)


def test_the_first_sample_after_a_clock_that_was_set_back_is_later_than_the_last():
    clock = SampleClock()
    for index in range(1000):
        clock.step(10**13 + index * 1_000_000)
    times = []
    for index in range(300):
        clock.step(10**12 + index * 1_000_000)
        times.append(clock.now)
    assert np.all(np.diff(times) > 0)


def test_parity_and_bounds_do_not_outlive_the_sample_that_they_are_of():
    rig = Rig(alert_limit_deg=2.0)
    supervisor = rig.supervisor
    assert supervisor.parity is not None
    assert max(supervisor.parts) < np.inf
    rig.sample(th1b=np.nan)
    assert supervisor.parity is None
    assert min(supervisor.parts) == np.inf
    rig.samples(50)
    assert supervisor.parity is not None
    assert max(supervisor.parts) < np.inf
    rig.sample(th1b=5.0)
    assert supervisor.parity is not None
    assert min(supervisor.parts) == np.inf
    rig.samples(50)
    rig.sample(after=600)
    assert max(supervisor.parts) == np.inf


def test_three_sensors_have_no_parity():
    """That of four, from before, stayed."""
    rig = Rig(degraded='allow', alert_limit_deg=2.0)
    rig.samples(50, th1a=5.0)
    assert rig.left_out == ('joint_1a',)
    assert rig.supervisor.parity is None


# Finding 6: braking ------------------------------------------------------------------------------


def test_the_level_has_the_largest_bias_that_the_mean_test_allows():
    """Where the device slows down its window was allowed more bias than the level counted."""
    window = ParityWindow(6.9, 1, 0.02)
    for sample in range(20):
        bias = 3.0 if sample < 15 else 1.0
        # As large as the test lets pass.
        assert window.test(sample * 1_000_000, (3.5,), 1.0, bias) is None
    worth = Integrity(
        healthy=0.0,
        deviation=0.0,
        noise=1.0,
        bias=1.0,
        fold_share=0.0,
        slopes=(1.0,),
    )
    assert window.mean_bias == pytest.approx(2.5)
    (level,) = worth.parts(6.9 / np.sqrt(20.0), window.mean_bias)
    # A fault of this much parity passes the test while the others' biases oppose it.
    assert level >= 6.9 / np.sqrt(20.0) + 2.0 * 2.5
