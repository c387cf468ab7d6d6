# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Link angles of the manipulator and the axes that follow from them."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
import numbers
from typing import Any

from spm_haptic_master.exceptions import GeometryError
from spm_haptic_master.kinematics.quoting import quoted

Axis = tuple[float, float, float]

# Angle between neighbouring platform axes about Z_E (rad).
THIRD_OF_A_TURN = 2.0 * math.pi / 3.0


@dataclass(frozen=True, slots=True)
class Geometry:
    """
    Three link angles of the manipulator, the same for all legs; the default is the paper's.

    The base axes are orthogonal: Z1A = z, Z1B = x, Z1C = y of the base frame. Cosines, sines and
    axes that the formulas use are computed once, here.

    Parameters
    ----------
    alpha : float
        Proximal link: angle between Z1k and Z2k, rad, in ]0, pi[.
    beta : float
        Distal link: angle between Z2k and Z3k, rad, in ]0, pi[.
    gamma : float
        Angle between the platform axis Z_E and each Z3k, rad, in ]0, pi[.

    Attributes
    ----------
    cos_alpha, sin_alpha, cos_beta, sin_beta, cos_gamma, sin_gamma : float
        Cosines and sines of the three angles (unit 1).
    platform_axes : tuple of three 3-tuples of float
        Z3A, Z3B, Z3C in the platform frame: Z3k = Rz(k 120 deg) Rx(-gamma) z.
    third_joint_axes : tuple of two 3-tuples of float
        Z3B and Z3C in the frame of leg A's third joint, i.e. turned by Rx(gamma).
    half_angles : tuple of six float
        Cosine and sine of (alpha + beta) / 2, (beta - alpha) / 2 and gamma / 2.

    Raises
    ------
    GeometryError
        An angle is not a finite number in ]0, pi[.

    """

    alpha: float = math.radians(39.3)
    beta: float = math.radians(34.1)
    gamma: float = math.radians(18.2)
    cos_alpha: float = field(init=False, repr=False, compare=False)
    sin_alpha: float = field(init=False, repr=False, compare=False)
    cos_beta: float = field(init=False, repr=False, compare=False)
    sin_beta: float = field(init=False, repr=False, compare=False)
    cos_gamma: float = field(init=False, repr=False, compare=False)
    sin_gamma: float = field(init=False, repr=False, compare=False)
    platform_axes: tuple[Axis, Axis, Axis] = field(init=False, repr=False, compare=False)
    third_joint_axes: tuple[Axis, Axis] = field(init=False, repr=False, compare=False)
    half_angles: tuple[float, float, float, float, float, float] = field(
        init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the angles and compute the other attributes."""
        derived: dict[str, Any] = {}
        for name in ('alpha', 'beta', 'gamma'):
            angle = getattr(self, name)
            real = isinstance(angle, numbers.Real) and not isinstance(angle, bool)
            if not real or not 0.0 < angle < math.pi:
                raise GeometryError(
                    f'{name} = {quoted(angle)}: expected an angle in rad between 0 and pi, both '
                    'excluded')
            derived[name] = float(angle)
            derived['cos_' + name] = math.cos(angle)
            derived['sin_' + name] = math.sin(angle)
        cg, sg = derived['cos_gamma'], derived['sin_gamma']
        axes = tuple(
            (-sg * math.sin(k * THIRD_OF_A_TURN), sg * math.cos(k * THIRD_OF_A_TURN), cg)
            for k in range(3))
        derived['platform_axes'] = axes
        derived['third_joint_axes'] = tuple(
            (x, cg * y - sg * z, sg * y + cg * z) for x, y, z in axes[1:])
        alpha, beta, gamma = (derived[name] for name in ('alpha', 'beta', 'gamma'))
        derived['half_angles'] = tuple(
            function(0.5 * angle)
            for angle in (alpha + beta, beta - alpha, gamma) for function in (math.cos, math.sin))
        for name, value in derived.items():
            object.__setattr__(self, name, value)


# Geometry of the paper's manipulator: [39.3, 34.1, 18.2] deg.
PAPER_GEOMETRY = Geometry()
