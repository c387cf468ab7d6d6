# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figs. 1 to 5, 8 and 11: the mechanism, eq. 5 and its two assembly modes, the singular pose."""

from __future__ import annotations

from math import acos, degrees, radians, sqrt
from pathlib import Path

import numpy as np
from paper import linkage_drawing
from paper.eq5 import eq5_coefficients
from paper.figure_entry import Entry, table, Verdict, verdict
from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.kinematics import (
    forward_all,
    Geometry,
    inverse,
    parallel_determinant,
    workspace_pose,
    zxz_from_matrix,
)
from spm_haptic_master.validation import plot_style

# The paper's link angles.
G = Geometry()
# Coefficients of x^i y^j in the print's eq. 5, with the printed digits.
PRINTED = {
    (4, 0): '0.0174',
    (3, 1): '-0.0461',
    (3, 0): '-0.0114',
    (2, 2): '0.0371',
    (2, 1): '0.011',
    (2, 0): '-0.0127',
    (1, 3): '-0.0365',
    (1, 2): '-0.00446',
    (1, 1): '0.0184',
    (1, 0): '0.00275',
    (0, 4): '0.0318',
    (0, 3): '-0.0128',
    (0, 2): '-0.0191',
    (0, 1): '0.00196',
    (0, 0): '0.00479',
}
# Significant digits of the print's coefficients.
SIGNIFICANT = 3
# Active angles (deg) of the text of eq. 5, of Fig. 5's caption, and 100 gon.
ANGLES = (-100.0, 100.0, 90.0)
# Self-rotation of Figs. 2, 3 and 11 (deg): all arcs are well separated.
SHOWN_PHI = 20.0


def central_singularity() -> float:
    """Return the self-rotation, rad, at which the workspace's centre is singular (det A = 0)."""
    low, high = radians(40.0), radians(60.0)
    before = parallel_determinant(workspace_pose(0.0, 0.0, low))
    while high - low > 1e-13:
        middle = 0.5 * (low + high)
        if parallel_determinant(workspace_pose(0.0, 0.0, middle)) * before > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def entries(out: Path) -> list[Entry]:
    """Draw into the directory `out` and return the entries of the page."""
    return [
        _photographs(),
        _mechanism(out),
        _chains(out),
        _eq5(out),
        _modes(out),
        _singular(out),
        _sensor_places(out),
    ]


def _shown() -> linkage_drawing.Linkage:
    R = workspace_pose(0.0, 0.0, radians(SHOWN_PHI))
    return linkage_drawing.Linkage.at(inverse(R).theta1, R, G)


def _photographs() -> Entry:
    return Entry(
        (1,),
        'The master device and the surgical robot',
        'Photographs.',
        'Nothing to compute; the device of this page is simulated.',
        Verdict.NOT_COMPUTED,
    )


def _mechanism(out: Path) -> Entry:
    figure = plot_style.new_figure(height=4.0)
    left, right = figure.subplots(1, 2)
    shown = _shown()
    linkage_drawing.draw(linkage_drawing.View(left, '(a) three legs and the platform'), shown)
    view = linkage_drawing.View(right, '(b) leg A')
    linkage_drawing.draw(view, shown, legs=(0,))
    view.plot(
        linkage_drawing.arc(shown.third[0], shown.platform),
        color='black',
        linewidth=1.5,
        linestyle='--',
    )
    for start, end, name in (
        (shown.first[0], shown.second[0], 'α'),
        (shown.second[0], shown.third[0], 'β'),
        (shown.third[0], shown.platform, 'γ'),
    ):
        points = linkage_drawing.arc(start, end)
        view.label(points[len(points) // 2], name, 0.09, fontweight='bold', fontsize=12)
    plot_style.save(figure, out / 'fig02.png')
    measured = [
        degrees(acos(float(a @ b)))
        for a, b in (
            (shown.first[0], shown.second[0]),
            (shown.second[0], shown.third[0]),
            (shown.third[0], shown.platform),
        )
    ]
    printed = (39.3, 34.1, 18.2)
    return Entry(
        (2,),
        'The manipulator, and the parameters of leg A',
        'Three identical legs of two links; α, β, γ = 39.3, 34.1, 18.2 deg; all axes meet in one '
        'point.',
        'The same, drawn as arcs on a sphere about that point. Between the drawn axes: α = '
        f'{measured[0]:.1f}, β = {measured[1]:.1f}, γ = {measured[2]:.1f} deg.',
        verdict(np.allclose(measured, printed, atol=1e-9)),
        picture='fig02.png',
    )


def _chains(out: Path) -> Entry:
    figure = plot_style.new_figure(height=4.0)
    shown = _shown()
    for axes, other in zip(figure.subplots(1, 2), (1, 2), strict=True):
        name = 'ABC'[other]
        view = linkage_drawing.View(axes, f'A$_2$ A$_3$ {name}$_3$ {name}$_2$')
        linkage_drawing.draw(view, shown, faint=True)
        corners = (shown.second[0], shown.third[0], shown.third[other], shown.second[other])
        rim = np.concatenate(
            [linkage_drawing.arc(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        )
        view.fill(rim, LEGS[other], 0.2)
        view.plot(rim, color=LEGS[other], linewidth=2.5)
        middle = np.mean(corners, axis=0)
        for corner, text in zip(corners[:2], 'ξσ', strict=True):
            inside = 0.8 * corner + 0.2 * middle
            view.label(inside, text, 0.0, fontweight='bold', fontsize=12)
    plot_style.save(figure, out / 'fig03.png')
    return Entry(
        (3,),
        'The two four-bar chains',
        'A2 A3 B3 B2 and A2 A3 C3 C2, the chains of eqs. 1 and 2.',
        'The same quadrilaterals on the sphere; ξ is the angle at A2, σ the angle at A3.',
        Verdict.AGREES,
        picture='fig03.png',
    )


def _significant(value: float) -> str:
    return f'{value:.{SIGNIFICANT}g}'


def _matches(angle: float) -> int:
    """Return the number of coefficients of eq. 5 that are as printed with th1 = angle, deg."""
    computed = eq5_coefficients(np.radians([angle] * 3))
    return sum(
        float(_significant(computed[place])) == float(_significant(float(text)))
        for place, text in PRINTED.items()
    )


def _eq5(out: Path) -> Entry:
    matches = {angle: _matches(angle) for angle in ANGLES}
    modes = {angle: len(forward_all(np.radians([angle] * 3))) for angle in ANGLES}
    coefficients = eq5_coefficients(np.radians([90.0] * 3))
    figure = plot_style.new_figure(width=5.2, height=5.0)
    axes = figure.subplots()
    x = np.linspace(-2.0, 2.0, 400)
    grid_x, grid_y = np.meshgrid(x, x)
    value = np.polynomial.polynomial.polyval2d(grid_x, grid_y, coefficients)
    axes.contour(grid_x, grid_y, value, levels=[0.0], colors=[plot_style.IMPROVED], linewidths=1.6)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color=plot_style.CLASSIC, linewidth=1.6)
    axes.plot([], [], color=plot_style.IMPROVED, label='eq. 5')
    axes.plot([], [], color=plot_style.CLASSIC, label='x² + y² = 1')
    xi = _crossings(coefficients)
    axes.plot(np.cos(xi), np.sin(xi), 'o', color='black', label=f'{len(xi)} solutions')
    plot_style.label_axes(axes, 'x = cos ξ', 'y = sin ξ', 'Eq. 5 at th1 = (90, 90, 90) deg')
    axes.set_aspect('equal')
    axes.legend(loc='upper right', fontsize=9)
    plot_style.save(figure, out / 'fig04.png')

    def monomial(i: int, j: int) -> str:
        return (
            ' '.join(
                filter(None, (('', 'x', 'x²', 'x³', 'x⁴')[i], ('', 'y', 'y²', 'y³', 'y⁴')[j]))
            )
            or '1'
        )

    details = table(
        ('eq. 5', *(monomial(*place) for place in PRINTED)),
        [
            ('printed', *PRINTED.values()),
            ('computed', *(f'{coefficients[place]:.5f}' for place in PRINTED)),
        ],
    )
    details += '\n\n' + table(
        ('th1A = th1B = th1C', *(f'{angle:+.0f} deg' for angle in ANGLES)),
        [
            (
                'coefficients as printed',
                *(f'{matches[angle]} of {len(PRINTED)}' for angle in ANGLES),
            ),
            ('assembly modes', *(modes[angle] for angle in ANGLES)),
        ],
    )
    return Entry(
        (4,),
        "Eq. 5's curve and the unit circle",
        'For "[−100°, −100°, −100°]" a quartic in x = cos ξ, y = sin ξ with 15 coefficients, '
        'which meets the unit circle in two points.',
        f'{matches[90.0]} of the {len(PRINTED)} coefficients come out to the last printed digit, '
        f'and {len(xi)} solutions, ξ = {" and ".join(f"{degrees(a):.2f}" for a in xi)} deg: at '
        'th1 = +90 deg.',
        verdict(matches[90.0] == len(PRINTED) and len(xi) == 2, then=Verdict.MISPRINT),
        'The angle is a misprint. At −100 deg the mechanism cannot be assembled at all '
        f"({modes[-100.0]} modes), at +100 deg (Fig. 5's caption) {matches[100.0]} of the "
        'coefficients match. 90 deg are 100 gon, which may be the cause.',
        'fig04.png',
        details,
    )


def _crossings(coefficients: np.ndarray) -> np.ndarray:
    """Return the angles, rad, at which the quartic meets the unit circle, by bisection."""

    def value(angle: np.ndarray) -> np.ndarray:
        return np.polynomial.polynomial.polyval2d(np.cos(angle), np.sin(angle), coefficients)

    angle = np.linspace(-np.pi, np.pi, 2001)
    changed = np.flatnonzero(value(angle[:-1]) * value(angle[1:]) < 0.0)
    low, high = angle[changed], angle[changed + 1]
    side = value(low)
    for _ in range(50):
        middle = 0.5 * (low + high)
        before = value(middle) * side > 0.0
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return low


def _modes(out: Path) -> Entry:
    figure = plot_style.new_figure(height=4.0)
    rows = []
    for angle in (90.0, 100.0):
        modes = forward_all(np.radians([angle] * 3))
        phis = np.degrees(zxz_from_matrix(modes))
        order = np.argsort(phis[2])
        rows += [(f'{angle:.0f}', *(f'{each:.4f}' for each in phis[:, index])) for index in order]
        if angle == 90.0:
            for axes, letter, index in zip(figure.subplots(1, 2), 'ab', order, strict=True):
                view = linkage_drawing.View(axes, f'({letter})  φ = {phis[2, index]:.2f} deg')
                linkage_drawing.draw(
                    view, linkage_drawing.Linkage.at(np.radians([angle] * 3), modes[index], G)
                )
    plot_style.save(figure, out / 'fig05.png')
    return Entry(
        (5,),
        'The two assembly modes',
        'Two poses of the platform for the same active angles; the caption has (100, 100, 100) '
        'deg.',
        'Two modes, the platform axis on (1, 1, 1) in both, distinguished by the self-rotation '
        'alone.',
        verdict(len(rows) == 4),
        'Drawn at 90 deg, the angle of eq. 5; at 100 deg the picture is nearly the same.',
        'fig05.png',
        table(('th1, deg', 'ψ, deg', 'θ, deg', 'φ, deg'), rows),
    )


def _singular(out: Path) -> Entry:
    phi = central_singularity()
    R = workspace_pose(0.0, 0.0, phi)
    th1 = inverse(R).theta1
    here = linkage_drawing.Linkage.at(th1, R, G)
    line = np.ones(3) / sqrt(3.0)
    normals = np.cross(here.second, here.third)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    off = np.degrees(np.abs(np.arcsin(normals @ line))).max()
    figure = plot_style.new_figure(height=4.0)
    for axes, title, eye in zip(
        figure.subplots(1, 2),
        ('along the common line', 'from beside it'),
        (linkage_drawing.FRONT, linkage_drawing.BESIDE),
        strict=True,
    ):
        view = linkage_drawing.View(axes, title, eye)
        for k in range(3):
            # The plane of Z2k and Z3k from Z2k to the common line.
            sector = linkage_drawing.arc(here.second[k], line)
            view.fill(np.concatenate([np.zeros((1, 3)), sector]), LEGS[k], 0.2)
            view.plot(sector, color=LEGS[k], linewidth=1.0, linestyle=':')
        linkage_drawing.draw(view, here)
        view.plot(
            np.stack([np.zeros(3), 1.25 * line]), color='black', linestyle='--', linewidth=1.6
        )
    plot_style.save(figure, out / 'fig08.png')
    return Entry(
        (8,),
        'Parallel singularity, the central configuration',
        'The planes of Z2k and Z3k intersect in the line (1, 1, 1)/√3, at φ = 50 deg.',
        f'det A vanishes at φ = {degrees(phi):.6f} deg, th1A = th1B = th1C = '
        f'{degrees(th1[0]):.3f} deg. There each of the three planes contains (1, 1, 1) to '
        f'{off:.0e} deg.',
        verdict(off < 1e-6 and round(degrees(phi), -1) == 50.0),
        f'The paper rounds {degrees(phi):.2f} to 50.',
        'fig08.png',
    )


def _sensor_places(out: Path) -> Entry:
    shown = _shown()
    figure = plot_style.new_figure(width=5.2, height=4.2)
    view = linkage_drawing.View(figure.subplots(), '')
    linkage_drawing.draw(view, shown, legs=(1, 2), faint=True, labels=False, platform=False)
    linkage_drawing.draw(view, shown, legs=(0,))
    for axis, text, color, toward in (
        (shown.second[0], 'Case 1\nsensor on θ$_{2A}$', plot_style.CLASSIC, (-1.0, -0.55)),
        (shown.third[0], 'Case 2\nsensor on θ$_{3A}$', plot_style.IMPROVED, (1.0, 0.25)),
    ):
        view.plot(axis[None], 'o', color=color, markersize=14, alpha=0.6)
        view.label(axis, text, 0.4, toward=toward, color=color)
    plot_style.save(figure, out / 'fig11.png')
    joints = inverse(workspace_pose(0.0, 0.0, radians(50.0)))
    return Entry(
        (11,),
        'Possible places of the fourth sensor',
        'On the first passive joint of leg A (Case 1, th2A) or on the second (Case 2, th3A).',
        'The same. At the centre and φ = 50 deg they read th2A = '
        f'{degrees(joints.theta2a):.3f} and th3A = {degrees(joints.theta3a):.3f} deg.',
        Verdict.AGREES,
        picture='fig11.png',
    )
