# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Link angles of the manipulator and the axes they fix."""

from dataclasses import dataclass, field
import math
import numbers

from spm_haptic_master.exceptions import GeometryError

THIRD_OF_A_TURN = 2.0 * math.pi / 3.0
"""Angle between neighbouring platform axes about Z_E, rad."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """
    The three link angles of the manipulator, all legs alike; the default is the paper's.

    The base axes are orthogonal: Z1A = z, Z1B = x, Z1C = y of the base frame. What the formulas
    need of the angles (cosines, sines, platform axes) is computed once, here.

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
        Of the three angles.
    platform_axes : tuple of three 3-tuples of float
        Z3A, Z3B, Z3C in the platform frame: Z3k = Rz(k 120 deg) Rx(-gamma) z.
    third_joint_axes : tuple of two 3-tuples of float
        Z3B and Z3C seen from leg A's third joint, i.e. turned by Rx(gamma).
    half_angles : tuple of six float
        Cosine and sine of (alpha + beta) / 2, (beta - alpha) / 2 and gamma / 2.

    Raises
    ------
    GeometryError
        An angle that is not a finite number in ]0, pi[.

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
    platform_axes: tuple = field(init=False, repr=False, compare=False)
    third_joint_axes: tuple = field(init=False, repr=False, compare=False)
    half_angles: tuple = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        """Check the angles, then fix what follows from them."""
        derived = {}
        for name in ('alpha', 'beta', 'gamma'):
            angle = getattr(self, name)
            if (isinstance(angle, bool) or not isinstance(angle, numbers.Real)
                    or not 0.0 < angle < math.pi):
                raise GeometryError(
                    f'{name} = {angle!r}: expected an angle in rad between 0 and pi, both excluded')
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


PAPER_GEOMETRY = Geometry()
"""The paper's manipulator: [39.3, 34.1, 18.2] deg."""
