# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figs. 27 to 34: section 5's experiment, on simulated hardware."""

from __future__ import annotations

from math import degrees
from pathlib import Path
import shutil
import tempfile

from matplotlib.axes import Axes
import numpy as np
from paper import linkage_drawing
from paper.figure_entry import Entry, table, Verdict, verdict
from paper.geometry_figures import central_singularity
from paper.rig_experiment import (
    AZIMUTHS,
    calibrate,
    CALIBRATION_SECONDS,
    CAPTURE_NOISE,
    CAPTURE_RATE,
    Experiment,
    FRAME,
    JIG,
    MARKERS,
    PLACEMENT,
    RATE,
    run,
)
from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.kinematics import Geometry, inverse, zxz_from_matrix
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.parameters.files import source_defaults
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.validation import plot_style
from spm_haptic_master.validation.comparison import marker_directions, orientation_of_markers

# Length of the recording (s).
SECONDS = 15.0
# Largest error of the self-rotation by motion capture in the paper (deg).
CAPTURE_LIMIT = 1.0
# Printed difference of the self-rotation between the two models (deg).
PRINTED_DIFFERENCE = 3.0


def entries(out: Path, seconds: float = SECONDS) -> list[Entry]:
    """Run the experiment, draw into the directory `out` and return the entries of the page."""
    with tempfile.TemporaryDirectory() as directory:
        encoders = calibrate(Path(directory))
        experiment = run(Path(directory), seconds)
        for name in ('fig32.png', 'fig33.png', 'fig34.png'):
            shutil.copyfile(Path(directory) / 'validation' / name, out / name)
    return [
        _calibration(encoders),
        *_markers(out, experiment),
        _captured(out, experiment),
        _joints(out, experiment),
        *_compared(experiment),
    ]


def _calibration(encoders: dict[str, Values]) -> Entry:
    defaults: Values = source_defaults('can')
    per_turn = defaults['encoders.counts_per_turn']
    found, true = encoders['found'], encoders['true']
    zeros = [each['encoders.zero_count'] for each in (found, true)]
    off = [
        (count - right + turn // 2) % turn - turn // 2
        for count, right, turn in zip(*zeros, per_turn, strict=True)
    ]
    worst = max(abs(each) * 360.0 / turn for each, turn in zip(off, per_turn, strict=True))
    directions = [[*each['encoders.direction']] for each in (found, true)]
    verified = all(found['encoders.direction_verified'])
    rows = [
        ('zero counts found', *zeros[0]),
        ('set in `sim_bus`', *zeros[1]),
        ('off by', *(f'{each:+d}' for each in off)),
        ('directions found', *(f'{each:+d}' for each in directions[0])),
        ('set in `sim_bus`', *(f'{each:+d}' for each in directions[1])),
    ]
    poses = ' and '.join(f'{psi:g}, {theta:.2f}, {phi:g}' for psi, theta, phi in JIG)
    return Entry(
        (27,),
        'Calibration of the sensors',
        'Photograph of a static device that holds the manipulator in a known pose.',
        f'`calibrate` reads the simulated encoders for {CALIBRATION_SECONDS:g} s at each of two '
        f'poses, ψ, θ, φ = {poses} deg. Its zero counts are off by {worst:.3f} deg at most; '
        f'{"every" if verified else "not every"} direction is verified.',
        verdict(worst <= 0.03 and verified and directions[0] == directions[1]),
        'The simulated jig holds each pose exactly; a real one adds its own error. One pose '
        'determines no direction.',
        details=table(('', *JOINT_NAMES), rows),
    )


def _markers(out: Path, experiment: Experiment) -> list[Entry]:
    R = experiment.truth[0]
    axis, toward_c, toward_d = (
        vectors[0] @ FRAME for vectors in marker_directions(experiment.coordinates[:1])
    )
    figure = plot_style.new_figure(height=4.0)
    left, right = figure.subplots(1, 2)
    view = linkage_drawing.View(left, 'Fig. 28: markers on the platform', linkage_drawing.BESIDE)
    linkage_drawing.draw(
        view, linkage_drawing.Linkage.at(inverse(R).theta1, R, Geometry()), labels=False
    )
    # Drawn at their places, in units of the sphere's radius.
    points = MARKERS / 100.0 @ R.T
    view.plot(np.stack([np.zeros(3), 1.4 * R[:, 2]]), color='black', linewidth=1.0)
    for name, point in zip('ABCD', points, strict=True):
        view.plot(point[None], 'o', color='#333333', markersize=9, zorder=6)
        view.label(point, name, 0.11, fontweight='bold')
    _draw_projection(right, axis, toward_c, toward_d)
    plot_style.save(figure, out / 'fig28_29.png')

    captured = FRAME.T @ orientation_of_markers(experiment.coordinates, AZIMUTHS)
    error = np.degrees(np.abs(zxz_from_matrix(captured)[2] - zxz_from_matrix(experiment.truth)[2]))
    return [
        Entry(
            (28,),
            'Markers of the motion capture',
            'Photograph: two markers on Z_E, two to determine the self-rotation.',
            f'Four simulated markers: A and B on Z_E, C and D {MARKERS[2, 0]:g} mm beside it, '
            f'placed to {PLACEMENT:g} mm and captured to {CAPTURE_NOISE:g} mm (1 σ a '
            f'coordinate), at {CAPTURE_RATE:g} Hz, in a frame and by a clock that `validate` '
            'is not given.',
            Verdict.AGREES,
            picture='fig28_29.png',
        ),
        Entry(
            (29,),
            'Self-rotation from the markers',
            'C and D are projected on the plane across Z_E; φ is the average of the angles of '
            f'both. Its error is estimated at less than {CAPTURE_LIMIT:g} deg.',
            'The same computation, in `validate` (picture at Fig. 28). Error of φ in this run: '
            f'rms {np.sqrt(np.mean(error**2)):.2f}, largest {error.max():.2f} deg.',
            verdict(error.max() < CAPTURE_LIMIT),
        ),
    ]


def _draw_projection(
    axes: Axes, axis: np.ndarray, toward_c: np.ndarray, toward_d: np.ndarray
) -> None:
    """Draw the plane across Z_E: line of nodes, projected markers and their angles."""
    nodes = np.array([-axis[1], axis[0], 0.0])
    nodes /= np.linalg.norm(nodes)
    beside = np.cross(axis, nodes)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color='#cccccc', linewidth=0.8)
    axes.plot([0.0, 1.25], [0.0, 0.0], color='black', linewidth=1.0)
    axes.text(1.28, 0.0, 'line of\nnodes', fontsize=8, va='center')
    for name, toward, radius, color in (
        ("C'", toward_c, 0.35, plot_style.IMPROVED),
        ("D'", toward_d, 0.55, plot_style.CLASSIC),
    ):
        angle = np.arctan2(toward @ beside, toward @ nodes) % (2.0 * np.pi)
        x, y = np.cos(angle), np.sin(angle)
        axes.plot([0.0, x], [0.0, y], color=color, linewidth=1.2)
        axes.plot(x, y, 'o', color=color, markersize=9)
        axes.text(1.16 * x, 1.16 * y, name, ha='center', va='center', fontweight='bold')
        sweep = np.linspace(0.0, angle, 60)
        axes.plot(radius * np.cos(sweep), radius * np.sin(sweep), color=color, linewidth=1.0)
        middle = 0.5 * angle
        axes.text(
            (radius + 0.14) * np.cos(middle),
            (radius + 0.12) * np.sin(middle),
            f'{degrees(angle):.1f}°',
            color=color,
            ha='center',
            va='center',
            fontsize=9,
        )
    axes.plot(0.0, 0.0, '+', color='black', markersize=9)
    axes.set(xlim=(-1.4, 1.7), ylim=(-1.3, 1.3), aspect='equal')
    axes.set_axis_off()
    axes.set_title('Fig. 29: projected on the plane across Z$_E$', fontsize=10)


def _captured(out: Path, experiment: Experiment) -> Entry:
    columns = experiment.aligned
    t = columns['time'] - columns['time'][0]
    figure = plot_style.new_figure(height=3.0)
    axes = figure.subplots()
    axes.plot(
        t, columns['captured_phi_deg'], color='#333333', linewidth=0.9, label='motion capture'
    )
    axes.axhline(
        degrees(central_singularity()),
        color='#777777',
        linewidth=0.9,
        linestyle=':',
        label='singularity',
    )
    plot_style.label_axes(
        axes, 'time, s', 'self-rotation φ, deg', 'Self-rotation by motion capture'
    )
    axes.legend(fontsize=8, ncols=2, loc='lower right')
    plot_style.save(figure, out / 'fig30.png')
    phi = columns['captured_phi_deg']
    passes = int(
        np.sum(
            np.diff(
                np.sign(
                    np.degrees(zxz_from_matrix(experiment.truth)[2])
                    - degrees(central_singularity())
                )
            )
            != 0.0
        )
    )
    return Entry(
        (30,),
        'Self-rotation by motion capture',
        'Perturbations of the self-rotation around φ = 50 deg, from the singular configuration.',
        f'{t[-1]:.1f} s of perturbations between {phi.min():.1f} and {phi.max():.1f} deg; the '
        f'motion passes the singularity {passes} times.',
        verdict(passes > 1 and phi.min() < 50.0 < phi.max()),
        "A hand's perturbations are not repeatable; `sim_bus` uses `sim.trajectory:=perturbed`.",
        'fig30.png',
    )


def _joints(out: Path, experiment: Experiment) -> Entry:
    joints = experiment.joints
    t = joints.time - experiment.aligned['time'][0]
    angles = np.degrees(joints.values)
    figure = plot_style.new_figure(height=5.0)
    active, passive = figure.subplots(2, 1, sharex=True)
    for k in range(3):
        active.plot(t, angles[:, k], color=LEGS[k], linewidth=0.6, label=f'θ$_{{1{"ABC"[k]}}}$')
    passive.plot(t, angles[:, 3], color='black', linewidth=0.8, label='θ$_{3A}$')
    # One scale for both, so that slopes compare.
    half = 0.55 * float(np.ptp(angles[:, 3]))
    for axes, values in ((active, angles[:, :3]), (passive, angles[:, 3])):
        middle = 0.5 * (values.min() + values.max())
        axes.set_ylim(middle - half, middle + half)
        axes.legend(fontsize=9, ncols=3, loc='upper right')
    plot_style.label_axes(active, '', 'active joints, deg', 'Measured joint angles, one scale')
    plot_style.label_axes(passive, 'time, s', 'passive joint, deg')
    plot_style.save(figure, out / 'fig31.png')
    spans = np.ptp(angles, axis=0)
    return Entry(
        (31,),
        'Angles of the joints with sensors',
        'The passive joint follows the platform around φ = 50 deg; the three active ones are '
        'called "very sensitive", too.',
        f'th3A moves by {spans[3]:.2f} deg; th1A, th1B, th1C by '
        f'{", ".join(f"{each:.2f}" for each in spans[:3])} deg, noise included. '
        f'{len(joints.time)} samples at {RATE:g} Hz came through bus and driver.',
        verdict(spans[3] > 5.0 * spans[:3].max(), then=Verdict.MISPRINT),
        'The word must be "insensitive": that the active angles hardly move is what the '
        'singularity means, and what the paper concludes from its figure.',
        'fig31.png',
    )


def _largest_step(columns: dict[str, np.ndarray], name: str) -> float:
    """Return the largest step of a column, deg, between two moments with none between them."""
    next_to = np.diff(columns['capture_time']) < 1.5 / CAPTURE_RATE
    return float(np.nanmax(np.abs(np.diff(columns[name]))[next_to]))


def _compared(experiment: Experiment) -> list[Entry]:
    errors = {(row['model'], row['quantity']): row for row in experiment.errors}
    columns = experiment.aligned
    truth = np.degrees(zxz_from_matrix(experiment.truth))

    def number(model: str, quantity: str, column: str) -> float:
        return float(errors[model, quantity][f'{column}_deg'])

    apart = [
        np.abs(columns[f'classic_{name}_deg'] - columns[f'improved_{name}_deg'])
        for name in ('psi', 'theta', 'phi')
    ]
    tilt_apart = max(float(np.nanpercentile(each, 99.0)) for each in apart[:2])
    phi_apart = float(np.nanpercentile(apart[2], 99.0))
    typical = float(np.nanmedian(apart[2]))
    largest_jump, steady = (
        _largest_step(columns, f'{model}_phi_deg') for model in ('classic', 'improved')
    )
    missing = int(errors['classic', 'phi']['missing'])
    to_truth = np.abs(columns['improved_phi_deg'] - truth[2])
    rows = [
        (
            f'{row["model"]}, {row["quantity"]}',
            *(f'{float(row[f"{name}_deg"]):.3f}' for name in ('mean', 'rms', 'p95', 'max')),
            row['missing'],
        )
        for row in experiment.errors
    ]
    details = table(
        (
            'against motion capture, deg',
            'mean',
            'rms',
            '95 %',
            'largest',
            'samples without an answer',
        ),
        rows,
    )
    return [
        Entry(
            (32,),
            'Orientation by both models',
            'ψ and θ of the two models are the same; φ differs by about '
            f'{PRINTED_DIFFERENCE:g} deg.',
            f'99 % of the differences of ψ and θ are below {tilt_apart:.2f} deg; of those of φ, '
            f'below {phi_apart:.1f} deg, and half of them below {typical:.1f} deg.',
            verdict(
                phi_apart > 5.0 * tilt_apart and 0.5 < phi_apart / PRINTED_DIFFERENCE < 2.0,
                Verdict.PARTLY,
            ),
            'The difference of φ is that of the two assembly modes: it grows with the distance '
            'from the singularity at which the classic model took the wrong one, and so with '
            'the perturbation.',
            'fig32.png',
        ),
        Entry(
            (33,),
            'Self-rotation by both models',
            'The classic model fluctuates and jumps near the singularity; the improved one is '
            'continuous.',
            f'Largest step between two captured moments: classic {largest_jump:.2f}, improved '
            f'{steady:.2f} deg. In {missing} of {len(truth[0])} moments the three active angles '
            'close no mechanism.',
            verdict(largest_jump > 2.0 * steady),
            'The classic model follows the mode nearest to its last one, without the true '
            'orientation.',
            'fig33.png',
        ),
        Entry(
            (34,),
            'Both models and the motion capture',
            'The improved FKM and the motion capture are close; without the extra sensor the '
            'variation of the self-rotation near the singularity is not seen.',
            f'rms of φ against the motion capture: improved '
            f'{number("improved", "phi", "rms"):.2f}, classic '
            f"{number('classic', 'phi', 'rms'):.2f} deg. The former is the motion capture's "
            "own noise: against the imposed motion the improved model's φ is off by rms "
            f'{np.sqrt(np.mean(to_truth**2)):.3f} deg.',
            verdict(
                number('improved', 'phi', 'max') < CAPTURE_LIMIT
                and number('classic', 'phi', 'rms') > 3.0 * number('improved', 'phi', 'rms')
            ),
            picture='fig34.png',
            details=details,
        ),
    ]
