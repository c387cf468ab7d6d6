# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures in simulated time: Z-width, energy, and the loss of a wrench."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from paper.figure_entry import table
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.force import ForceController, ForceSample, Wrench
from spm_haptic_master.kinematics import inverse
from spm_haptic_master.kinematics.rotations import multiply_quaternions, quaternion_from_vector
from spm_haptic_master.validation import plot_style
from study.force.bare import Bare, without_energy_law
from study.force.loop import DT, GEOMETRY, PERIOD, run, Slave, spring, wall
from study.force.motions import axis, loops, pose, push, quaternion

# Latencies (periods) and dampings (N m s/rad) of the Z-width; viscous friction of the plant.
LATENCIES, DAMPINGS, FRICTION = (1, 2, 3), (0.005, 0.01), 1.1e-3
# Time of a run (s), halvings of a stiffness, and the largest one (N m/rad).
RUN, HALVINGS, STIFFEST = 0.4, 6, 24.0
# Displacement at the start of such a run (rad).
BESIDE = 0.02


def _is_stable(latency: int, damping: float, stiffness: float) -> bool:
    """Return whether a free handle beside a local spring of roll comes to rest."""
    R = pose(0.0)
    roll = axis(R, 'roll')
    x, y, z = (BESIDE * roll).tolist()
    centre = multiply_quaternions(quaternion_from_vector(x, y, z), quaternion(R))
    try:
        found = run(
            R,
            Slave(spring(centre, stiffness), back=latency - 1),
            RUN,
            hand=(0.0, 0.0),
            controller=Bare(damping),
            noise=0.3,
        )
    except SpmError:
        # It has left the workspace.
        return False
    along = found.turned[found.start :] @ roll
    half = len(along) // 2
    return bool(np.ptp(along[half:]) < 0.7 * np.ptp(along[:half]))


def stiffest(latency: int, damping: float) -> float:
    """Return the largest stable stiffness, N m/rad, by bisection."""
    low, high = 0.0, STIFFEST
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _is_stable(latency, damping, middle) else (low, middle)
    return low


def z_width(path: Path) -> str:
    """Draw the largest stable stiffness against the law; return the table, Markdown."""
    figure = plot_style.new_figure()
    axes = figure.subplots()
    rows = []
    for damping in DAMPINGS:
        law = [(FRICTION + damping) / ((0.5 + latency) * DT) for latency in LATENCIES]
        found = [stiffest(latency, damping) for latency in LATENCIES]
        (line,) = axes.plot(LATENCIES, law, '--', label=f'law, B = {damping:g}')
        axes.plot(LATENCIES, found, 'o-', color=line.get_color(), label=f'MuJoCo, B = {damping:g}')
        rows += [
            (f'{damping:g}', str(latency), f'{most:.2f}', f'{bound:.2f}')
            for latency, most, bound in zip(LATENCIES, found, law, strict=True)
        ]
    axes.set_ylim(0.0, None)
    axes.legend()
    plot_style.label_axes(
        axes,
        'latency t_d, ms',
        'stiffness K, N m/rad',
        'largest stable local spring, roll, no hand',
    )
    plot_style.save(figure, path)
    return table(('B, N m s/rad', 't_d, ms', 'MuJoCo, N m/rad', 'law, N m/rad'), rows)


def energy(path: Path) -> str:
    """Draw the energy that the motors gave, with and without the law; return a table."""
    figure = plot_style.new_figure(height=6.0)
    upper, lower = figure.subplots(2, 1)
    R = pose(20.0)
    roll = axis(R, 'roll')
    rows = []
    for name, make in (('with the energy law', lambda: None), ('without', without_energy_law)):
        slave = Slave(wall(quaternion(R), roll, 2.0), 10, 50, 20)
        found = run(R, slave, 1.5, motion=push(roll, 0.2), controller=make())
        given = 1e3 * (found.given[found.start :] - found.given[found.start])
        upper.plot(DT * np.arange(len(given)), given, label=name)
        turn = pose(44.0)
        motion, environment, seconds = loops(turn, 1.0, 6, 1)
        looped = run(
            turn, Slave(environment), seconds, motion=motion, hand=None, controller=make()
        )
        taken = 1e3 * (looped.given[looped.start :] - looped.given[looped.start])
        lower.plot(DT * np.arange(len(taken)), taken, label=name)
        rows.append((name, f'{1e3 * found.generated:.1f}', f'{1e3 * looped.generated:.1f}'))
    upper.legend()
    upper.set_ylim(-100.0, 500.0)
    plot_style.label_axes(upper, '', 'given, mJ', 'wall of 2 N m/rad at 100 Hz and 70 ms, hand')
    plot_style.label_axes(
        lower, 'time, s', 'given, mJ', 'loops in the fade zone, 1 rad/s, stiff hand'
    )
    plot_style.save(figure, path)
    return table(('', 'wall, mJ', 'six loops, mJ'), rows)


def loss(path: Path) -> str:
    """Draw the motor torques after the last wrench; return the time to zero, ms."""
    R = pose(15.0)
    joints = inverse(R, GEOMETRY)
    angles = (*joints.theta1.tolist(), float(joints.theta3a))
    controller, rows = ForceController(), []
    last = 800
    for step in range(last + 80):
        stamp = step * PERIOD
        torque = (0.05, -0.1, 0.2) if step > 150 else (0.0, 0.0, 0.0)
        wrench = Wrench(min(stamp, last * PERIOD), torque)
        rows.append(
            controller.take(
                ForceSample(stamp, angles, quaternion(R), (0.0, 0.0, 0.0), wrench=wrench)
            )
        )
    time = np.arange(-20, 80)
    torques = np.array([row.motor_torque for row in rows])[last - 20 :]
    figure = plot_style.new_figure()
    axes = figure.subplots()
    for motor, name in enumerate(('th1A', 'th1B', 'th1C')):
        axes.plot(time, torques[:, motor], label=name)
    axes.axvline(0.0, color='grey', linestyle=':')
    axes.annotate('last wrench', (1.0, axes.get_ylim()[0]), fontsize=8, va='bottom')
    axes.legend()
    plot_style.label_axes(
        axes,
        'time after the last wrench, ms',
        'motor torque, N m',
        f'{rows[last + 35].state.text}, then ready',
    )
    plot_style.save(figure, path)
    return f'{time[np.abs(torques).max(axis=1) > 0.0][-1] + 1} ms'
