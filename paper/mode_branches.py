# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figs. 9 and 10: a self-rotation through the singularity, and all assembly modes during it."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from paper.figure_entry import Entry, verdict
from paper.geometry_figures import central_singularity
from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.kinematics import forward_all, inverse, matrix_from_zxz, zxz_from_matrix
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.validation import plot_style

# Duration of the motion, and time between two samples (s).
SECONDS, STEP = 20.0, 0.02
# Largest difference of the self-rotation at a meeting of the modes from the singularity (deg).
MEETING = 0.2


def fig9_motion(t: np.ndarray) -> np.ndarray:
    """Return the orientations of Fig. 9's motion at times t, s: shape (n, 3, 3)."""
    psi, theta, phi = np.array([trajectories.fig9(float(each)) for each in t]).T
    return matrix_from_zxz(psi, theta, phi)


def entries(out: Path, step: float = STEP) -> list[Entry]:
    """Draw into the directory `out` and return the entries of the page."""
    t = np.arange(0.0, SECONDS + 0.5 * step, step)
    R = fig9_motion(t)
    th1 = inverse(R).theta1
    phi = np.degrees(zxz_from_matrix(R)[2])
    return [_active_angles(out, t, th1), _solutions(out, t, th1, phi)]


def _active_angles(out: Path, t: np.ndarray, th1: np.ndarray) -> Entry:
    figure = plot_style.new_figure(height=3.0)
    axes = figure.subplots()
    styles: tuple[dict[str, Any], ...] = (
        {'linewidth': 5.0, 'alpha': 0.35},
        {'linewidth': 2.5},
        {'linewidth': 1.2, 'linestyle': '--'},
    )
    for k, style in enumerate(styles):
        axes.plot(t, np.degrees(th1[:, k]), color=LEGS[k], label=f'θ$_{{1{"ABC"[k]}}}$', **style)
    plot_style.label_axes(
        axes, 'time, s', 'active angle, deg', 'Active angles for φ = 45 + 10 sin(π t / 10) deg'
    )
    axes.legend(ncols=3, fontsize=9)
    plot_style.save(figure, out / 'fig09.png')
    apart = float(np.abs(th1 - th1[:, :1]).max())
    return Entry(
        (9,),
        'Active angles',
        'th1A, th1B, th1C for ψ = 135, θ = 54.7, φ = 10 sin(π t / 10) + 45 deg.',
        f'All three angles are one curve (to {degrees(apart):.0e} deg), from '
        f'{np.degrees(th1.min()):.2f} to {np.degrees(th1.max()):.2f} deg.',
        verdict(apart < 1e-9),
        "In the workspace's centre the three legs are alike. θ is acos(1/√3) = 54.7356 deg.",
        'fig09.png',
    )


def _solutions(out: Path, t: np.ndarray, th1: np.ndarray, phi: np.ndarray) -> Entry:
    modes = [np.degrees(zxz_from_matrix(forward_all(each))[2]) for each in th1]
    # The second branch: the mode farthest from the imposed motion.
    apart = [np.abs(each - truth) for each, truth in zip(modes, phi, strict=True)]
    other = np.array([each[np.argmax(away)] for each, away in zip(modes, apart, strict=True)])
    missed = max(float(away.min()) for away in apart)
    figure = plot_style.new_figure(height=3.4)
    axes = figure.subplots()
    axes.plot(
        t, other, color=plot_style.CLASSIC, linewidth=1.6, label='second solution of the FKM'
    )
    axes.plot(
        t,
        phi,
        color=plot_style.IMPROVED,
        linewidth=1.6,
        label='first solution: the imposed motion',
    )
    singular = degrees(central_singularity())
    axes.axhline(
        singular,
        color='#777777',
        linewidth=0.9,
        linestyle=':',
        label=f'singularity, {singular:.2f} deg',
    )
    met = _meetings(t, other - phi)
    axes.plot(met, np.interp(met, t, phi), 'o', color='black', markersize=5)
    plot_style.label_axes(
        axes, 'time, s', 'self-rotation φ, deg', 'Every self-rotation that the active angles allow'
    )
    axes.legend(fontsize=9)
    plot_style.save(figure, out / 'fig10.png')
    numbers = sorted({len(each) for each in modes})
    at = np.interp(met, t, phi)
    return Entry(
        (10,),
        'Self-rotation solutions of the FKM',
        'Two solutions, which intersect near the singularity.',
        f'{" or ".join(map(str, numbers))} modes at every instant; the two curves meet at '
        f't = {" and ".join(f"{each:.2f}" for each in met)} s, at φ = '
        f'{" and ".join(f"{each:.2f}" for each in at)} deg. The imposed motion is always among '
        f'them, to {missed:.0e} deg.',
        verdict(len(met) == 2 and np.abs(at - singular).max() < MEETING and missed < 1e-3),
        'Where the curves meet, the three active angles do not determine which one to follow.',
        'fig10.png',
    )


def _meetings(t: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Return the times at which a difference changes its sign, by linear interpolation."""
    changed = np.flatnonzero(difference[:-1] * difference[1:] < 0.0)
    part = difference[changed] / (difference[changed] - difference[changed + 1])
    return t[changed] + part * (t[changed + 1] - t[changed])
