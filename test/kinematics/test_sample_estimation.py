# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any three to six sensors in use of four, five or six mounted ones, one sample at a time."""

from contextlib import nullcontext, suppress
from itertools import combinations
import math
import random

from built_mechanism import nominal
from mechanism import angle_between, small_vector, tilted, turn
import numpy as np
import pytest
from readings import (
    all_angles,
    bound,
    case_2_determinant,
    estimated,
    four_angles,
    near_boundary,
    PAPER,
    pose_of_zero,
    SIGMA,
    UNEQUAL,
)
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SingularityError, SpmError
from spm_haptic_master.kinematics import leg_kernels
from spm_haptic_master.kinematics.estimation.gauss_newton import fit
from spm_haptic_master.kinematics.estimation.solutions import other_solutions
from spm_haptic_master.kinematics.number_backends import FLOATS
from spm_haptic_master.kinematics.rotations import rotation_distance

SETS = [
    kinematics.UsedSensors(tuple(UNEQUAL[:mounted].tolist()), left_out)
    for mounted in (4, 5, 6)
    for number in range(mounted - 2)
    for left_out in combinations(range(mounted), number)
]
# Away from the singularities of all sets of three.
POSES = [(0.05, 3.8, 0.4), (0.02, 1.6, 0.5), (0.07, 2.9, 0.4)]
# Factors of a reading of a faulty sensor.
SCALES = (1.0,) * 50 + (1e30, 2.4e307)


def name_of(sensors):
    return f'{len(sensors.sigma)}:{"".join(map(str, sensors.used))}'


def readings_at(R, sensors, mode=(1, 1, 1)):
    """Return the true readings of the mounted sensors; NaN of those that are left out."""
    readings = all_angles(R, mode=mode)[: len(sensors.sigma)].tolist()
    for place in range(len(readings)):
        if place not in sensors.used:
            readings[place] = math.nan
    return tuple(readings)


def quaternion(R):
    return tuple(kinematics.quaternion_from_matrix(R).tolist())


def rotated(sample, R):
    """Return the rotation vector, small, from R to a sample's orientation."""
    found = kinematics.matrix_from_quaternion(sample.quaternion)
    return small_vector(found @ R.T)


# Step of finite differences, rad.
STEP = 1e-5


def pose_for(sensors):
    """Return a pose for some used sensors."""
    return kinematics.workspace_pose(*POSES[sensors.used[-2] % len(POSES)])


def moved_by(sensors, R, place, change):
    """Return the estimate after one reading has changed, rad."""
    readings = list(readings_at(R, sensors))
    readings[place] += change
    prior = quaternion(R)
    return kinematics.estimate_sample(tuple(readings), sensors, PAPER, prior, last_step=1e-9)


def differences(sensors, R):
    """Return how orientation and parity vector follow each reading, by finite differences."""
    mounted = len(sensors.sigma)
    gains = np.zeros((mounted, 3))
    parity_gains = np.zeros((mounted, sensors.count - 3))
    for place in sensors.used:
        ahead = moved_by(sensors, R, place, STEP)
        behind = moved_by(sensors, R, place, -STEP)
        rotation = rotated(ahead, R) - rotated(behind, R)
        parity = np.subtract(ahead.parity_vector, behind.parity_vector)
        gains[place] = rotation / (2.0 * STEP)
        parity_gains[place] = parity / (2.0 * STEP)
    return gains, parity_gains


@pytest.mark.parametrize('sensors', SETS, ids=name_of)
def test_true_readings_give_the_pose(sensors):
    """Four and more need no prior."""
    R = pose_for(sensors)
    readings = readings_at(R, sensors)
    near = quaternion(turn([0.01, -0.01, 0.01]) @ R)
    for prior in (near, None) if sensors.count > 3 else (near,):
        sample = kinematics.estimate_sample(
            readings,
            sensors,
            PAPER,
            prior,
            (1, 1, 1),
            1e-9,
        )
        assert np.linalg.norm(rotated(sample, R)) < 1e-7
        assert len(sample.parity_vector) == sensors.count - 3
        assert np.abs(sample.parity_vector).max(initial=0.0) < 1e-6
        assert (sample.parity is None) == (sensors.count == 3)


@pytest.mark.parametrize('sensors', SETS, ids=name_of)
def test_gains_are_finite_differences_and_make_the_covariance(sensors):
    R = pose_for(sensors)
    sample = moved_by(sensors, R, sensors.used[0], 0.0)
    gains, parity_gains = differences(sensors, R)
    sizes = np.linalg.norm(gains, axis=1)
    np.testing.assert_allclose(sample.gain_sizes, sizes, rtol=1e-3)
    weighted = np.array(sensors.sigma)[:, None] * gains
    covariance = weighted.T @ weighted
    stated = np.reshape(sample.covariance, (3, 3))
    tolerance = 2e-3 * np.trace(covariance)
    np.testing.assert_allclose(covariance, stated, rtol=0.0, atol=tolerance)
    assert sample.total_deviation == pytest.approx(math.sqrt(np.trace(stated)))
    of_sample = np.array(sample.parity_gains)
    np.testing.assert_allclose(SIGMA * parity_gains, SIGMA * of_sample, atol=1e-3)


@pytest.mark.parametrize('sensors', SETS, ids=name_of)
def test_the_parity_vector_is_white_and_an_entry_depends_on_no_later_sensor(sensors):
    sample = moved_by(sensors, pose_for(sensors), sensors.used[0], 0.0)
    sizes = np.linalg.norm(sample.parity_gains, axis=1)
    np.testing.assert_allclose(sample.parity_sizes, sizes, rtol=1e-9, atol=1e-9)
    white = np.array(sensors.sigma)[:, None] * sample.parity_gains
    identity = np.eye(sensors.count - 3)
    np.testing.assert_allclose(white.T @ white, identity, atol=1e-8)
    for entry, place in enumerate(sensors.used[3:]):
        later = list(sensors.used[4 + entry :])
        assert white[place, entry]
        assert not white[later, entry].any()


@pytest.mark.parametrize('sensors', [each for each in SETS if each.count > 3], ids=name_of)
@pytest.mark.parametrize('leg', range(3))
def test_a_solution_in_another_working_mode_is_none(sensors, leg):
    """Where the leg has a sensor in use; a leg without one may have any."""
    R = kinematics.workspace_pose(0.05, 0.5, 0.4)
    mode = tuple(-1 if each == leg else 1 for each in range(3))
    readings = readings_at(R, sensors, mode)
    in_any_mode = kinematics.estimate_sample(readings, sensors, PAPER)
    assert np.linalg.norm(rotated(in_any_mode, R)) < 1e-7
    if {leg, 3 + leg} & set(sensors.used):
        for prior in (None, quaternion(R)):
            with pytest.raises(SpmError):
                kinematics.estimate_sample(readings, sensors, PAPER, prior, (1, 1, 1))
    else:
        kinematics.estimate_sample(readings, sensors, PAPER, None, (1, 1, 1))


@pytest.mark.parametrize('leg', range(3))
@pytest.mark.parametrize(('beyond', 'answered'), [(0.018, True), (0.022, False)])
def test_noise_may_take_a_leg_just_beyond_the_boundary_of_its_mode(leg, beyond, answered):
    mode = tuple(-1 if each == leg else 1 for each in range(3))
    R = near_boundary(leg, beyond)
    readings = tuple(four_angles(R, mode=mode).tolist())
    sensors = kinematics.UsedSensors((SIGMA,) * 4)
    for last_step in (1e-5, LAST_STEP):
        with nullcontext() if answered else pytest.raises(SpmError):
            kinematics.estimate_sample(
                readings,
                sensors,
                PAPER,
                None,
                (1, 1, 1),
                last_step,
            )


def random_readings(seed):
    """Return true readings, and the orientation, of random poses within reach."""
    # Tilt, azimuth and self-rotation.
    smallest = (0.0, 0.0, -1.0)
    largest = (0.5, 6.3, 2.5)
    poses = np.random.default_rng(seed).uniform(smallest, largest, (300, 3))
    known = []
    for R in kinematics.workspace_pose(*poses.T):
        with suppress(SpmError):
            known.append((all_angles(R).tolist(), quaternion(R)))
    return known


def spoiled(rng, readings, used):
    """Return readings with one used sensor anywhere, or all of them."""
    if rng.random() < 0.75:
        readings[rng.choice(used)] = rng.uniform(-7.0, 7.0) * rng.choice(SCALES)
        return readings
    return [rng.uniform(-4.0, 4.0) for _ in readings]


@pytest.mark.parametrize(
    'seed, number',
    [
        (0, 1000),
        pytest.param(1, 5000, marks=pytest.mark.slow),
        *(pytest.param(seed, 5000, marks=pytest.mark.evidence) for seed in (2, 3, 4)),
    ],
)
def test_nothing_but_its_own_errors_is_raised_in_random_calls(seed, number):
    rng = random.Random(seed)
    known = random_readings(seed)
    _, of_first = known[0]
    answered = 0
    for _ in range(number):
        sensors = rng.choice(SETS)
        true, last = rng.choice(known)
        readings = spoiled(rng, true[: len(sensors.sigma)], sensors.used)
        prior = None
        if sensors.count == 3 or rng.random() < 0.5:
            prior = rng.choice((last, of_first))
        mode = rng.choice((None, (1, 1, 1)))
        with suppress(SpmError):
            sample = kinematics.estimate_sample(
                tuple(readings),
                sensors,
                PAPER,
                prior,
                mode,
                2e-3,
            )
            answered += 1
            assert all(map(math.isfinite, sample.quaternion))
            assert all(map(math.isfinite, sample.parity_vector))
            assert sum(sample.covariance[::4]) > 0.0
    assert answered > number / 10


# Where Case 2 gives no start --------------------------------------------------------------------


def degenerate_pose(rng):
    """Find a pose at which the closed form's determinant vanishes."""
    return pose_of_zero(
        lambda R: case_2_determinant(four_angles(R)),
        nominal(),
        rng,
        0.1,
    )


@pytest.fixture(scope='module')
def degenerate_poses():
    """Return poses at which the closed form has no start, each with an orientation nearby."""
    rng = np.random.default_rng(66)
    poses = []
    for _ in range(8):
        R = degenerate_pose(rng)
        near = turn(math.radians(1.0) * rng.normal(size=3)) @ R
        poses.append((R, near))
    return poses


def test_where_the_closed_form_is_degenerate_a_prior_selects(degenerate_poses):
    for R, near in degenerate_poses:
        angles = four_angles(R)
        with pytest.raises(SingularityError):
            kinematics.forward_theta3a(angles[:3], angles[3])
        found = estimated(angles, prior=near)
        assert angle_between(found.rotation, R) < 1e-7
        tolerance = 1e-3 * np.trace(found.covariance)
        np.testing.assert_allclose(found.covariance, bound(R, SIGMA), rtol=1e-3, atol=tolerance)


@pytest.mark.parametrize('sensors', [5, 6])
def test_where_the_closed_form_is_degenerate_a_further_sensor_selects(degenerate_poses, sensors):
    for R, _ in degenerate_poses:
        found = estimated(all_angles(R)[:sensors])
        assert angle_between(found.rotation, R) < 1e-7


def test_where_the_closed_form_is_degenerate_four_angles_alone_may_be_ambiguous(degenerate_poses):
    ambiguous = 0
    for R, _ in degenerate_poses:
        angles = four_angles(R)
        rows = estimated(angles[None])
        try:
            alone = estimated(angles)
        except SingularityError as error:
            ambiguous += 1
            assert 'prior selects' in str(error)
            assert np.isnan(rows.rotation).all()
            assert not rows.determined[0]
        else:
            assert angle_between(alone.rotation, R) < 1e-7
    assert ambiguous > 0


def rival_of(R):
    """Return the other root of leg B's turn equation at a pose, as an orientation."""
    th1a, th1b, th1c, th3a = four_angles(R).tolist()
    _, _, leg_b, _ = leg_kernels.linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
    here = kinematics.inverse(R).theta2a

    def distance(th2a):
        return abs(math.remainder(th2a - here, 2.0 * math.pi))

    equation = leg_kernels.turn_equation(*leg_b)
    th2a = max(leg_kernels.both_turns(equation), key=distance)
    return nominal().chain(0, th1a, th2a, th3a)


@pytest.mark.parametrize(
    ('squared', 'ambiguous', 'selectable'),
    [
        (8.8, True, True),
        (9.2, False, True),
        (99.0, False, True),
        (101.0, False, False),
    ],
)
def test_two_solutions_are_ambiguous_up_to_three_sigma(squared, ambiguous, selectable):
    """A prior selects the worse of them up to 10 sigma, as noise and bias may have made it so."""
    degenerate = degenerate_pose(np.random.default_rng(72))
    R = turn([1e-3, 2e-3, -1e-3]) @ degenerate
    readings = four_angles(R)
    prior = rival_of(R)
    # With a large sigma the prior selects the rival. Its parity is inversely proportional to it.
    rival = estimated(readings, 1.0, prior=prior)
    assert angle_between(rival.rotation, R) > 0.1
    sigma = abs(rival.parity) / math.sqrt(squared)
    assert abs(case_2_determinant(readings)) < 10.0 * sigma
    if ambiguous:
        with pytest.raises(SingularityError, match='prior selects'):
            estimated(readings, sigma)
    else:
        assert angle_between(estimated(readings, sigma).rotation, R) < 1e-9
    found = estimated(readings, sigma, prior=prior)
    expected = rival.rotation if selectable else R
    assert angle_between(found.rotation, expected) < 1e-6
    arguments = tuple(readings), kinematics.UsedSensors((sigma,) * 4), PAPER
    found = kinematics.estimate_sample(*arguments, quaternion(R))
    others = other_solutions(found, tuple(readings), PAPER)
    assert others
    for other in others:
        assert np.linalg.norm(rotated(other, rival.rotation)) < 1e-6
    other = kinematics.estimate_sample(*arguments, quaternion(prior), selectable_parity=10.2)
    assert np.linalg.norm(rotated(other, rival.rotation)) < 1e-6


def test_a_prior_has_no_weight():
    noise = SIGMA * np.array([1.0, -1.0, 2.0, 0.5])
    angles = four_angles(tilted(0.3, 0.1, 0.0)) + noise
    without = estimated(angles)
    found = estimated(angles, prior=tilted(0.2, 0.2, 2.0))
    np.testing.assert_array_equal(found.rotation, without.rotation)
    # Where no leg gives a start the solutions of all legs are tried.
    R = kinematics.workspace_pose(0.1, 1.0, 0.4)
    for prior in (None, turn([0.02, 0.0, 0.0]) @ R):
        found = estimated(all_angles(R), 0.3, prior=prior)
        assert angle_between(found.rotation, R) < 1e-9


# One step of a healthy sample --------------------------------------------------------------------

# Largest last step with which one step is enough on healthy samples (rad).
LAST_STEP = math.sqrt(0.01 * SIGMA)
# Where a healthy sample takes one step; with sensors of which one counts far more than another.
USUAL = [sensors for sensors in SETS if sensors.usual] + [
    kinematics.UsedSensors(tuple(SIGMA * factor for factor in factors))
    for factors in (
        (1.0, 1.0, 1.0, 1.0, 30.0),
        (1.0, 0.1, 1.0, 1.0, 1.0, 30.0),
        (0.1, 1.0, 1.0, 3.0, 0.1, 1.0),
    )
]


def start_of(readings):
    """Return state and linkage of Case 2."""
    th1a, th1b, th1c, th3a = readings[:4]
    view = leg_kernels.linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
    cosine, sine, determinant = leg_kernels.turn_of_second_joint(*view[2:])
    th2a = math.atan2(sine * determinant, cosine * determinant)
    return (th1a, th2a, th3a, th1b, th1c), view


def samples(sensors, number=40):
    """Yield readings of the mounted sensors at random poses, with noise."""
    rng = np.random.default_rng(sensors.count)
    # Tilt, azimuth and self-rotation.
    smallest = (0.0, 0.0, -0.5)
    largest = (0.35, 6.3, 0.7)
    poses = rng.uniform(smallest, largest, (number, 3))
    R = kinematics.workspace_pose(*poses.T)
    angles = all_angles(R)[:, : len(sensors.sigma)]
    noise = sensors.sigma * rng.normal(size=angles.shape)
    for row in angles + noise:
        yield tuple(row.tolist())


@pytest.mark.parametrize('sensors', USUAL, ids=name_of)
def test_what_the_last_step_leaves_is_a_small_part_of_the_deviation(sensors):
    done = 0
    for readings in samples(sensors):
        state, view = start_of(readings)
        arguments = state, view, readings, sensors, PAPER, (1, 1, 1)
        one = fit(*arguments, LAST_STEP)
        converged = fit(*arguments, 1e-12)
        deviation = math.sqrt(sum(converged.covariance[::4]))
        distance = rotation_distance(one.quaternion, converged.quaternion)
        assert distance < 0.03 * deviation
        done += 1
    assert done > 30


def test_another_working_mode_than_that_of_the_readings_is_refused():
    sensors = USUAL[0]
    for readings in samples(sensors, 20):
        state, view = start_of(readings)
        for wrong in ((-1, 1, 1), (1, -1, 1), (1, 1, -1)):
            with pytest.raises(SingularityError, match='working mode'):
                fit(state, view, readings, sensors, PAPER, wrong, LAST_STEP)


def fitted(readings, sensors):
    """Return the estimate from readings, converged."""
    state, view = start_of(readings)
    return fit(
        state,
        view,
        readings,
        sensors,
        PAPER,
        (1, 1, 1),
        1e-12,
    )


@pytest.mark.parametrize('mounted', [4, 5, 6])
@pytest.mark.parametrize('place', [0, 3])
def test_the_others_see_a_fault_of_a_sensor_far_better_than_they_are(mounted, place):
    """Its parity size is the change of the parity vector with its reading."""
    sigma = [0.1] * mounted
    sigma[place] = 1e-9
    sensors = kinematics.UsedSensors(tuple(sigma))
    exact = kinematics.UsedSensors((1e-9,) * mounted)
    change = 1e-6
    for readings in samples(exact, 20):
        wrong = list(readings)
        wrong[place] += change
        healthy = fitted(readings, sensors)
        faulty = fitted(tuple(wrong), sensors)
        parity_change = math.dist(faulty.parity_vector, healthy.parity_vector)
        expected = pytest.approx(parity_change / change, rel=1e-3)
        assert healthy.parity_sizes[place] == expected
