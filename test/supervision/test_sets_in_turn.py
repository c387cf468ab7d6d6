# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which set of sensors is in use, and which one takes over: sample by sample, with one pose."""

from functools import cache
from math import inf, isnan, nan, radians

from device import joint_angles
import numpy as np
import pytest
from rig import product_limits
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.sensors_in_use import plausible, SensorsInUse
from spm_haptic_master.supervision.symptom import Reason, Severity

MS = 1_000_000
BEGIN = 1000 * MS
SIGMA = radians(0.04)
ROTATION = kinematics.workspace_pose(*np.radians([8.0, 30.0, 20.0]))
HERE = tuple(kinematics.quaternion_from_matrix(ROTATION).tolist())
# A window of 10 samples, and a recovery of 20 ms.
LIMITS = {'window': 0.0095, 'recovery': 0.02}


@cache
def estimate_of(sensors):
    """Return the estimate of exact readings by used sensors."""
    readings = joint_angles(ROTATION[None], len(sensors.sigma))[0]
    return kinematics.estimate_sample(
        tuple(readings.tolist()), sensors, kinematics.Geometry(), HERE
    )


class Agreement:
    """A solver by which all sets agree that leave some sensors out, and no other."""

    def __init__(self):
        self.wrong = set()

    def solve(self, angles, sensors, prior):
        if self.wrong & set(sensors.used):
            raise SingularityError('wrong')
        return estimate_of(sensors)

    def other_solutions(self, found, angles):
        return []

    def all_solutions(self, angles, sensors):
        return []

    def explaining_orientation(self, near, angles, sensors, most):
        return None


class Mounted:
    """Mounted sensors, with the readings and faults that a test says, a ms between samples."""

    def __init__(self, count=6, **limits):
        self.count = count
        self.solver = Agreement()
        self.places = {}
        self.factors = [1.0] * count
        self.here = HERE
        self.now = BEGIN
        limits = product_limits(**LIMITS | limits)
        self.sensors = SensorsInUse(self.solver, (SIGMA,) * count, limits)

    def read(self, *missing, count=1):
        """Note samples without the readings of some sensors; return the cause of the last one."""
        angles = tuple(nan if place in missing else 0.1 for place in range(self.count))
        for _ in range(count):
            cause = self.sensors.note_readings(angles)
        return cause

    def sample(self):
        return Sample(
            stamp=self.now,
            angles=(0.1,) * self.count,
            prior=Place(self.now - MS, HERE),
            bias=(1e-4,) * self.count,
            factors=tuple(self.factors),
            period=1e-3,
        )

    def try_others(self, count=1):
        """Let samples that the sensors in use contradict follow; return the latest stamp, ns."""
        for _ in range(count):
            self.now += MS
            self.sensors.try_others(self.sample(), self.places.get)
        return self.now

    def readmit(self, count=1, alert_limit=inf, returned=()):
        """Let samples with which those in use agree follow; return the last symptom."""
        for _ in range(count):
            self.now += MS
            here = Place(self.now, self.here)
            sample = self.sample()
            symptom = self.sensors.readmit(sample, here, alert_limit, returned.__contains__)
        return symptom


@pytest.mark.parametrize('value', [1.000001e6, -1.000001e6, inf, -inf])
def test_a_reading_that_no_joint_has_is_none(value):
    angles = (0.1, value, nan, -1e6)
    first, second, third, fourth = plausible(angles)
    assert (first, fourth) == (0.1, -1e6)
    assert isnan(second)
    assert isnan(third)
    for healthy in ((0.1, 1e6, -1e6, nan), (0.1, 0.2, 0.3, 0.4)):
        assert plausible(healthy) is healthy


# Missing readings -----------------------------------------------------------------------------


def test_two_samples_without_a_reading_leave_a_sensor_out_for_as_long():
    mounted = Mounted()
    sensors = mounted.sensors
    assert sensors.used.members == (0, 1, 2, 3, 4, 5)
    for _ in range(3):
        assert mounted.read(4, count=2) is None
        assert sensors.missing == sensors.left_out == (4,)
        assert sensors.used.members == (0, 1, 2, 3, 5)
        assert sensors.words == ''
        assert mounted.read() is None
        assert sensors.missing == sensors.left_out == ()
        assert sensors.used.members == (0, 1, 2, 3, 4, 5)


def test_three_samples_without_a_reading_are_a_missing_sensor():
    mounted = Mounted()
    sensors = mounted.sensors
    mounted.read(4, count=3)
    assert sensors.words == 'joint_3b missing'
    assert sensors.distrusted[4].time == 0.0095
    mounted.read()
    assert sensors.missing == ()
    assert sensors.left_out == (4,)
    mounted.read(0, count=3)
    assert sensors.words == 'joint_1a missing, joint_3b missing'
    assert sensors.left_out == (0, 4)


@pytest.mark.parametrize(
    ('count', 'missing', 'words', 'first'),
    [
        (6, (4, 5), 'joint_3b missing, joint_3c missing', None),
        # Four others have to be left.
        (6, (2, 4, 5), '', 2),
        (5, (1,), 'joint_1b missing', None),
        (4, (3,), '', 3),
    ],
)
def test_fewer_than_four_readings_do_not_suffice(count, missing, words, first):
    mounted = Mounted(count)
    for _ in range(4):
        cause = mounted.read(*missing)
        assert (cause and cause.sensor) == first
    assert mounted.sensors.words == words
    if first is not None:
        assert cause.reason is Reason.MISSING
        assert cause.severity is Severity.WITHHOLD
        assert cause.detail.endswith(' rad')


def test_four_have_to_be_read_even_where_three_may_go_on():
    mounted = Mounted(6, fewest_sensors=3)
    assert mounted.read(2, 4) is None
    assert mounted.read(2, 4, 5).sensor == 2


@pytest.mark.parametrize(('fewest', 'suffices'), [(3, True), (4, False), (5, False)])
def test_how_few_sensors_may_go_on_is_a_limit(fewest, suffices):
    mounted = Mounted(4, fewest_sensors=fewest)
    mounted.sensors.exclude(1)
    cause = mounted.read()
    assert (cause is None) == suffices
    if not suffices:
        assert cause.sensor is None
    assert mounted.sensors.used.members == (0, 2, 3)


def test_the_set_in_use_stays_if_fewer_than_three_are_left():
    mounted = Mounted(4)
    mounted.read(1)
    assert mounted.sensors.used.members == (0, 2, 3)
    assert mounted.read(1, 2).sensor == 1
    assert mounted.sensors.used.members == (0, 2, 3)
    assert mounted.sensors.left_out == (1, 2)


def test_a_set_is_made_once_and_one_less_needs_three():
    sensors = Mounted(5).sensors
    assert sensors.without(3, 1) is sensors.without(1, 3, 3)
    assert sensors.without(3, 1).members == (0, 2, 4)
    assert sensors.one_less(2).members == (0, 1, 3, 4)
    sensors.exclude(1)
    assert sensors.one_less(2).members == (0, 3, 4)
    assert sensors.one_less(1).members == (0, 2, 3, 4)
    sensors.exclude(2)
    assert sensors.one_less(3) is None


# A set that takes over ------------------------------------------------------------------------


def test_the_others_pass_their_trial_without_a_faulty_sensor():
    mounted = Mounted(5)
    sensors = mounted.sensors
    mounted.solver.wrong = {1}
    assert not sensors.is_trying
    stamp = mounted.try_others(9)
    assert sensors.is_trying
    assert sensors.passing(stamp, 0) == []
    assert sensors.standing(stamp, 0) == [1]
    stamp = mounted.try_others()
    assert sensors.passing(stamp, 0) == []
    stamp = mounted.try_others()
    assert sensors.passing(stamp, 0) == [1]
    assert sensors.standing(stamp, 0) == [1]


def test_a_trial_has_a_place_until_it_ends():
    mounted = Mounted(5)
    sensors = mounted.sensors
    mounted.solver.wrong = {1}
    stamp = mounted.try_others(11)
    (at,) = sensors.places_on_trial().values()
    assert list(sensors.places_on_trial()) == [1]
    assert at.stamp == stamp
    assert at.quaternion == pytest.approx(HERE)
    sensors.end_trials()
    assert not sensors.is_trying
    assert sensors.passing(stamp, 0) == []
    assert sensors.places_on_trial() == {}


def test_a_set_that_agreed_up_to_the_fault_passes_at_once():
    mounted = Mounted(5)
    mounted.places = dict.fromkeys(range(5), Place(BEGIN, HERE))
    mounted.solver.wrong = {1}
    stamp = mounted.try_others()
    assert mounted.sensors.passing(stamp, BEGIN + MS) == [1]
    assert mounted.sensors.passing(stamp, BEGIN) == []
    # With a gap behind its place it is not known.
    mounted = Mounted(5)
    mounted.places = dict.fromkeys(range(5), Place(BEGIN - 2 * MS, HERE))
    mounted.solver.wrong = {1}
    stamp = mounted.try_others()
    assert mounted.sensors.passing(stamp, BEGIN + MS) == []


def test_a_trial_that_failed_stands_again_once_it_passes():
    mounted = Mounted(5)
    mounted.solver.wrong = {1, 2}
    mounted.try_others()
    mounted.solver.wrong = {1}
    stamp = mounted.try_others(10)
    assert mounted.sensors.standing(stamp, 0) == []
    stamp = mounted.try_others()
    assert mounted.sensors.standing(stamp, 0) == [1]


def test_three_others_are_tested_only_where_their_motion_is_known():
    mounted = Mounted(4)
    mounted.places = {sensor: Place(BEGIN, HERE) for sensor in (0, 1, 2)}
    mounted.places[3] = Place(BEGIN - 100 * MS, HERE)
    mounted.try_others()
    assert not mounted.sensors.are_trials_conclusive
    mounted = Mounted(4)
    mounted.places = {sensor: Place(BEGIN, HERE) for sensor in range(4)}
    mounted.try_others()
    assert mounted.sensors.are_trials_conclusive


def test_a_missing_sensor_is_in_no_set_on_trial():
    mounted = Mounted(5)
    mounted.read(2)
    mounted.solver.wrong = {1}
    stamp = mounted.try_others(20)
    assert mounted.sensors.passing(stamp, 0) == []
    assert mounted.sensors.standing(stamp, 0) == []
    # Its own set leaves it out.
    assert mounted.sensors.is_trying
    assert mounted.sensors.places_on_trial() == {}


def test_an_excluded_sensor_is_named_and_ends_the_trials():
    mounted = Mounted(5)
    mounted.try_others()
    mounted.sensors.exclude(1)
    assert not mounted.sensors.is_trying
    assert mounted.sensors.words == 'joint_1b excluded'
    assert mounted.sensors.used.members == (0, 2, 3, 4)
    assert mounted.sensors.distrusted[1].time == 0.02
    # The others of three more cannot be on trial with less than three.
    mounted.solver.wrong = {2}
    mounted.places = dict.fromkeys(range(5), Place(BEGIN + MS, HERE))
    stamp = mounted.try_others(2)
    assert mounted.sensors.passing(stamp, BEGIN + 9 * MS) == [2]


def test_of_three_sensors_in_use_none_is_left_out_but_for_another():
    mounted = Mounted(4, fewest_sensors=3)
    mounted.sensors.exclude(1)
    stamp = mounted.try_others(20)
    assert mounted.sensors.is_trying
    assert mounted.sensors.passing(stamp, 0) == []
    assert mounted.sensors.standing(stamp, 0) == []


@pytest.mark.parametrize('mistaken', [False, True])
def test_one_sensor_replaces_another_once_a_single_set_has_agreed_for_long(mistaken):
    """Joint 1 healed, and joint 2 failed."""
    mounted = Mounted(5)
    sensors = mounted.sensors
    sensors.exclude(1)
    mounted.solver.wrong = set() if mistaken else {2}
    stamp = mounted.try_others(20)
    assert not sensors.exchange(stamp)
    stamp = mounted.try_others()
    assert sensors.exchange(stamp) != mistaken
    expected = 'joint_1b excluded' if mistaken else 'joint_1c excluded'
    assert sensors.words == expected
    assert sensors.is_trying == mistaken


# A sensor that is used again ------------------------------------------------------------------


def test_a_sensor_is_used_again_once_it_has_agreed_for_its_time():
    mounted = Mounted(6)
    sensors = mounted.sensors
    sensors.exclude(1)
    mounted.readmit(20)
    assert sensors.words == 'joint_1b excluded'
    mounted.readmit()
    assert sensors.words == ''
    assert sensors.used.members == (0, 1, 2, 3, 4, 5)


@pytest.mark.parametrize(
    'spoil', ['disagrees', 'unchecked', 'missing', 'restart', 'elsewhere', 'noisy']
)
def test_its_time_begins_again_where_it_is_not_seen_to_agree(spoil):
    mounted = Mounted(6)
    sensors = mounted.sensors
    sensors.exclude(1)
    mounted.readmit(20)
    if spoil == 'disagrees':
        mounted.solver.wrong = {1}
        assert mounted.readmit() is None
        mounted.solver.wrong = set()
    elif spoil == 'unchecked':
        mounted.readmit(alert_limit=1e-6)
    elif spoil == 'missing':
        mounted.read(1, count=3)
        mounted.readmit()
        mounted.read()
    elif spoil == 'elsewhere':
        # The orientation of those in use is another one.
        mounted.here = (0.0, 0.0, 0.0, 1.0)
        mounted.readmit()
        mounted.here = HERE
    elif spoil == 'noisy':
        mounted.factors[1] = 50.0
        mounted.readmit()
        mounted.factors[1] = 1.0
    else:
        sensors.restart()
    mounted.readmit(20)
    assert sensors.words == 'joint_1b excluded'
    mounted.readmit()
    assert sensors.words == ''


def test_the_noise_of_another_sensor_does_not_matter():
    mounted = Mounted(6)
    mounted.sensors.exclude(1)
    mounted.factors[2] = 50.0
    mounted.readmit(21)
    assert mounted.sensors.words == ''


def test_a_missing_sensor_is_not_tried():
    mounted = Mounted(6)
    mounted.read(1, count=3)
    mounted.readmit(50)
    assert mounted.sensors.words == 'joint_1b missing'
    mounted.read()
    mounted.readmit(10)
    assert mounted.sensors.words == 'joint_1b missing'
    mounted.readmit()
    assert mounted.sensors.words == ''


@pytest.mark.parametrize(
    ('count', 'samples', 'returned', 'contradicts'),
    [
        # It had come back to three others by its agreement, or by its own motion.
        (4, 11, (), True),
        (4, 9, (), False),
        (4, 1, (1,), True),
        (4, 1, (2,), False),
        # Four others are checked by each other.
        (5, 11, (), False),
        (5, 1, (1,), False),
    ],
)
def test_one_that_had_come_back_to_three_and_disagrees_contradicts_them(
    count, samples, returned, contradicts
):
    mounted = Mounted(count)
    mounted.sensors.exclude(1)
    assert mounted.readmit(samples, returned=returned) is None
    mounted.solver.wrong = {1}
    symptom = mounted.readmit(returned=returned)
    assert (symptom is not None) == contradicts
    if contradicts:
        assert symptom.reason is Reason.INCONSISTENT
        assert symptom.severity is Severity.LATCH
        assert symptom.sensor is None
        assert symptom.detail.startswith('joint_1b had come back')


def test_a_restart_forgets_the_samples_of_every_set():
    mounted = Mounted(5, window=0.02)
    used = mounted.sensors.used
    used.solve(mounted.sample())
    before = used.parts(used.worth)
    for _ in range(20):
        mounted.now += MS
        used.solve(mounted.sample())
    assert max(used.parts(used.worth)) < max(before)
    mounted.sensors.restart()
    assert used.parts(used.worth) == pytest.approx(before, rel=1e-3)


def test_a_restart_ends_all_trials():
    mounted = Mounted(5)
    mounted.try_others()
    mounted.sensors.exclude(1)
    mounted.try_others()
    mounted.readmit()
    assert mounted.sensors.distrusted[1].trial is not None
    mounted.sensors.restart()
    assert not mounted.sensors.is_trying
    assert mounted.sensors.distrusted[1].trial is None
