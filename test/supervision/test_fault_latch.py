# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bad samples one by one: what latches a fault, which sensor it is, and what ends it."""

from types import SimpleNamespace

import pytest
from spm_haptic_master.supervision.fault import FaultLatch
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, withheld

MS = 1_000_000
SECOND = 1000 * MS
INCONSISTENT = Symptom(Reason.INCONSISTENT)
DRIFTED = Symptom(Reason.DRIFTED, severity=Severity.LATCH)
UNSURE = withheld(Reason.UNDETERMINED, '')
AGREE = '1 s of samples that agree'
TILT = 'tilt the handle towards the centre of the workspace'
TURN = 'turn the handle about its axis, away from the singularity'


def jumped(sensor):
    """Return the symptom of a jump of a sensor."""
    return Symptom(Reason.JUMPED, sensor=sensor)


class Joints:
    """Joints that left their motion, and returned to it, as a test says."""

    def __init__(self):
        self.away = []
        self.single = []
        self.returned = set()
        self.departures = {}

    def left(self, used):
        return list(self.away)

    def alone(self, used):
        return list(self.single)

    def departure(self, sensor):
        return self.departures.get(sensor, 1)

    def has_returned(self, sensor, departure):
        return (sensor, departure) in self.returned

    def leave(self, *sensors):
        """Let only these sensors leave their motion."""
        self.away = list(sensors)
        self.single = list(sensors)


class Device:
    """A latch of sensors with so many parities, its joints, and the trials that stand."""

    def __init__(self, entries=1):
        self.standing = []
        self.joints = Joints()
        self.checked = ()
        places = tuple(range(entries + 3))
        sensors = SimpleNamespace(
            used=SimpleNamespace(parity_count=entries, members=places),
            standing=lambda stamp, onset: list(self.standing),
        )
        self.latch = FaultLatch(sensors, self.joints, 1.0)
        self.now = 7 * SECOND

    def bad(self, *symptoms, after=MS):
        """Take a bad sample some ns later; return the sensor that is isolated."""
        self.now += after
        symptoms = list(symptoms) or [INCONSISTENT]
        return self.latch.note_bad(SimpleNamespace(stamp=self.now), symptoms)

    def good(self, count=1):
        """Take consistent samples a ms apart."""
        for _ in range(count):
            self.now += MS
            self.latch.note_consistent()

    def ends(self, after):
        """Take a consistent sample some ns later; return whether it ends the fault."""
        self.now += after
        exposure = SimpleNamespace(
            is_cleared=lambda sensor, stamp: (sensor, stamp) in self.checked
        )
        return self.latch.end_if_over(exposure, self.now)

    @property
    def fault(self):
        return self.latch.fault


# What latches a fault -------------------------------------------------------------------------


def test_three_bad_samples_in_a_row_latch_a_fault():
    device = Device()
    for _ in range(2):
        assert device.bad() is None
    assert device.fault is None
    device.good()
    for _ in range(2):
        device.bad()
    assert device.fault is None
    device.bad()
    assert device.fault.symptom == INCONSISTENT
    assert device.fault.last_bad == device.now
    assert device.latch.words == 'inconsistent angles, sensor undetermined'


@pytest.mark.parametrize(('gap', 'latches'), [(500 * MS, True), (500 * MS + 1, False)])
def test_bad_samples_are_in_a_row_with_withheld_ones_of_half_a_second_between(gap, latches):
    device = Device()
    device.bad()
    first = device.now
    device.bad()
    device.bad(UNSURE, after=MS)
    device.bad(after=gap - MS)
    assert (device.fault is not None) == latches
    assert device.latch.onset == (first if latches else device.now)


def test_a_symptom_that_is_certain_latches_at_once_and_a_withheld_sample_counts_for_nothing():
    device = Device()
    device.good(7)
    for _ in range(10):
        assert device.bad(UNSURE, withheld(Reason.MISSING, '', 2)) is None
    assert device.fault is None
    assert device.latch.latest_cause is None
    assert device.latch.consistent == 7
    assert device.bad(DRIFTED) is None
    assert device.fault.symptom == DRIFTED
    assert device.latch.latest_cause == DRIFTED
    assert device.latch.consistent == 0
    assert device.latch.words == 'angles drifted apart, sensor undetermined'


def test_the_onset_is_the_first_bad_sample_of_the_run_with_which_the_fault_began():
    device = Device()
    assert device.latch.onset == 0
    device.bad()
    assert device.latch.onset == device.now
    device.good()
    device.bad()
    begin = device.now
    device.bad()
    device.bad()
    assert device.latch.onset == begin
    device.good()
    device.bad()
    assert device.latch.onset == begin


def runs(device, count, good=100, symptom=INCONSISTENT):
    """Take runs of one bad sample with consistent ones between; return the last one's sensor."""
    for _ in range(count):
        device.good(good)
        isolated = device.bad(symptom)
    return isolated


@pytest.mark.parametrize(
    ('count', 'good', 'symptom', 'is_series'),
    [
        (2, 100, INCONSISTENT, False),
        (3, 100, INCONSISTENT, True),
        (3, 101, INCONSISTENT, False),
        (3, 1, INCONSISTENT, True),
        # Runs that name their sensor are no series.
        (9, 1, jumped(2), False),
    ],
)
def test_three_runs_of_bad_samples_with_few_consistent_ones_between_are_a_series(
    count, good, symptom, is_series
):
    device = Device(2)
    device.standing = [3]
    isolated = runs(device, count, good, symptom)
    assert device.latch.is_series == is_series
    assert device.fault is None
    # With two parities its sensor is isolated already.
    assert isolated == (3 if is_series else None)
    device.good(101)
    assert not device.latch.is_series
    runs(device, 2, 1)
    assert not device.latch.is_series


def test_a_series_of_a_single_parity_isolates_no_sensor():
    device = Device(1)
    device.standing = [3]
    assert runs(device, 3) is None
    assert device.latch.is_series


def test_a_restart_forgets_the_samples_and_no_fault():
    device = Device(1)
    runs(device, 3)
    device.latch.restart()
    assert not device.latch.is_series
    assert device.latch.latest_cause is None
    assert device.latch.consistent == 0
    device.joints.leave(1)
    device.bad()
    device.latch.restart()
    device.joints.leave()
    device.standing = [0, 1]
    for _ in range(2):
        device.bad()
    assert device.fault is None
    device.bad()
    assert device.fault.symptom.sensor is None


def test_a_restart_begins_the_recovery_again():
    device = faulty()
    device.checked = [(sensor, device.fault.last_bad) for sensor in range(4)]
    assert not device.ends(0)
    device.latch.restart()
    assert not device.ends(SECOND)
    assert device.ends(SECOND)


def test_an_ended_fault_leaves_no_bad_sample_behind():
    device = Device(1)
    runs(device, 2)
    for _ in range(2):
        device.bad()
    assert device.fault is not None
    device.latch.end()
    assert device.latch.words == ''
    for _ in range(2):
        device.bad()
    assert device.fault is None
    assert not device.latch.is_series


# Which sensor it is ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('entries', 'symptoms', 'standing', 'alone', 'sensor'),
    [
        # One that is named, and not several.
        (1, [jumped(2)], [0, 3], [], 2),
        (1, [jumped(2), INCONSISTENT], [0], [], 2),
        (1, [jumped(2), jumped(1)], [2], [2], None),
        (1, [INCONSISTENT, withheld(Reason.MISSING, '', 1)], [3], [], 3),
        # The only one without which the others stand.
        (1, [INCONSISTENT], [3], [], 3),
        (2, [INCONSISTENT], [3], [], 3),
        (1, [INCONSISTENT], [], [1], None),
        # Of several, with a single parity the one that left its motion alone.
        (1, [INCONSISTENT], [1, 3], [1], 1),
        (1, [INCONSISTENT], [1, 3], [2], None),
        (1, [INCONSISTENT], [1, 3], [1, 3], None),
        (2, [INCONSISTENT], [1, 3], [1], None),
    ],
)
def test_the_faulty_sensor_is_the_only_one_that_the_evidence_leaves(
    entries, symptoms, standing, alone, sensor
):
    device = Device(entries)
    device.standing = standing
    device.joints.single = alone
    for _ in range(3):
        isolated = device.bad(*symptoms)
    assert isolated == sensor
    assert device.fault.symptom.sensor == sensor


@pytest.mark.parametrize(
    ('symptom', 'alone', 'words'),
    [
        (INCONSISTENT, [1], 'joint_1b jumped'),
        (INCONSISTENT, [2], 'joint_1b inconsistent angles'),
        (Symptom(Reason.FROZEN, sensor=1), [1], 'joint_1b frozen'),
    ],
)
def test_a_fault_of_the_sensor_that_left_its_motion_at_the_onset_is_a_jump(symptom, alone, words):
    device = Device()
    device.standing = [1]
    device.joints.single = alone
    device.bad(symptom)
    # What leaves it later is not the reason.
    device.joints.single = [1]
    for _ in range(2):
        device.bad(symptom)
    assert device.latch.words == words


@pytest.mark.parametrize(
    ('reason', 'words'),
    [
        (Reason.NO_FIT, 'no orientation fits'),
        (Reason.UNPROTECTED, 'protection level above the alert limit'),
        (Reason.UNDETERMINED, 'orientation not determined'),
        (
            Reason.DISCONTINUOUS,
            'orientation does not continue the motion, sensor undetermined',
        ),
    ],
)
def test_the_words_say_that_a_sensor_is_undetermined_where_one_is_to_blame(reason, words):
    device = Device()
    device.bad(Symptom(reason, severity=Severity.LATCH))
    assert device.latch.words == words


def test_a_bad_sample_that_names_another_sensor_makes_all_of_them_suspects():
    device = Device(1)
    for _ in range(3):
        device.bad(jumped(2))
    assert device.fault.symptom.sensor == 2
    assert device.bad(jumped(2)) is None
    assert device.bad() is None
    assert device.fault.symptom.sensor == 2
    assert device.fault.last_bad == device.now
    # One parity shows a second fault, and not which.
    device.standing = [1]
    assert device.bad(jumped(1)) is None
    assert device.fault.symptom.sensor is None
    assert device.bad() is None
    assert device.fault.symptom.sensor is None


def test_of_more_parities_a_second_fault_is_isolated_too():
    device = Device(2)
    for _ in range(3):
        device.bad(jumped(2))
    assert device.bad(jumped(1)) == 1
    assert device.fault.symptom.sensor == 1
    device.standing = [4]
    assert device.bad() == 4
    assert device.fault.symptom.sensor == 1
    device.standing = []
    device.bad(jumped(0), jumped(1))
    assert device.fault.symptom.sensor is None
    device.standing = [4]
    device.bad()
    assert device.fault.symptom.sensor == 4


# What ends it ---------------------------------------------------------------------------------


def faulty(*symptoms, entries=1):
    """Return a device with a fault of three bad samples."""
    device = Device(entries)
    for _ in range(3):
        device.bad(*symptoms)
    return device


def test_without_a_fault_none_is_to_end():
    assert Device().ends(0)
    assert Device().latch.acknowledge() == ('', '')


def test_a_fault_ends_after_its_recovery_once_its_sensor_is_checked():
    device = faulty(jumped(2))
    device.checked = [(2, device.fault.last_bad)]
    assert not device.ends(5 * SECOND)
    assert not device.ends(SECOND - 1)
    assert device.fault.waiting == ()
    assert device.ends(1)
    assert device.fault is None


def test_a_fault_of_no_known_sensor_waits_for_a_check_of_all():
    device = faulty()
    assert not device.ends(0)
    assert not device.ends(SECOND)
    assert device.fault.waiting == (0, 1, 2, 3)
    device.checked = [(sensor, device.fault.last_bad) for sensor in (0, 1, 2)]
    assert not device.ends(MS)
    assert device.latch.words == (
        'inconsistent angles, sensor undetermined; waits until checked: joint_3a; ' + TURN
    )
    device.checked.append((3, device.fault.last_bad))
    assert device.ends(MS)


@pytest.mark.parametrize('sample', [UNSURE, INCONSISTENT])
def test_the_recovery_begins_again_with_a_sample_that_does_not_agree(sample):
    device = faulty(jumped(2))
    assert not device.ends(0)
    assert not device.ends(SECOND)
    assert device.fault.waiting == (2,)
    device.bad(sample)
    device.checked = [(2, device.fault.last_bad)]
    assert (device.fault.waiting == ()) == (sample is INCONSISTENT)
    assert not device.ends(0)
    assert not device.ends(SECOND - 1)
    assert device.ends(1)


def test_after_a_person_acknowledged_it_no_check_is_waited_for():
    device = faulty(jumped(2))
    assert not device.ends(0)
    assert not device.ends(SECOND)
    answer = device.latch.acknowledge()
    assert answer == ('joint_1c jumped', AGREE)
    assert device.fault.waiting == ()
    assert device.latch.acknowledge() == ('', AGREE)
    device.bad()
    assert not device.fault.is_acknowledged
    answer = device.latch.acknowledge()
    assert answer.ended == 'joint_1c jumped'
    assert not device.ends(0)
    assert device.ends(SECOND)


def test_two_jumps_of_a_single_parity_wait_for_a_person_and_then_for_checks():
    device = Device(1)
    device.joints.leave(0, 1)
    for _ in range(3):
        device.bad()
    device.joints.leave()
    assert device.latch.words == 'joint_1a and joint_1b jumped, to be acknowledged'
    assert not device.ends(0)
    assert not device.ends(5 * SECOND)
    answer = device.latch.acknowledge()
    assert answer.ended == 'joint_1a and joint_1b jumped'
    names = 'joint_1a and joint_1b and joint_1c and joint_3a'
    assert answer.waits == f'{AGREE}, and a check of {names}: {TILT} and {TURN}'
    assert not device.ends(0)
    assert not device.ends(SECOND)
    assert device.fault.waiting == (0, 1, 2, 3)


@pytest.mark.parametrize(
    ('entries', 'left', 'needs_person'),
    [
        (0, (0, 1), True),
        (1, (0, 1), True),
        (1, (0,), False),
        # Two parities show both.
        (2, (0, 1), False),
    ],
)
def test_only_where_two_jumps_may_cancel_a_person_is_needed(entries, left, needs_person):
    device = Device(entries)
    device.joints.leave(*left)
    for _ in range(3):
        device.bad()
    assert device.fault.needs_person == needs_person
    assert device.fault.jumped == dict.fromkeys(left, 1)


def test_a_jump_counts_by_the_motion_that_it_left_first():
    device = Device(1)
    device.joints.leave(0)
    device.joints.departures[0] = 4
    for _ in range(3):
        device.bad()
    assert device.fault.jumped == {0: 4}
    device.joints.departures[0] = 5
    device.joints.leave(0, 1)
    device.bad()
    assert device.fault.jumped == {0: 4, 1: 1}


@pytest.mark.parametrize(
    ('symptoms', 'explained'),
    [
        ([INCONSISTENT], True),
        ([jumped(0)], True),
        ([Symptom(Reason.NO_FIT), jumped(0)], True),
        ([Symptom(Reason.DISCONTINUOUS), UNSURE], True),
        ([Symptom(Reason.OUT_OF_RANGE, sensor=0)], True),
        # Another sensor's, or what no jump explains.
        ([jumped(1)], False),
        ([INCONSISTENT, jumped(1)], False),
        ([DRIFTED], False),
        ([Symptom(Reason.FROZEN, sensor=0)], False),
    ],
)
@pytest.mark.parametrize('returns', [True, False])
def test_jumps_that_explain_every_bad_sample_and_returned_need_no_check(
    symptoms, explained, returns
):
    device = Device(1)
    device.joints.leave(0)
    for _ in range(3):
        device.bad(*symptoms)
    device.joints.leave()
    if returns:
        device.joints.returned.add((0, 1))
    assert not device.ends(0)
    assert device.ends(SECOND) == (explained and returns)


@pytest.mark.parametrize('unexplained', [0, 1, 3])
def test_a_bad_sample_without_a_jump_needs_a_check_though_the_jumps_returned(unexplained):
    device = Device(1)
    for number in range(4):
        device.joints.leave(*[0] * (number != unexplained))
        device.bad()
    device.joints.leave()
    device.joints.returned.add((0, 1))
    assert not device.ends(0)
    assert not device.ends(SECOND)


# Jumps in a pause -----------------------------------------------------------------------------


@pytest.mark.parametrize(('jumps', 'sensor'), [([jumped(1)], 1), ([jumped(1), jumped(3)], None)])
def test_jumps_in_a_pause_are_a_fault_at_once(jumps, sensor):
    device = Device(1)
    device.joints.leave(*[each.sensor for each in jumps])
    device.latch.latch_jumps(SECOND, jumps)
    assert device.fault.symptom == Symptom(Reason.JUMPED, sensor=sensor)
    assert device.latch.onset == SECOND
    assert device.fault.last_bad == SECOND
    assert set(device.fault.jumped) == {each.sensor for each in jumps}
    # Once they returned it is over without a check.
    device.joints.returned = {(each.sensor, 1) for each in jumps}
    assert not device.ends(0)
    assert device.ends(SECOND)


def test_no_jump_in_a_pause_is_a_fault_of_one_that_is_latched_or_after_a_series():
    device = Device(1)
    device.latch.latch_jumps(SECOND, [])
    assert device.fault is None
    runs(device, 3)
    device.latch.latch_jumps(SECOND, [jumped(1)])
    assert device.fault is None
    device = faulty(jumped(2))
    device.latch.latch_jumps(9 * SECOND, [jumped(1)])
    assert device.fault.symptom.sensor == 2
    assert device.latch.onset == 7 * SECOND + MS


def test_a_fault_that_is_latched_without_a_jump_is_explained_by_none():
    device = Device(0)
    device.joints.leave(1)
    device.bad()
    device.joints.leave()
    device.good()
    device.latch.latch(device.now, Symptom(Reason.UNPROTECTED))
    assert device.fault.jumped == {}
    assert not device.ends(0)
    assert not device.ends(SECOND)
    assert device.fault.waiting == (0, 1, 2)
