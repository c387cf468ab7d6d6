# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures of the statics: motor torque per handle torque, and the fade of three motors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from paper.figure_entry import table
from spm_haptic_master.description.colours import ALL_ENCODERS, ERROR_LIMIT, THREE_ENCODERS
from spm_haptic_master.force import render
from spm_haptic_master.kinematics import jacobian, workspace_pose
from spm_haptic_master.validation import plot_style
from study.force.feel_picture import singular_deg

# Self-rotations of the curves (deg), at the centre of the workspace.
PHI = np.arange(0.0, 95.01, 0.25)
# Self-rotations about the singular surface (deg), and the torque asked for (N m).
NEAR, ASKED = np.arange(15.0, 85.01, 0.05), 0.3
# Number of directions among which the worst is drawn.
DIRECTIONS = 400
# Poses of the table.
POSES = 4000
# No limit of a motor (N m).
UNLIMITED = 1e9


def _unit(count: int, seed: int) -> np.ndarray:
    drawn = np.random.default_rng(seed).normal(size=(count, 3))
    unit: np.ndarray = drawn / np.linalg.norm(drawn, axis=1)[:, None]
    return unit


def _least_peak(G: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Return the least peak of a motor, N m, for G (..., 4, 3) and torques (..., 3)."""
    p = np.einsum('...ji,...j->...i', np.linalg.pinv(G), m)
    n = np.linalg.svd(G)[0][..., 3]
    peaks = [
        np.abs(n[..., j] * p[..., i] - n[..., i] * p[..., j])
        / (np.abs(n[..., i]) + np.abs(n[..., j]))
        for i in range(4)
        for j in range(i)
    ]
    return np.max(peaks, axis=0)


def motor_torque(path: Path) -> str:
    """Draw the worst motor torque over phi; return the table over the workspace, Markdown."""
    centre = workspace_pose(0.0, 0.0, np.radians(PHI))
    three, four = jacobian(centre), jacobian(centre, sensors=4)
    unit = _unit(DIRECTIONS, 1)
    curves = {
        'three motors': np.linalg.norm(np.linalg.inv(three), axis=1).max(axis=1),
        'four, least heat': np.linalg.norm(np.linalg.pinv(four), axis=1).max(axis=1),
        'four, least peak': _least_peak(four[:, None], unit).max(axis=1),
    }
    figure = plot_style.new_figure()
    axes = figure.subplots()
    for name, curve in curves.items():
        axes.semilogy(PHI, curve, label=name)
    axes.set_ylim(0.4, 200.0)
    axes.legend()
    plot_style.label_axes(
        axes,
        'self-rotation φ, deg',
        'worst motor per handle torque',
        'N m of a motor for 1 N m on the handle, worst direction, centre',
    )
    plot_style.save(figure, path)
    rng = np.random.default_rng(2)
    tilt, azimuth, phi = rng.uniform(size=(3, POSES))
    R = workspace_pose(
        np.radians(20.0) * np.sqrt(tilt), 2.0 * np.pi * azimuth, np.radians(95.0) * phi
    )
    G = jacobian(R, sensors=4)
    known = np.isfinite(G).all((1, 2))
    R, G, m = R[known], G[known], _unit(POSES, 3)[known]
    worst = {
        'three': np.abs(np.linalg.solve(np.swapaxes(G[:, :3], 1, 2), m[..., None])).max((1, 2)),
        'four, least heat': np.abs(
            render(R, m, motors=4, motor_torque_limit=UNLIMITED).motor_torque
        ).max(axis=1),
        'four, least peak': _least_peak(G, m),
    }
    rows = [
        (
            name,
            *(f'{np.percentile(values, each):.2f}' for each in (50.0, 90.0, 99.0)),
            f'{values.max():.2f}',
        )
        for name, values in worst.items()
    ]
    return table(('motors', 'median', '90 %', '99 %', 'largest'), rows)


def fade(path: Path) -> str:
    """Draw motor torques and rendered torque across the surface; return how wide the fade is."""
    R = workspace_pose(0.0, 0.0, np.radians(NEAR))
    roll = ASKED * R[:, :, 2]
    figure = plot_style.new_figure(height=6.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for motors, number, ink in ((3, 'three', THREE_ENCODERS), (4, 'four', ALL_ENCODERS)):
        found = render(R, roll, motors=motors)
        felt = np.einsum('ni,ni->n', found.rendered, R[:, :, 2])
        upper.plot(NEAR, felt, color=ink.light, label=f'{number} motors')
        lower.plot(
            NEAR, found.motor_torque[:, 0], color=ink.light, label=f'th1A of {number} motors'
        )
    singular = singular_deg()
    for axes in (upper, lower):
        axes.axvline(singular, color=ERROR_LIMIT.light, linestyle=':', linewidth=1.2)
    upper.annotate(
        'singular surface', (singular, 0.15), xytext=(4, 0), textcoords='offset points', fontsize=8
    )
    upper.legend()
    lower.legend()
    plot_style.label_axes(upper, '', 'rendered, N m', f'roll torque of {ASKED:g} N m, centre')
    plot_style.label_axes(lower, 'self-rotation φ, deg', 'motor torque, N m')
    plot_style.save(figure, path)
    felt = render(R, roll).fraction
    return f'{np.sum(felt < 0.999) * (NEAR[1] - NEAR[0]):.0f} deg'
