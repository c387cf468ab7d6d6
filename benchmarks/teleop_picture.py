# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The picture of a demonstrated tele-operation: tip and trocar from the side, depth and tilt."""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, degrees
from pathlib import Path

from benchmarks.surgeon import Arrived, Surgeon
from benchmarks.teleop_figures import pose_of, stretches_of
import matplotlib as mpl

mpl.use('Agg')
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from spm_haptic_master.nodes.sim_slave import SHAFT  # noqa: E402
from spm_haptic_master.teleoperation.remote_centre import depth_of, MILLIMETRES  # noqa: E402
from spm_haptic_master.teleoperation.vectors import rotate  # noqa: E402
from spm_haptic_master.timing import SECOND  # noqa: E402

Point = tuple[float, float, float]
# Every so many commands the shaft is drawn.
SHAFTS = 60
COMMAND, SLAVE, HAND = 'tab:blue', 'tab:orange', 'tab:green'


def draw(path: Path, surgeon: Surgeon, trocar: Point, acts: Sequence[tuple[int, str]]) -> None:
    """
    Draw a demonstration.

    Parameters
    ----------
    path
        Picture to write; its suffix is the format.
    surgeon
        Has the commands, the poses of the slave, and the insertions of the hand.
    trocar
        In the slave's base frame, m.
    acts
        Times, ns, at which an act of the demonstration ended, and what it was.

    """
    began = surgeon.commands[0].at
    figure = Figure(figsize=(11.0, 6.5), layout='constrained')
    grid = figure.add_gridspec(6, 2, width_ratios=(1.0, 1.9))
    _draw_side(figure.add_subplot(grid[:4, 0]), surgeon.commands, trocar)
    depth, tilt = figure.add_subplot(grid[:3, 1]), figure.add_subplot(grid[3:, 1])
    _draw_depth(depth, surgeon, trocar, began)
    _draw_tilt(tilt, surgeon.commands, began)
    ended = [((at - began) / SECOND, text) for at, text in acts if at > began]
    for axes in (depth, tilt):
        axes.set_xlim(0.0, ended[-1][0] + 1.0)
    _mark_acts(depth, tilt, ended)
    _list_acts(figure.add_subplot(grid[4:, 0]), ended)
    figure.savefig(path, dpi=110)


def _draw_side(axes: Axes, commands: Sequence[Arrived], trocar: Point) -> None:
    """Draw the tip's path and some shafts, seen along y."""
    for command in commands[::SHAFTS]:
        axes.plot(
            [MILLIMETRES * trocar[0], MILLIMETRES * command.position[0]],
            [MILLIMETRES * trocar[2], MILLIMETRES * command.position[2]],
            color='0.8',
            linewidth=0.8,
        )
    for stretch in stretches_of(commands):
        axes.plot(
            [MILLIMETRES * command.position[0] for command in stretch],
            [MILLIMETRES * command.position[2] for command in stretch],
            color=COMMAND,
            linewidth=1.2,
        )
    axes.plot(MILLIMETRES * trocar[0], MILLIMETRES * trocar[2], 'o', color='black')
    axes.annotate(
        'trocar',
        (MILLIMETRES * trocar[0], MILLIMETRES * trocar[2]),
        xytext=(8, 0),
        textcoords='offset points',
    )
    axes.set(title='commanded tip and shaft, from the side', xlabel='x, mm', ylabel='z, mm')
    axes.set_aspect('equal', adjustable='datalim')


def _draw_depth(axes: Axes, surgeon: Surgeon, trocar: Point, began: int) -> None:
    """Draw commanded and measured depth, and the insertion of the hand."""
    for arrived, colour, label in (
        (surgeon.poses, SLAVE, 'slave'),
        (surgeon.commands, COMMAND, 'command'),
    ):
        for stretch in stretches_of(arrived):
            axes.plot(
                [(each.at - began) / SECOND for each in stretch],
                [MILLIMETRES * depth_of(trocar, pose_of(each)) for each in stretch],
                color=colour,
                linewidth=1.6,
                label=label,
            )
            label = '_'
    times, insertions = zip(*surgeon.hand.insertions, strict=True)
    # A gap where the encoder is lost.
    values = [MILLIMETRES * insertion for insertion in insertions]
    axes.plot(
        [(at - began) / SECOND for at in times],
        values,
        '.',
        color=HAND,
        markersize=1.0,
        label='insertion of the hand',
    )
    axes.set(ylabel='depth, insertion, mm')
    axes.legend(loc='center right', markerscale=8.0)


def _draw_tilt(axes: Axes, commands: Sequence[Arrived], began: int) -> None:
    """Draw the angle of the shaft from its direction at the first command."""
    first = rotate(commands[0].quaternion, SHAFT)
    for stretch in stretches_of(commands):
        directions = [rotate(command.quaternion, SHAFT) for command in stretch]
        cosines = [
            min(1.0, sum(a * b for a, b in zip(first, direction, strict=True)))
            for direction in directions
        ]
        axes.plot(
            [(command.at - began) / SECOND for command in stretch],
            [degrees(acos(cosine)) for cosine in cosines],
            color=COMMAND,
        )
    axes.set(xlabel='time, s', ylabel='tilt of the shaft, deg')


def _mark_acts(depth: Axes, tilt: Axes, acts: Sequence[tuple[float, str]]) -> None:
    """Mark the ends of the surgeon's acts by numbers."""
    for number, (at, _) in enumerate(acts, 1):
        for axes in (depth, tilt):
            axes.axvline(at, color='0.7', linewidth=0.8, linestyle=':')
        # Two that are close do not cover each other.
        height = 1.01 + 0.05 * (number % 2)
        depth.annotate(
            str(number), (at, height), xycoords=('data', 'axes fraction'), ha='center', fontsize=8
        )


def _list_acts(axes: Axes, acts: Sequence[tuple[float, str]]) -> None:
    """List what the numbers mean."""
    listed = '\n'.join(f'{number}  {text}' for number, (_, text) in enumerate(acts, 1))
    axes.text(0.0, 1.0, listed, transform=axes.transAxes, va='top', fontsize=7.5)
    axes.set_axis_off()
