# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The static map against MuJoCo's model of the closed chain, nominal and as built."""

import math

from built_mechanism import random_built
import numpy as np
import pytest
from spm_haptic_master.force import ForceLimits, identify_gravity, render
from spm_haptic_master.force.gravity import Weight
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.kinematics import Geometry, inverse, jacobian, workspace_pose

mujoco = pytest.importorskip('mujoco', reason='needs mujoco')
MultiBody = pytest.importorskip('paper.mujoco_model').MultiBody


def drawn_poses(count, seed):
    rng = np.random.default_rng(seed)
    tilt, azimuth, phi = rng.uniform(size=(3, count))
    R = workspace_pose(
        math.radians(20.0) * np.sqrt(tilt),
        2.0 * math.pi * azimuth,
        math.radians(95.0) * phi,
    )
    reached = np.isfinite(jacobian(R)).all((1, 2))
    return R[reached]


def place(body, R, g):
    th1 = inverse(R, g).theta1
    body.place(th1, R)
    body.assemble(th1)


def motions(body):
    """Motions of the joints without motion of the constraints, one a column, and of the handle."""
    joints = body.model.nv
    constraints = body.data.efc_J.reshape(-1, joints)
    _, _, right = np.linalg.svd(constraints)
    free = right[-3:].T
    turning = np.zeros((3, joints))
    mujoco.mj_jacBody(body.model, body.data, None, turning, body.platform)
    return free, turning @ free


@pytest.mark.parametrize('motors', [3, 4])
@pytest.mark.parametrize('built', [False, True])
def test_torque_that_the_handle_gets_is_mujocos(motors, built):
    """500 poses: the virtual power of motors and handle agrees to 1e-5 N m."""
    g = random_built(np.random.default_rng(1)).geometry if built else Geometry()
    body = MultiBody(g)
    driven = [*body.active, body.third][:motors]
    rng = np.random.default_rng(2)
    R = drawn_poses(125, 3 + motors)
    torque = rng.normal(size=(len(R), 3))
    torque *= 0.3 / np.linalg.norm(torque, axis=1, keepdims=True)
    found = render(R, torque, g, motors=motors)
    for pose, tau, felt in zip(R, found.motor_torque, found.rendered, strict=True):
        place(body, pose, g)
        free, turning = motions(body)
        generalised = free[driven].T @ tau
        expected = np.linalg.solve(turning.T, generalised)
        np.testing.assert_allclose(expected, felt, atol=1e-5)


def heavy_body():
    """Handle and links with mass, the distal links' in the plane of their axes."""
    body = MultiBody(Geometry())
    model = body.model
    model.opt.gravity[:] = 0.0, 0.0, -9.80665
    rng = np.random.default_rng(4)
    for name in 'abc':
        proximal = model.body(f'proximal_{name}').id
        distal = model.body(f'distal_{name}').id
        model.body_mass[[proximal, distal]] = rng.uniform(0.05, 0.1, 2)
        model.body_ipos[proximal] = rng.uniform(-0.03, 0.03, 3)
        # The distal link's own x axis is across Z2k and Z3k.
        model.body_ipos[distal] = 0.0, *rng.uniform(-0.03, 0.03, 2)
    handle = model.body('third').id
    model.body_mass[handle] = 0.15
    model.body_ipos[handle] = 0.01, -0.005, 0.05
    mujoco.mj_setConst(model, body.data)
    return body


def holding(body, R):
    """Return the motor torques that hold MuJoCo's device still, N m."""
    place(body, R, body.g)
    body.data.qvel[:] = 0.0
    mujoco.mj_forward(body.model, body.data)
    free, _ = motions(body)
    bias = free.T @ body.data.qfrc_bias
    return np.linalg.solve(free[body.active].T, bias)


def test_gravity_is_identified_from_twelve_noisy_poses():
    """2 mN m on twenty others, with 1 mN m of noise on each motor."""
    body = heavy_body()
    rng = np.random.default_rng(5)
    R = drawn_poses(400, 6)
    values = np.linalg.svd(jacobian(R), compute_uv=False)
    R = R[values[:, 2] > 0.3]
    learned = R[:12]
    others = R[12:32]
    torques = np.array([holding(body, pose) for pose in learned])
    noise = 1e-3 * rng.normal(size=torques.shape)
    gravity, residual = identify_gravity(learned, torques + noise)
    assert residual <= 3e-3
    statics = make_statics(body.g, (1, 1, 1), 3, ForceLimits())
    weight = Weight(gravity, statics)
    for pose in others:
        statics.place(tuple(pose.ravel().tolist()))
        asked = np.array(weight.torque())
        truth = np.array(statics.rendered(holding(body, pose).tolist()))
        assert np.linalg.norm(truth) > 0.02
        assert np.linalg.norm(asked - truth) <= 2e-3


def test_poses_that_are_all_alike_identify_nothing():
    R = np.repeat(drawn_poses(4, 7)[:1], 12, axis=0)
    with pytest.raises(ValueError, match='determine 3 values'):
        identify_gravity(R, np.zeros((12, 3)))
    with pytest.raises(ValueError, match='as many of each'):
        identify_gravity(R, np.zeros((11, 3)))
