# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A set of sensors: whether a sample agrees, other solutions, what the noise may be."""

from dataclasses import replace
from functools import cache
from math import degrees, inf, radians, sqrt

from device import joint_angles
import numpy as np
import pytest
from rig import product_limits
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import AmbiguousError, SingularityError
from spm_haptic_master.kinematics.rotations import multiply_quaternions, quaternion_from_vector
from spm_haptic_master.supervision.parity import ParityWindow
from spm_haptic_master.supervision.protection import integrity
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.sensor_set import SensorSet
from spm_haptic_master.supervision.symptom import Reason, Severity

MS = 1_000_000
SIGMA = radians(0.04)
BIAS = radians(0.05)
SPEED = 20.0
MISSED_DETECTION = 5.3


@cache
def estimate_of(sensors, left_out=()):
    """Return the estimate of exact readings at a pose."""
    rotation = kinematics.workspace_pose(*np.radians([8.0, 30.0, 20.0]))
    readings = joint_angles(rotation[None], sensors)[0]
    return kinematics.estimate_sample(
        tuple(readings.tolist()),
        kinematics.UsedSensors((SIGMA,) * sensors, left_out),
        kinematics.Geometry(),
        tuple(kinematics.quaternion_from_matrix(rotation).tolist()),
    )


class Solutions:
    """A solver whose solutions are as a test says."""

    def __init__(self, found):
        self.found = found
        self.other = []
        self.error = None
        self.searches = 0

    def solve(self, angles, sensors, prior):
        if self.error is not None:
            raise self.error
        return self.found

    def other_solutions(self, found, angles):
        self.searches += 1
        return self.other

    def all_solutions(self, angles, sensors):
        self.searches += 1
        return self.other

    def fit_near(self, quaternion, angles, sensors):
        return self.solve(angles, sensors, quaternion)

    def explaining_orientation(self, near, angles, sensors, most):
        """Return what is asked."""
        return near, sensors.used, most


class Case:
    """A set of mounted sensors without some, and its solver."""

    def __init__(self, sensors=4, left_out=(), sigma=SIGMA, **limits):
        self.count = sensors
        self.limits = product_limits(**limits)
        self.estimate = estimate_of(sensors, left_out)
        self.solver = Solutions(self.estimate)
        self.set = SensorSet(self.solver, (sigma,) * sensors, self.limits, left_out)
        self.worth = integrity(self.estimate, (BIAS,) * sensors, (1.0,) * sensors)
        self.limit = self.set.threshold + self.worth.bias

    def sample(self, number=0, since=1, factors=1.0):
        """Return a sample, so many ms after its prior, or without one."""
        stamp = (1000 + number) * MS
        prior = None
        if since is not None:
            prior = Place(stamp - round(since * MS), self.estimate.quaternion)
        return Sample(
            stamp=stamp,
            angles=(),
            prior=prior,
            bias=(BIAS,) * self.count,
            factors=(factors,) * self.count,
            period=1e-3,
        )

    def off(self, parity=0.0, turn=0.0):
        """Return a solution with a parity, a turn (rad) away."""
        quaternion = multiply_quaternions(
            quaternion_from_vector(turn, 0.0, 0.0), self.estimate.quaternion
        )
        return replace(
            self.estimate,
            quaternion=quaternion,
            parity_vector=(parity,) + (0.0,) * (max(self.set.parity_count, 1) - 1),
        )


@pytest.mark.parametrize(
    ('sensors', 'left_out', 'places', 'entries'),
    [
        (4, (), (0, 1, 2, 3), 1),
        (6, (), (0, 1, 2, 3, 4, 5), 3),
        (6, (1,), (0, 2, 3, 4, 5), 2),
        (4, (1,), (0, 2, 3), 0),
    ],
)
def test_the_parity_has_an_entry_for_each_sensor_beyond_three(sensors, left_out, places, entries):
    members = SensorSet(None, (SIGMA,) * sensors, product_limits(), left_out)
    assert members.members == places
    assert members.parity_count == entries
    assert members.threshold == product_limits().threshold(max(entries, 1))
    assert members.estimate is None
    assert members.worth is None


# Whether a sample agrees ----------------------------------------------------------------------


def test_a_sample_that_agrees_has_an_orientation_and_its_worth():
    case = Case()
    assert case.set.solve(case.sample()) is None
    assert case.set.estimate is case.estimate
    assert case.set.worth == case.worth


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_a_parity_beyond_noise_and_bias_is_inconsistent(sensors):
    case = Case(sensors)
    for factor, agrees in ((0.99, True), (1.01, False)):
        case.solver.found = case.off(factor * case.limit)
        symptom = case.set.solve(case.sample())
        assert (symptom is None) == agrees
    assert symptom.reason is Reason.INCONSISTENT
    assert case.set.estimate is case.solver.found


@pytest.mark.parametrize(
    ('error', 'reason', 'severity'),
    [
        (AmbiguousError('two'), Reason.UNDETERMINED, Severity.WITHHOLD),
        (SingularityError('none'), Reason.NO_FIT, Severity.PENDING),
    ],
)
def test_without_a_solution_there_is_no_orientation(error, reason, severity):
    case = Case()
    case.set.solve(case.sample())
    case.solver.error = error
    symptom = case.set.solve(case.sample(1))
    assert (symptom.reason, symptom.severity) == (reason, severity)
    assert symptom.detail == str(error)
    assert case.set.estimate is None
    assert case.set.worth is None


def test_three_sensors_need_the_last_orientation_and_have_no_parity():
    case = Case(4, (1,))
    symptom = case.set.solve(case.sample(since=None))
    assert symptom.reason is Reason.UNDETERMINED
    assert symptom.severity is Severity.WITHHOLD
    assert case.set.estimate is None
    case.solver.found = case.off(1e3)
    assert case.set.solve(case.sample()) is None


def test_a_restart_forgets_the_window():
    case = Case()
    case.solver.found = case.off(0.8 * case.limit)
    causes = [case.set.solve(case.sample(number)) for number in range(5)]
    assert [cause is not None for cause in causes] == [False] * 4 + [True]
    assert causes[4].reason is Reason.DRIFTED
    case.set.restart()
    causes = [case.set.solve(case.sample(number)) for number in range(5, 10)]
    assert [cause is not None for cause in causes] == [False] * 4 + [True]


# Other solutions ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('factor', 'turn', 'is_unsure'), [(0.99, 1.0, True), (1.01, 1.0, False), (-0.99, 3.0, True)]
)
def test_without_a_prior_any_other_solution_that_fits_is_one_too_many(factor, turn, is_unsure):
    case = Case()
    case.solver.other = [case.off(9e9), case.off(factor * case.limit, turn)]
    symptom = case.set.solve(case.sample(since=None))
    assert (symptom is not None) == is_unsure
    if is_unsure:
        assert symptom.reason is Reason.UNDETERMINED
        assert symptom.severity is Severity.WITHHOLD
        parity = 0.99 * case.limit
        assert symptom.detail.endswith(f'{parity:.1f} sigma, limit {case.limit:.1f}')


@pytest.mark.parametrize('since', [20, 50])
def test_with_a_prior_only_one_in_reach_of_a_human_is(since):
    case = Case(sigma=1e-9)
    reach = SPEED * since * 1e-3 + 6.0 * case.estimate.total_deviation
    for factor, is_unsure in ((0.99, True), (1.01, False)):
        case.solver.other = [case.off(0.0, factor * reach)]
        symptom = case.set.solve(case.sample(since=since))
        assert (symptom is not None) == is_unsure


def test_others_are_computed_only_where_one_may_be_in_reach():
    """It is about sigma / (2 x deviation) away."""
    deviation = Case().worth.deviation
    farthest = 6.0 * deviation + SPEED * 5e-3
    for factor, searches in ((0.99, 1), (1.01, 0)):
        case = Case(sigma=factor * 2.0 * deviation * farthest)
        case.set.solve(case.sample(since=5))
        assert case.solver.searches == searches
        case.set.solve(case.sample(since=None))
        assert case.solver.searches == searches + 1


@pytest.mark.parametrize(('factor', 'is_unsure'), [(0.99, False), (1.01, True)])
def test_of_three_sensors_every_solution_but_the_one_found_is_another(factor, is_unsure):
    case = Case(4, (1,), sigma=1e-9)
    near = 6.0 * case.estimate.total_deviation
    case.solver.other = [case.estimate, case.off(0.0, factor * near)]
    symptom = case.set.solve(case.sample(since=50))
    assert (symptom is not None) == is_unsure


def test_solutions_next_to_an_orientation_and_all_of_them_have_to_agree():
    case = Case()
    good = case.off(0.99 * case.limit)
    bad = case.off(1.01 * case.limit)
    assert case.set.agrees(case.sample(), good)
    assert not case.set.agrees(case.sample(), bad)
    case.solver.other = [bad, good, bad, case.estimate]
    assert case.set.every(case.sample()) == [good, case.estimate]
    case.solver.found = good
    assert case.set.near(case.sample(), good.quaternion) is good
    case.solver.found = bad
    assert case.set.near(case.sample(), good.quaternion) is None
    case.solver.error = SingularityError('none')
    assert case.set.near(case.sample(), good.quaternion) is None


@pytest.mark.parametrize('factor', [1.0, 2.0])
def test_an_orientation_explains_the_readings_within_noise_and_the_bias_of_those_in_use(factor):
    case = Case(6, (1,))
    near = case.estimate.quaternion
    found, used, most = case.set.explaining(case.sample(factors=factor), near)
    assert found == near
    assert used == (0, 2, 3, 4, 5)
    assert most == pytest.approx(case.set.threshold * factor + sqrt(5.0) * BIAS / SIGMA)


# Parts and noise ------------------------------------------------------------------------------


def test_the_parts_are_those_of_the_mean_of_its_window():
    case = Case()
    undetected = (case.set.threshold + MISSED_DETECTION) / sqrt(10.0)
    assert case.set.parts(case.worth) == pytest.approx(case.worth.parts(undetected))
    for number in range(30):
        case.set.solve(case.sample(number))
    undetected = (case.set.threshold + MISSED_DETECTION) / sqrt(21.0)
    assert case.set.parts(case.worth) == pytest.approx(case.worth.parts(undetected))
    # With the mean bias of the window where that is larger than the latest.
    steady = replace(case.worth, bias=0.0)
    expected = case.worth.parts(undetected)
    assert case.set.parts(steady) == pytest.approx(expected)


@pytest.mark.parametrize(('sensors', 'left_out'), [(4, ()), (6, ()), (6, (1,))])
def test_the_measured_variance_of_the_parity_bounds_the_noise_of_each_sensor(sensors, left_out):
    """The sum of the entries' variances is n + s (f^2 - 1) for a share s and a factor f."""
    case = Case(sensors, left_out)
    assert case.set.noise_bounds() == [inf] * sensors
    entries = case.set.parity_count
    beside = ParityWindow(case.set.threshold, entries, case.limits.window)
    for number in range(100):
        case.solver.found = case.off(4.0 * (-1.0) ** number)
        sample = case.sample(number)
        case.set.solve(sample)
        beside.test(sample.stamp, case.solver.found.parity_vector, 1.0, case.worth.bias)
    assert beside.variance > 2.0
    bounds = case.set.noise_bounds()
    for sensor, bound in enumerate(bounds):
        if sensor in left_out:
            assert bound == inf
            continue
        share = (case.estimate.parity_sizes[sensor] * SIGMA) ** 2
        assert entries + share * (bound**2 - 1.0) == pytest.approx(entries * beside.variance)


def test_less_noise_than_configured_lowers_no_bound_and_one_that_is_not_seen_has_none():
    case = Case()
    for number in range(100):
        case.set.solve(case.sample(number))
    assert case.set.noise_bounds() == [1.0] * 4
    for share, is_seen in ((0.99e-6, False), (1.01e-6, True)):
        sizes = (sqrt(share) / SIGMA, *case.estimate.parity_sizes[1:])
        case.set.estimate = replace(case.estimate, parity_sizes=sizes)
        assert case.set.noise_bounds()[0] == (1.0 if is_seen else inf)


def test_a_sensor_is_too_noisy_whose_noise_alone_exceeds_its_part():
    case = Case(6)
    assert case.set.too_noisy(case.sample(factors=9.0)) is None
    case.set.solve(case.sample())
    parts = case.set.parts(case.worth)
    sizes = case.estimate.gain_sizes
    factors = [
        part / (MISSED_DETECTION * SIGMA * size) for part, size in zip(parts, sizes, strict=True)
    ]
    noisiest = factors.index(min(factors))
    least = min(factors)
    assert case.set.too_noisy(case.sample(factors=0.99 * least)) is None
    symptom = case.set.too_noisy(case.sample(factors=1.01 * least))
    assert symptom.reason is Reason.NOISY
    assert symptom.severity is Severity.LATCH
    assert symptom.sensor == noisiest
    assert symptom.detail == f'{degrees(1.01 * least * SIGMA):.2f} deg'


def test_half_as_much_noise_again_is_too_much_of_a_sensor_that_turns_the_orientation_alone():
    """Noise as configured never is."""
    case = Case(6)
    case.set.estimate = replace(
        case.estimate,
        gain_sizes=(1.0,) + (1e-6,) * 5,
        parity_sizes=(1e6,) * 6,
        covariance=(SIGMA**2,) + (0.0,) * 8,
    )
    assert case.set.too_noisy(case.sample(factors=1.0)) is None
    assert case.set.too_noisy(case.sample(factors=1.5)).sensor == 0
