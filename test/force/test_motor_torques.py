# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motor torques for a torque on the handle: the static map, its limits and its continuity."""

from itertools import product
import math

from built_mechanism import random_built, random_nominal
from mechanism import MODES
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError, SpmError, UnreachableError
from spm_haptic_master.force import (
    ForceController,
    ForceLimits,
    Gravity,
    identify_gravity,
    render,
)
from spm_haptic_master.force.gravity import Weight
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.force.statics import LegPose
from spm_haptic_master.kinematics import (
    Geometry,
    inverse,
    jacobian,
    matrix_from_quaternion,
    quaternion_from_matrix,
    workspace_pose,
)

PAPER = Geometry()
MODE = (1, 1, 1)
UNLIMITED = 1e6


def flat(R):
    return tuple(np.ravel(R).tolist())


def poses(count, seed=0, half_angle=20.0, low=0.0, high=95.0):
    """Poses of the workspace within reach, and G with four rows."""
    rng = np.random.default_rng(seed)
    tilt, azimuth, phi = rng.uniform(size=(3, count))
    R = workspace_pose(
        math.radians(half_angle) * np.sqrt(tilt),
        2.0 * math.pi * azimuth,
        np.radians(low + (high - low) * phi),
    )
    G = jacobian(R, sensors=4)
    known = np.isfinite(G).all((1, 2))
    return R[known], G[known]


def directions(count, size, seed=1):
    drawn = np.random.default_rng(seed).normal(size=(count, 3))
    return size * drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def largest_step(torques):
    """Return how far a torque is at most from the one before."""
    return np.linalg.norm(np.diff(torques, axis=0), axis=1).max()


def nominal_and_pose(rng):
    """Draw a nominal mechanism, and how a pose of it is drawn."""
    built = random_nominal(rng)
    return built.geometry, lambda: built.reachable_rotation(rng)


def built_and_pose(rng):
    """Draw a mechanism as built, and how a pose of it is drawn."""

    def draw():
        azimuth = rng.uniform(0.0, 6.0)
        phi = rng.uniform(0.0, 0.7)
        return workspace_pose(0.2, azimuth, phi)

    return random_built(rng).geometry, draw


def test_the_rows_are_the_jacobian_of_the_inverse_model():
    rng = np.random.default_rng(2)
    for trial in range(40):
        g, draw = nominal_and_pose(rng) if trial % 2 else built_and_pose(rng)
        for mode in (MODES[trial % 8], MODE):
            R = draw()
            try:
                G = jacobian(R, g, mode, sensors=4)
            except SpmError:
                continue
            statics = make_statics(g, mode, 4, ForceLimits())
            statics.place(flat(R))
            np.testing.assert_allclose(
                statics.rows(),
                G,
                rtol=1e-9,
                atol=1e-9 * np.abs(G).max(),
            )


def test_four_motors_render_all_with_the_least_heat_or_the_least_peak():
    """1 N m on the handle takes at most 1.00 N m of a motor; 0.88 at the least peak."""
    R, G = poses(4000, seed=4)
    torque = directions(len(R), 1.0)
    least_heat = render(R, torque, motors=4, motor_torque_limit=UNLIMITED)
    assert np.abs(least_heat.motor_torque).max() <= 1.0
    expected = np.einsum('nji,nj->ni', np.linalg.pinv(G), torque)
    np.testing.assert_allclose(least_heat.motor_torque, expected, atol=1e-12)
    least_peak = render(R, torque, motors=4, motor_torque_limit=0.88)
    np.testing.assert_allclose(least_peak.rendered, torque, atol=1e-9)
    assert np.abs(least_peak.motor_torque).max() <= 0.88


def test_four_motors_within_the_limit_have_the_least_heat_of_all():
    """Against a fine search over what the parity vector adds."""
    R, G = poses(200, seed=5)
    torque = directions(len(R), 1.0)
    added = np.linspace(-2.0, 2.0, 8001)
    for limit in (0.5, 0.65):
        found = render(R, torque, motors=4, motor_torque_limit=limit)
        for tau, felt, g, m in zip(found.motor_torque, found.rendered, G, torque, strict=True):
            least = np.linalg.pinv(g).T @ m
            left, _, _ = np.linalg.svd(g)
            turns_nothing = left[:, 3]
            tried = least[:, None] + np.outer(turns_nothing, added)
            peaks = np.abs(tried).max(axis=0)
            share = min(1.0, limit / peaks.min())
            np.testing.assert_allclose(felt, share * m, atol=1e-3)
            if share == 1.0:
                fewest = np.abs(added[peaks <= limit]).min()
                assert abs(turns_nothing @ tau) <= fewest + 1e-9


def test_three_motors_are_exact_at_three_poses_of_four():
    R, _ = poses(6000, seed=6)
    torque = directions(len(R), 0.3)
    found = render(R, torque)
    exact = np.linalg.norm(found.rendered - torque, axis=1) < 1e-9
    assert exact.mean() >= 0.75
    assert np.abs(found.motor_torque).max() <= 0.5


def test_strong_directions_are_exact_unless_a_motor_is_at_its_limit():
    R, G = poses(4000, seed=7)
    torque = directions(len(R), 0.2)
    _, sigma, right = np.linalg.svd(G[:, :3])
    found = render(R, torque)
    free = np.abs(found.motor_torque).max(axis=1) < 0.5 - 1e-9
    missing = found.rendered - torque
    weak = right[:, 2]
    along_weak = (missing * weak).sum(axis=1, keepdims=True)
    strong = missing - along_weak * weak
    assert free.mean() > 0.5
    assert (sigma[free, 2] < 0.05).sum() > 50
    assert np.linalg.norm(strong[free], axis=1).max() <= 1e-4 * 0.2


def test_nothing_is_added_to_what_the_fade_leaves():
    """Along the weak direction the handle gets the smoothstep of s_3, whatever its sign."""
    R, G = poses(4000, seed=8)
    _, sigma, right = np.linalg.svd(G[:, :3])
    weak = 0.01 * right[:, 2]
    found = render(R, weak)
    x = np.clip((sigma[:, 2] - 0.05) / 0.1, 0.0, 1.0)
    smoothstep = x * x * (3.0 - 2.0 * x)
    np.testing.assert_allclose(found.fraction, smoothstep, atol=0.01)


@pytest.mark.parametrize('motors', [3, 4])
@pytest.mark.parametrize('size', [0.1, 0.6, 3.0])
def test_what_the_handle_gets_is_what_its_motors_make(motors, size):
    """By the rows of the Jacobian; and a torque the other way takes the opposite of each motor."""
    R, G = poses(500, seed=14)
    torque = directions(len(R), size)
    found = render(R, torque, motors=motors)
    made = np.einsum('nij,ni->nj', G[:, :motors], found.motor_torque)
    np.testing.assert_allclose(found.rendered, made, atol=1e-9)
    back = render(R, -torque, motors=motors)
    np.testing.assert_allclose(back.motor_torque, -found.motor_torque, atol=1e-12)
    np.testing.assert_allclose(back.rendered, -found.rendered, atol=1e-12)


def test_distal_links_of_60_deg_fade_by_the_same_singular_values():
    shorter = Geometry.from_axes(
        PAPER.base_axes,
        PAPER.platform_axes,
        PAPER.alphas,
        np.radians([60.0, 60.0, 60.0]),
    )
    tilt, azimuth, phi = np.random.default_rng(17).random((3, 2000))
    R = workspace_pose(0.4 * tilt, 6.3 * azimuth, 2.8 * phi - 0.7)
    G = jacobian(R, shorter)
    known = np.isfinite(G).all((1, 2))
    _, sigma, right = np.linalg.svd(G[known])
    found = render(R[known], 0.01 * right[:, 2], shorter)
    x = np.clip((sigma[:, 2] - 0.05) / 0.1, 0.0, 1.0)
    assert np.count_nonzero(x < 1.0) > 50
    np.testing.assert_allclose(found.fraction, x * x * (3.0 - 2.0 * x), atol=1e-3)


@pytest.mark.parametrize('motors', [3, 4])
@pytest.mark.parametrize('limit', [0.05, 0.5, 2.0])
def test_no_motor_is_above_its_limit_and_no_torque_within_it_is_cut(motors, limit):
    R, _ = poses(1000, seed=16)
    torque = directions(len(R), 2.0 * limit)
    found = render(R, torque, motors=motors, motor_torque_limit=limit)
    largest = np.abs(found.motor_torque).max(axis=1)
    assert largest.max() == pytest.approx(limit)
    free = largest < 0.6 * limit
    assert free.sum() > 20
    assert found.fraction[free].max() == pytest.approx(1.0)


@pytest.mark.parametrize('motors', [3, 4])
def test_a_base_frame_that_lies_aslant_changes_no_motor_torque(motors):
    turn = matrix_from_quaternion((0.5, -0.1, 0.7, 0.5))
    aslant = Geometry.from_axes(
        np.array(PAPER.base_axes) @ turn.T,
        PAPER.platform_axes,
        PAPER.alphas,
        PAPER.betas,
    )
    R, _ = poses(300, seed=15)
    torque = directions(len(R), 0.4)
    found = render(R, torque, motors=motors)
    turned = render(turn @ R, torque @ turn.T, aslant, motors=motors)
    np.testing.assert_allclose(turned.motor_torque, found.motor_torque, atol=1e-6)
    np.testing.assert_allclose(turned.rendered, found.rendered @ turn.T, atol=1e-6)


def test_a_large_torque_along_the_weak_direction_falls_with_the_distance_from_the_surface():
    """At most 1.4 times the limit of a motor times s_3 less a fifth of sigma_off."""
    R, G = poses(4000, seed=10)
    _, sigma, right = np.linalg.svd(G[:, :3])
    found = render(R, 2.0 * right[:, 2])
    smallest = sigma[:, 2]
    most = 1.4 * 0.5 * (smallest - 0.2 * 0.05)
    felt = np.linalg.norm(found.rendered, axis=1)
    near = (smallest > 0.05) & (smallest < 0.3)
    left = (most - felt)[near]
    assert left.min() > -1e-5
    assert np.mean(left < 1e-3) > 0.8


@pytest.mark.parametrize('tilt_deg', [0.0, 5.0, 12.0])
def test_torques_are_continuous_across_the_singular_surface(tilt_deg):
    """Poses 0.05 deg apart: 0.05 N m of a motor, 0.01 N m at the handle, in every direction."""
    tilt = math.radians(tilt_deg)
    phi = np.radians(np.arange(20.0, 80.0, 0.05))
    axes = (*np.eye(3), np.array([0.6, 0.6, 0.53]))
    for azimuth, axis in product((0.5, 2.5, 4.5), axes):
        R = workspace_pose(tilt, azimuth, phi)
        found = render(R, 0.3 * axis / np.linalg.norm(axis))
        steps = np.diff(found.motor_torque, axis=0)
        assert np.abs(steps).max() <= 0.05
        assert largest_step(found.rendered) <= 0.01


def test_at_the_surface_itself_the_torques_are_finite():
    phi = math.radians(49.358591780)
    for offset in (0.0, 1e-15, -1e-13, 1e-10):
        R = workspace_pose(0.0, 0.0, phi + offset)
        found = render(R, (0.3, -0.1, 0.2))
        assert np.isfinite(found.motor_torque).all()
        assert np.abs(found.motor_torque).max() <= 0.5


def leg_pose(row):
    """Return a leg with a row of G."""
    zero = (0.0, 0.0, 0.0)
    return LegPose(
        third=zero,
        u=0.0,
        divisor=1.0,
        reach=1.0,
        normal=zero,
        row=row,
    )


def test_rows_without_any_rate_give_no_torque_along_it():
    """A mechanism that has lost a direction altogether: no division by zero."""
    motors = make_statics(PAPER, MODE, 3, ForceLimits())
    motors.rotation = tuple(np.eye(3).ravel().tolist())
    rows = (
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (1.0, 1.0, 0.0),
    )
    motors.leg_poses = tuple(map(leg_pose, rows))
    tau, felt = motors.render((0.1, 0.0, 0.3))
    np.testing.assert_allclose(felt, (0.1, 0.0, 0.0), atol=1e-12)
    assert motors.rendered(tau) == felt


def test_four_motors_of_which_two_alone_turn_against_each_other():
    """Two legs of one rate: the torque that turns nothing is on these two."""
    motors = make_statics(PAPER, MODE, 4, ForceLimits(motor_torque=0.2))
    rows = (
        (1.0, 0.0, 0.0),
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
    )
    motors.leg_poses = tuple(map(leg_pose, rows))
    motors.fourth_row = (0.0, 0.0, 1.0)
    tau, felt = motors.render((0.8, 0.0, 0.0))
    np.testing.assert_allclose(tau, (0.2, 0.2, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(felt, (0.4, 0.0, 0.0), atol=1e-12)


@pytest.mark.parametrize('motors', [3, 4])
def test_the_weakness_of_a_pose_is_the_largest_torque_of_its_motors(motors):
    """As a vector, for 1 N m on the handle in the worst direction."""
    controller = ForceController(motors=motors)
    for R, G in zip(*poses(20, seed=11), strict=True):
        worst = np.linalg.norm(np.linalg.pinv(G[:motors]), 2)
        assert controller.weakness(quaternion_from_matrix(R)) == pytest.approx(worst, rel=1e-6)
    assert controller.weakness((0.0, 0.0, 0.0, 1.0)) is None


def test_a_batch_is_its_samples():
    R, _ = poses(30, seed=9)
    torque = directions(len(R), 0.3)
    for motors in (3, 4):
        batch = render(R.reshape(-1, 1, 3, 3), torque[:4], motors=motors)
        assert batch.motor_torque.shape == (len(R), 4, motors)
        assert batch.rendered.shape == (len(R), 4, 3)
        assert batch.fraction.shape == (len(R), 4)
        one = render(R[7], torque[2], motors=motors)
        np.testing.assert_array_equal(one.motor_torque, batch.motor_torque[7, 2])
        assert one.fraction.shape == ()
        assert one.fraction == batch.fraction[7, 2]


@pytest.mark.parametrize('motors', [3, 4])
def test_poses_that_a_leg_does_not_reach_are_those_without_a_jacobian(motors):
    with pytest.raises(UnreachableError):
        render(
            workspace_pose(math.radians(85.0), 0.0, 0.0),
            (0.0, 0.0, 0.1),
            motors=motors,
        )
    tilt, azimuth, phi = np.random.default_rng(12).random((3, 300))
    R = workspace_pose(1.2 * tilt, 6.3 * azimuth, 2.5 * phi)
    reached = np.isfinite(jacobian(R)).all((1, 2))
    found = render(R, (0.0, 0.0, 0.1), motors=motors)
    assert 50 < reached.sum() < 250
    answered = np.isfinite(found.motor_torque).all(axis=1)
    np.testing.assert_array_equal(answered, reached)
    np.testing.assert_array_equal(np.isfinite(found.fraction), reached)


@pytest.mark.parametrize(
    'wrong',
    [
        {'motors': 2},
        {'motors': True},
        {'motor_torque_limit': 0.0},
        {'sigma_off': 0.2},
        {'torque': (0.0, 0.0)},
        {'torque': (0.0, 0.0, math.nan)},
        {'working_mode': (1, 1)},
        {'motor_torque_limit': math.inf},
        {'geometry': None},
    ],
)
def test_wrong_arguments(wrong):
    arguments = {'R': np.eye(3), 'torque': (0.0, 0.0, 0.1)}
    with pytest.raises(InputError):
        render(**(arguments | wrong))


def test_nothing_asked_is_all_rendered():
    found = render(workspace_pose(0.1, 0.0, 0.3), (0.0, 0.0, 0.0))
    assert (found.motor_torque == 0.0).all()
    assert found.fraction == 1.0


@pytest.mark.parametrize('motors', [3, 4])
def test_gravity_is_that_which_the_torques_of_its_motors_hold(motors):
    """On a base that is mounted aslant; the limit of a motor is far."""
    down = (3.0, -5.0, -7.0)
    gravity = Gravity((0.01, -0.02, 0.03), (0.004, 0.001, -0.003, 0.002, 0.005, -0.001), down)
    statics = make_statics(PAPER, MODE, motors, ForceLimits(motor_torque=UNLIMITED))
    weight = Weight(gravity, statics)
    R, G = poses(60, seed=13)
    R = R[np.linalg.svd(G[:, :3], compute_uv=False)[:, 2] > 0.3]
    torques = []
    for pose in R:
        statics.place(flat(pose))
        tau, _ = statics.render(weight.torque())
        torques.append(tau)
    found, left = identify_gravity(R, torques, down=down)
    assert left == pytest.approx(0.0, abs=1e-9)
    assert found.handle == pytest.approx(gravity.handle, abs=1e-9)
    assert found.proximal == pytest.approx(gravity.proximal, abs=1e-9)
    assert found.down == down
    # A millinewtonmetre too much on each motor of one pose is what is left there.
    wrong = np.array(torques)
    wrong[0] += 1e-3
    _, left = identify_gravity(R, wrong, down=down)
    assert 1e-4 < left < 1e-3


def test_the_weight_is_held_by_the_slope_of_its_potential_energy():
    """Every offset, on a base that is mounted aslant: by finite differences."""
    rng = np.random.default_rng(4)
    down = (3.0, -5.0, -7.0)
    step = 1e-5
    handle = tuple(rng.normal(size=3))
    proximal = tuple(rng.normal(size=6))
    gravity = Gravity(handle, proximal, down)
    statics = make_statics(PAPER, MODE, 3, ForceLimits())
    weight = Weight(gravity, statics)

    def energy(R):
        moment = R @ handle
        offsets = np.reshape(proximal, (3, 2))
        for leg, angle, offset in zip(PAPER.legs, inverse(R).theta1, offsets, strict=True):
            along, across = offset
            constant, cosine, sine = np.array(leg.second)
            second = constant + np.cos(angle) * cosine + np.sin(angle) * sine
            moment = moment + along * second + across * np.cross(leg.first, second)
        return -moment @ down

    def turn(vector):
        return matrix_from_quaternion((*(0.5 * vector), 1.0))

    for R in workspace_pose(
        0.3 * rng.random(5),
        6.0 * rng.random(5),
        0.7 * rng.random(5),
    ):
        statics.place(R.ravel().tolist())
        slope = []
        for axis in np.eye(3):
            ahead = energy(turn(step * axis) @ R)
            behind = energy(turn(-step * axis) @ R)
            slope.append((ahead - behind) / (2.0 * step))
        np.testing.assert_allclose(weight.torque(), slope, rtol=1e-6, atol=1e-6)
