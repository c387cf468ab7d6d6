# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Agreement with an independent multi-body model of the closed chain (MuJoCo)."""

from contextlib import suppress
from itertools import product
import math

from built_mechanism import nominal, random_built, random_nominal
from mechanism import angle_between, MODES, tilted, turn
import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import UnreachableError

mujoco = pytest.importorskip('mujoco', reason='needs mujoco')
MultiBody = pytest.importorskip('paper.mujoco_model').MultiBody


def compare(body, R, mode, rng):
    """Worst disagreement in rad over all forward models, and the multi-body model's own error."""
    g = body.g
    joints = kinematics.inverse(R, g, mode)
    near = turn(math.radians(0.2) * rng.normal(size=3)) @ R
    body.place(joints.theta1, near)
    found, error = body.assemble(joints.theta1)
    measured = float(body.data.qpos[body.third])
    assert abs(math.remainder(measured - joints.theta3a, 2.0 * math.pi)) < 1e-6
    models = [
        kinematics.forward_theta3a(joints.theta1, measured, g),
        kinematics.forward_theta2a(joints.theta1, body.data.qpos[body._address('joint_2a')], g),
        kinematics.estimate(joints.theta1, measured, 1e-3, g, prior=near).rotation,
        min(kinematics.forward_all(joints.theta1, g), key=lambda mode: angle_between(mode, found)),
    ]
    return max(angle_between(found, model) for model in [R, *models]), error


def joint_rates(body):
    """
    Joint velocities for the platform's three unit angular velocities, base frame.

    Rows th1A, th1B, th1C, th3A, from the null space of the constraints, shape (4, 3).
    """
    joints = body.model.nv
    _, _, right = np.linalg.svd(body.data.efc_J.reshape(-1, joints))
    motions = right[-3:]  # two points on spheres: rank 4 of 7 hinges
    turning = np.zeros((3, joints))
    mujoco.mj_jacBody(body.model, body.data, None, turning, body.platform)
    return (motions @ np.eye(joints)[:, [*body.active, body.third]]).T @ np.linalg.inv(
        turning @ motions.T
    )


@pytest.mark.parametrize('phi_deg', [-10.0, 0.0, 20.0, 40.0, 48.0, 55.0])
def test_agreement_over_the_workspace(phi_deg):
    rng = np.random.default_rng(30)
    body = MultiBody(kinematics.Geometry())
    compared = 0
    for tilt, azimuth in product(
        np.radians([0.0, 10.0, 20.0, 26.0]), np.radians(np.arange(0.0, 360.0, 60.0))
    ):
        with suppress(UnreachableError):
            worst, error = compare(
                body, tilted(math.radians(phi_deg), tilt, azimuth), (1, 1, 1), rng
            )
            compared += 1
            # The multi-body model's own error is 6e-13 deg.
            assert error < 1e-14
            assert worst < 1e-10
    assert compared > 12


@pytest.mark.parametrize('mode', MODES)
def test_agreement_in_every_working_mode_on_other_mechanisms_and_as_built(mode):
    rng = np.random.default_rng(32)
    compared = 0
    while compared < 12:
        built = (nominal(), random_nominal(rng), random_built(rng))[compared % 3]
        R = built.reachable_rotation(rng)
        g = built.geometry
        G = kinematics.jacobian(R, g, mode, sensors=4)
        if np.linalg.cond(G[:3]) > 20.0:
            continue  # at a parallel singularity three angles do not determine the platform's pose
        body = MultiBody(g)
        worst, error = compare(body, R, mode, rng)
        assert worst < 1e-9
        assert error < 1e-13
        np.testing.assert_allclose(joint_rates(body), G, atol=1e-7 * np.abs(G).max())
        compared += 1
