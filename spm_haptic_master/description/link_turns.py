# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where the links are turned to, from the angles of all nine joints."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

import numpy as np
from spm_haptic_master.kinematics import Geometry, quaternion_from_matrix
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import multiply_quaternions


class LinkTurns:
    """How each link of a mechanism is turned."""

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        frames = np.array([leg.base_frame for leg in geometry.legs]).reshape(3, 3, 3)
        self._base = list(map(tuple, quaternion_from_matrix(frames).tolist()))
        self._bent = [(sin(0.5 * alpha), 0.0, 0.0, cos(0.5 * alpha)) for alpha in geometry.alphas]

    def at(self, angles: Sequence[float]) -> list[Quaternion[float]]:
        """
        Return the turn of each link in the base frame by the angles of all nine joints, rad.

        Quaternions x, y, z, w: of the proximal links A, B, C: B_k Rz(th1k), eq. 1; of the distal
        links A, B, C: that times Rx(alpha_k) Rz(th2k); of the platform, eq. 6.
        """
        proximal = [multiply_quaternions(self._base[k], _about_z(angles[3 * k]))
                    for k in range(3)]
        distal = [multiply_quaternions(multiply_quaternions(proximal[k], self._bent[k]),
                                       _about_z(angles[3 * k + 1])) for k in range(3)]
        th1a, th2a, th3a = angles[:3]
        return [*proximal, *distal, chain_quaternion(th1a, th2a, th3a, self._geometry, FLOATS)]


def _about_z(angle: float) -> Quaternion[float]:
    return 0.0, 0.0, sin(0.5 * angle), cos(0.5 * angle)
