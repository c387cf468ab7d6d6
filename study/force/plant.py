# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device with motors as a multi-body model in MuJoCo, and a hand on its handle."""

from __future__ import annotations

from collections.abc import Sequence
from math import remainder, tau

import mujoco
import numpy as np
from paper.mujoco_model import MultiBody
from spm_haptic_master.force.gravity import STANDARD_GRAVITY
from spm_haptic_master.kinematics import (
    Geometry,
    inverse,
    measured_angles,
    quaternion_from_matrix,
)
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    rotation_from_quaternion,
    vector_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import added, cross, scaled, subtracted, times

# Step of the plant (s), and steps of a control period.
STEP, STEPS = 1e-4, 10
# Handle and platform: inertia about its axis and across it (kg m^2).
ROLL_INERTIA, TILT_INERTIA = 0.25e-3, 1.2e-3
# Inertia of a link (kg m^2) and of a motor's rotor (kg m^2).
LINK_INERTIA, ROTOR_INERTIA = 2e-5, 1e-4
# Viscous friction of a motor's joint (N m s/rad): 1.1e-3 about the handle's axis at phi = 0.
FRICTION = 1.33e-3
# Mass of a body (kg): nothing weighs, MuJoCo asks for one.
MASS = 0.02


class Plant:
    """
    The device with three motors, on th1A, th1B, th1C, or four, on th3A as well.

    It starts at R_base_platform `R`, (3, 3); `friction` is a factor of the joints' friction.
    """

    def __init__(
        self, R: np.ndarray, motors: int = 3, g: Geometry | None = None, friction: float = 1.0
    ) -> None:
        g = Geometry() if g is None else g
        self._body = body = MultiBody(g)
        self.sensors = [*body.active, body.third]
        self._motors = self.sensors[:motors]
        model = self._model = body.model
        model.opt.timestep = STEP
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.eq_solref[:] = 2.0 * STEP, 1.0
        model.eq_solimp[:, :2] = 0.9999
        model.dof_armature[self._motors] = ROTOR_INERTIA
        model.dof_damping[self._motors] = friction * FRICTION
        model.body_mass[1:] = MASS
        model.body_ipos[:] = 0.0
        model.body_inertia[1:] = LINK_INERTIA
        model.body_inertia[body.platform] = TILT_INERTIA, TILT_INERTIA, ROLL_INERTIA
        data = self._data = body.data
        mujoco.mj_setConst(model, data)
        # The links' centres are the centre of rotation and do not move; their tips do, at 1 m.
        model.body_invweight0[:, 0] = model.body_invweight0[:, 1]
        th1 = inverse(R, g).theta1
        body.place(th1, R)
        body.assemble(th1)
        mujoco.mj_forward(model, data)
        x, y, z, w = self.quaternion
        self.hand: Quaternion[float] = (x, y, z, w)
        # Energy that the motors have given to the device (J).
        self.given = 0.0
        # Mass times offset of the handle from the centre, in the platform frame (kg m).
        self.weight: Vector[float] = (0.0, 0.0, 0.0)

    @property
    def quaternion(self) -> Quaternion[float]:
        """R_base_platform, x, y, z, w."""
        w, x, y, z = self._data.xquat[self._body.platform].tolist()
        return x, y, z, w

    @property
    def angles(self) -> tuple[float, ...]:
        """Angles th1A, th1B, th1C, th3A, rad."""
        return tuple(self._data.qpos[self.sensors].tolist())

    @property
    def velocity(self) -> Vector[float]:
        """Angular velocity of the handle in the base frame, rad/s."""
        x, y, z = self._data.cvel[self._body.platform, :3].tolist()
        return x, y, z

    def run(
        self,
        torques: Sequence[float],
        hand_velocity: Vector[float] = (0.0, 0.0, 0.0),
        stiffness: float = 0.0,
        damping: float = 0.0,
    ) -> None:
        """
        Run a control period.

        Parameters
        ----------
        torques : sequence of float
            Torques of the motors, N m.
        hand_velocity : tuple of three float
            Angular velocity of the hand, whose orientation is `hand`, in the base frame, rad/s.
        stiffness, damping : float
            Of the hand's grip, N m/rad and N m s/rad.

        """
        data, model, platform = self._data, self._model, self._body.platform
        data.qfrc_applied[self._motors] = torques
        before = data.qpos[self._motors].copy()
        for _ in range(STEPS):
            data.xfrc_applied[platform, 3:] = added(
                self._grip(hand_velocity, stiffness, damping), self._torque_of_weight()
            )
            mujoco.mj_step(model, data)
        self.given += float(np.dot(torques, data.qpos[self._motors] - before))
        # `mj_step` leaves the poses of bodies one step behind the joints.
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)

    def _grip(
        self, hand_velocity: Vector[float], stiffness: float, damping: float
    ) -> Vector[float]:
        """Return the torque of the hand on the handle, N m."""
        turn = multiply_quaternions(self.hand, conjugate(self.quaternion))
        spring = scaled(stiffness, vector_from_quaternion(*turn))
        return added(spring, scaled(damping, subtracted(hand_velocity, self.velocity)))

    def _torque_of_weight(self) -> Vector[float]:
        """Return the torque of the weight on the handle, N m."""
        offset = times(rotation_from_quaternion(*self.quaternion), self.weight)
        return cross(offset, STANDARD_GRAVITY)

    def drift(self) -> float:
        """Return the largest residual of the constraints, m for links of 1 m."""
        return float(np.abs(self._data.efc_pos).max())


class StiffHand:
    """
    A device in a hand that nothing moves from its path: no dynamics, only the motors' work.

    The parameters and attributes are those of `Plant`.
    """

    def __init__(self, R: np.ndarray, motors: int = 3, g: Geometry | None = None) -> None:
        self._g = Geometry() if g is None else g
        self._motors = motors
        x, y, z, w = quaternion_from_matrix(R).tolist()
        self.hand: Quaternion[float] = (x, y, z, w)
        self.velocity: Vector[float] = (0.0, 0.0, 0.0)
        self.given = 0.0
        self._move()

    def _move(self) -> None:
        self.quaternion = self.hand
        self.angles = measured_angles(rotation_from_quaternion(*self.hand), self._g, (1, 1, 1), 4)

    def run(
        self,
        torques: Sequence[float],
        hand_velocity: Vector[float] = (0.0, 0.0, 0.0),
        stiffness: float = 0.0,
        damping: float = 0.0,
    ) -> None:
        """Run a control period; a stiff hand has no stiffness."""
        before = self.angles
        self._move()
        self.velocity = hand_velocity
        self.given += sum(
            torque * remainder(after - angle, tau)
            for torque, after, angle in zip(
                torques, self.angles[: self._motors], before, strict=False
            )
        )
