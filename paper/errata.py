# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of the print, and the computation that shows them."""

from __future__ import annotations

from math import radians

import numpy as np
from paper.figure_entry import table
from paper.linkage_drawing import Linkage
from spm_haptic_master.kinematics import (
    dexterity,
    Geometry,
    inverse,
    matrix_from_quaternion,
    workspace_pose,
)

# The paper's link angles.
G = Geometry()
# Self-rotation of the pose at which signs are compared (rad), away from the singularity.
PHI = radians(30.0)
# Step of the finite differences (rad).
STEP = 1e-6


def _turned(R: np.ndarray, axis: int) -> np.ndarray:
    """Return R rotated by `STEP` about a base axis."""
    q = np.zeros(4)
    q[axis], q[3] = np.sin(0.5 * STEP), np.cos(0.5 * STEP)
    return matrix_from_quaternion(q) @ R


def velocity_signs() -> tuple[float, float]:
    """
    Return the errors of eqs. 8 to 10 against finite differences of the inverse model.

    Returns
    -------
    as_printed, turned : float
        Largest |A omega - B thetadot| with the print's A and B, and with the rows of A negated.

    """
    R = workspace_pose(0.1, 0.4, PHI)
    here = Linkage.at(inverse(R).theta1, R, G)
    A = np.cross(here.third, here.second)
    B = np.diag(np.sum(np.cross(here.first, here.second) * here.third, axis=-1))
    rates = np.stack(
        [(inverse(_turned(R, k)).theta1 - inverse(R).theta1) / STEP for k in range(3)], axis=-1
    )
    return float(np.abs(A - B @ rates).max()), float(np.abs(A + B @ rates).max())


def section() -> str:
    """Return the section of the page, Markdown."""
    printed, turned = velocity_signs()
    centre = float(dexterity(workspace_pose(0.0, 0.0, radians(50.0))))
    rows = [
        (
            'Eq. 5',
            'th1 = (−100, −100, −100) deg; Fig. 5: (100, 100, 100) deg',
            'th1 = (90, 90, 90) deg: see Fig. 4',
        ),
        (
            'Eq. 6',
            'last factor Rot(X3A, ξ)',
            'Rot(X3A, γ), with th2A for ξ and th3A for σ: ξ and '
            'σ are counted from the arcs of the four-bar chains (eq. 13)',
        ),
        (
            'Eqs. 8 to 11, 20, 21',
            'A ω = B thetadot with rows Z3k × Z2k',
            f'the sign: against finite differences of the inverse model the print is off by '
            f'{printed:.2f}, with rows Z2k × Z3k by {turned:.0e}',
        ),
        (
            'Eq. 12',
            'a norm that is not named',
            'the 2-norm here, unless another one is named: see Fig. 6',
        ),
        (
            'Section 2.2',
            'workspace "of an apex angle equal to 26 deg"',
            'a cone of half angle 26 deg, as the sister paper has it: see Fig. 6',
        ),
        (
            'Section 2.2',
            'the singularity of φ = 50 deg is in the centre',
            f"a rounded number: see Fig. 8. At φ = 50 deg the centre's dexterity is {centre:.4f}",
        ),
        ('Section 3.1', 'B_r "becomes 4 × 4 orthogonal"', '4 × 4 diagonal'),
        ('Section 5', 'the active joints are "very sensitive"', 'insensitive: see Fig. 31'),
    ]
    return table(('place', 'printed', 'what holds'), rows).replace('---:', '---')
