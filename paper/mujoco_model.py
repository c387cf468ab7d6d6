# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The closed chain as a multi-body model in MuJoCo, in the place of the paper's SimMechanics model.

It takes any Geometry, nominal or as built, by its link angles and axes. It has seven hinges: leg A
carries the platform, and two point constraints connect the tips of legs B and C to it. MuJoCo has
neither closure formulas nor working modes, only bodies, hinges and constraints; Newton steps
reduce the residuals of its constraints to zero. Nothing here uses the package's own formulas.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import mujoco
import numpy as np
from spm_haptic_master.kinematics import Geometry

# Largest number of Newton steps.
STEPS = 30
# Largest last step of the joints (rad) at which the model counts as assembled.
STEP_TOLERANCE = 1e-13
# Rotation from the base frame of leg A to that of leg B: z to x to y.
LEG_TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# Names of the legs in the model.
LEG_NAMES = 'abc'


def about_z(angle: float) -> np.ndarray:
    """Return the matrix of a rotation about z, rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def about_x(angle: float) -> np.ndarray:
    """Return the matrix of a rotation about x, rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _rotation(matrix: np.ndarray) -> str:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(matrix).ravel())
    return 'quat="' + ' '.join(repr(float(value)) for value in quaternion) + '"'


def _point(vector: Sequence[float] | np.ndarray) -> str:
    return 'pos="' + ' '.join(repr(float(value)) for value in vector) + '"'


def frame_on(nominal: np.ndarray, axis: Sequence[float]) -> np.ndarray:
    """Turn a frame by the smallest rotation that takes its z to a unit vector."""
    quaternion, matrix = np.empty(4), np.empty(9)
    mujoco.mju_quatZ2Vec(quaternion, nominal.T @ np.asarray(axis))
    mujoco.mju_quat2Mat(matrix, quaternion)
    turned: np.ndarray = nominal @ matrix.reshape(3, 3)
    return turned


def base_frame(g: Geometry, k: int) -> np.ndarray:
    """Return the frame of leg k's active joint at zero, in the base."""
    return frame_on(np.linalg.matrix_power(LEG_TURN, k), g.base_axes[k])


def platform_frame(g: Geometry) -> np.ndarray:
    """Return the frame of leg A's third joint at zero, in the platform."""
    return frame_on(np.eye(3), g.platform_axes[0])


def _leg(k: int, g: Geometry, inner: str) -> str:
    name = LEG_NAMES[k]
    inertia = '<inertial pos="0 0 0.01" mass="0.1" diaginertia="1e-3 1e-3 1e-3"/>'
    return f"""
      <body name="base_{name}" {_rotation(base_frame(g, k))}>
        <body name="proximal_{name}">
          <joint name="joint_1{name}" axis="0 0 1"/>{inertia}
          <body name="distal_{name}" {_rotation(about_x(g.alphas[k]))}>
            <joint name="joint_2{name}" axis="0 0 1"/>{inertia}
            {inner}
          </body>
        </body>
      </body>"""


def _model(g: Geometry) -> str:
    sites = ''.join(
        f'<site name="platform_{LEG_NAMES[k]}" {_point(g.platform_axes[k])}/>' for k in (1, 2)
    )
    platform = f"""
      <body name="third" {_rotation(about_x(g.betas[0]))}>
        <joint name="joint_3a" axis="0 0 1"/>
        <inertial pos="0 0 0.01" mass="0.1" diaginertia="1e-3 1e-3 1e-3"/>
        <body name="platform" {_rotation(platform_frame(g).T)}>{sites}</body>
      </body>"""
    tips = [
        f'<site name="tip_{LEG_NAMES[k]}" {_point(about_x(g.betas[k]) @ [0.0, 0.0, 1.0])}/>'
        for k in (1, 2)
    ]
    legs = ''.join(_leg(k, g, inner) for k, inner in enumerate([platform, *tips]))
    return f"""
      <mujoco>
        <compiler angle="radian"/>
        <option gravity="0 0 0" jacobian="dense"/>
        <worldbody>{legs}</worldbody>
        <equality>
          <connect site1="tip_b" site2="platform_b"/>
          <connect site1="tip_c" site2="platform_c"/>
        </equality>
      </mujoco>"""


class MultiBody:
    """MuJoCo's model of one geometry, its state, and indices of joints and platform in these."""

    def __init__(self, g: Geometry):
        self.g = g
        self.model = mujoco.MjModel.from_xml_string(_model(g))
        self.data = mujoco.MjData(self.model)
        self.active = [self._address(name) for name in ('joint_1a', 'joint_1b', 'joint_1c')]
        self.third = self._address('joint_3a')
        self.passive = [i for i in range(self.model.nv) if i not in self.active]
        self.platform = self.model.body('platform').id

    def _address(self, name: str) -> int:
        return int(self.model.joint(name).qposadr[0])

    def place(self, th1: Sequence[float] | np.ndarray, R: np.ndarray) -> None:
        """Set the passive joints near the orientation R, shape (3, 3), with th1 in rad."""
        qpos = self.data.qpos
        for k, name in enumerate(LEG_NAMES):
            frame = base_frame(self.g, k) @ about_z(th1[k]) @ about_x(self.g.alphas[k])
            x, y, _ = frame.T @ R @ self.g.platform_axes[k]
            qpos[self._address('joint_2' + name)] = math.atan2(x, -y)
        frame = (
            base_frame(self.g, 0)
            @ about_z(th1[0])
            @ about_x(self.g.alphas[0])
            @ about_z(qpos[self._address('joint_2a')])
            @ about_x(self.g.betas[0])
        )
        x, y, _ = frame.T @ R @ platform_frame(self.g)[:, 0]
        qpos[self.third] = math.atan2(y, x)

    def assemble(self, th1: Sequence[float] | np.ndarray) -> tuple[np.ndarray, float]:
        """
        Move the active joints to th1, rad, and solve the passive ones from their present angles.

        Returns
        -------
        rotation : ndarray, shape (3, 3)
            Orientation of the platform, R_base_platform.
        error : float
            Residual of the constraints: distance of tips and platform, for links of length 1.

        """
        data = self.data
        data.qpos[self.active] = th1
        for _ in range(STEPS):
            mujoco.mj_fwdPosition(self.model, data)
            rows = data.efc_J.reshape(-1, self.model.nv)[:, self.passive]
            step = np.linalg.lstsq(rows, data.efc_pos, rcond=None)[0]
            data.qpos[self.passive] -= step
            if np.abs(step).max() < STEP_TOLERANCE:
                break
        mujoco.mj_fwdPosition(self.model, data)
        return data.xmat[self.platform].reshape(3, 3).copy(), float(np.abs(data.efc_pos).max())
