# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session shows: its figures as a table, and one picture."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from matplotlib.axes import Axes
import numpy as np
from spm_haptic_master.description.colours import COMMANDED, ERROR_LIMIT, LEGS, RENDERED
from spm_haptic_master.force import ForceLimits
from spm_haptic_master.force.end_stop import LegEnds
from spm_haptic_master.kinematics import jacobian, workspace_pose
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.validation import plot_style
from study.force.motions import AZIMUTH, TILT
from study.force.session import (
    CLUTCH,
    DRIVE,
    ENCODER,
    END,
    END_STOP,
    LOSSES,
    MASTER,
    NO_WRENCH,
    Session,
)

# What a session is made of: from, to (s), and its name in the picture.
ACTS = (
    (0.0, 1.2, 'moves\nfreely'),
    (1.2, 3.0, 'touches\na wall'),
    (3.0, 6.1, 'crosses the\nsingular surface'),
    (6.1, 8.3, 'presses the\nclutch'),
    (8.3, 10.2, 'slave falls\nsilent'),
    (10.2, 13.4, 'an encoder reads\n5 deg too much'),
    (13.4, 15.8, 'a drive\nfails'),
    (15.8, 19.3, 'meets the\nend stop'),
    (19.3, END, 'the computer\ndies'),
)
# Times of faults, with a colour of their own in every panel (s).
FAULTS = (NO_WRENCH, ENCODER, DRIVE, END_STOP, (MASTER, END))
FAULT_COLOUR = '#d9534f'
ACT_COLOURS = ('#ffffff', '#f3f3f3')
# Colour of the end stop.
STOP_COLOUR = '#5f6b00'
# Colour of each state of `force_state`.
STATES = {
    'off': '#bdbdbd',
    'ready': '#9ecae1',
    'engaged': '#4caf50',
    'holding': '#ffd54f',
    'fading': '#ff9800',
    'fault': '#d9534f',
    'dead': '#555555',
}


def singular_deg() -> float:
    """Return the self-rotation of the singular surface at the centre, deg."""
    phi = np.arange(40.0, 60.0, 0.01)
    G = jacobian(workspace_pose(0.0, 0.0, np.radians(phi)))
    return float(phi[np.argmin(np.abs(np.linalg.det(G)))])


def end_stop_deg() -> float:
    """Return the self-rotation at which the end stop of the session begins, deg."""
    phi = np.arange(90.0, 160.0, 0.1)
    ends = [LegEnds(leg, 0.0).stretched for leg in PAPER_GEOMETRY.legs]
    for angle in phi:
        R = workspace_pose(TILT, AZIMUTH, np.radians(angle))
        left = [
            end - np.arccos(np.dot(leg.first, R @ leg.third))
            for leg, end in zip(PAPER_GEOMETRY.legs, ends, strict=True)
        ]
        if min(left) < ForceLimits().end_stop:
            return float(angle)
    return float(phi[-1])


def figures(found: Session) -> tuple[str, bool]:
    """Return the table of a session, and whether each torque ended in time."""
    lines = [
        '',
        f'{"":34}{"asked for":>10}{"rendered":>10}{"handle":>10}{"motors gave":>13}',
        f'{"":34}{"N m":>10}{"N m":>10}{"rad/s":>10}{"mJ":>13}',
    ]
    for start, end, name in ACTS:
        span = (found.time >= start) & (found.time < end)
        gave = found.given[span] - found.given[span][0]
        lines.append(
            f'{name.replace(chr(10), " "):34}{np.abs(found.commanded[span]).max():10.2f}'
            f'{np.abs(found.rendered[span]).max():10.2f}{found.speed[span].max():10.1f}'
            f'{1e3 * gave.max():13.1f}'
        )
    lines += [
        '',
        f'{"lost":26}{"torque before":>15}{"zero after":>12}{"limit":>8}   force_state',
        f'{"":26}{"N m":>15}{"ms":>12}{"ms":>8}',
    ]
    in_time = True
    for loss in LOSSES:
        row = round(loss.time * 1000) - 1
        zero = found.time_to_zero(loss)
        in_time = in_time and zero <= loss.limit + 1e-9
        words = 'the drives end it' if loss.time >= MASTER else found.ends_in(loss)
        lines.append(
            f'{loss.name:26}{abs(found.rendered[row]):15.2f}{1e3 * zero:12.0f}'
            f'{1e3 * loss.limit:8.0f}   {words}'
        )
    lines += [
        '',
        f'least budget of energy {1e3 * found.energy.min():.1f} mJ; largest torque of a '
        f'motor {np.abs(found.motor_torque).max():.2f} N m',
    ]
    return '\n'.join(lines), in_time


def draw(found: Session, path: Path) -> None:
    """Draw a session: angle, torque, motors, energy and states over one axis of time."""
    figure = plot_style.new_figure(width=11.0, height=9.0)
    angle, torque, motors, energy, strip = figure.subplots(
        5, 1, sharex=True, height_ratios=(3.0, 3.0, 2.2, 1.8, 0.7)
    )
    time = found.time
    for axes in (angle, torque, motors, energy, strip):
        for index, (start, end, _) in enumerate(ACTS):
            axes.axvspan(start, end, color=ACT_COLOURS[index % 2], zorder=0)
        for start, end in FAULTS:
            axes.axvspan(start, end, color=FAULT_COLOUR, alpha=0.18, zorder=0.5, linewidth=0.0)
        axes.axvspan(*CLUTCH, color=STATES['holding'], alpha=0.35, zorder=0.5, linewidth=0.0)
    _angle(angle, found)
    _torque(torque, found)
    for motor, (name, colour) in enumerate(zip('ABC', LEGS, strict=True)):
        motors.plot(
            time,
            found.motor_torque[:, motor],
            color=colour,
            linewidth=1.0,
            label=f'motor on th1{name}',
        )
    for limit in (-0.5, 0.5):
        motors.axhline(limit, color='grey', linestyle=':', linewidth=0.8)
    motors.legend(loc='lower left', ncols=3, fontsize=7)
    motors.set_ylim(-0.75, 0.6)
    plot_style.label_axes(motors, '', 'motor torque, N m')
    energy.plot(
        time,
        1e3 * found.given,
        color=plot_style.REFERENCE,
        linewidth=1.0,
        label='the motors gave in all (below 0: the hand gave them)',
    )
    energy.plot(
        time,
        1e3 * found.energy,
        color=plot_style.MULTI_BODY,
        linewidth=1.0,
        label='their budget: what they may still give',
    )
    energy.set_ylim(-110.0, 110.0)
    energy.legend(loc='lower left', ncols=2, fontsize=7)
    plot_style.label_axes(energy, '', 'energy, mJ')
    _strip(strip, found)
    strip.set_xlim(0.0, END)
    plot_style.save(figure, path)


def _angle(axes: Axes, found: Session) -> None:
    axes.fill_between(
        found.time,
        found.wall,
        120.0,
        color='#c9b79c',
        alpha=0.5,
        linewidth=0.0,
        label="the slave's wall, 1 N m/rad",
    )
    surface = singular_deg()
    axes.axhline(surface, color=ERROR_LIMIT.light, linestyle='--', linewidth=1.0)
    axes.annotate(
        'singular surface: three motors have no torque about the handle here',
        (END, surface),
        xytext=(-4, 3),
        textcoords='offset points',
        fontsize=7,
        ha='right',
        color=ERROR_LIMIT.light,
    )
    axes.plot(found.time, found.angle, color='black', linewidth=1.4, label='handle')
    stop = end_stop_deg()
    axes.fill_between(
        found.time, stop, 160.0, color=STOP_COLOUR, alpha=0.35, linewidth=0.0, label='the end stop'
    )
    axes.set_ylim(-4.0, 170.0)
    for start, end, name in ACTS:
        axes.text(0.5 * (start + end), 166.0, name, ha='center', va='top', fontsize=8)
    axes.legend(loc='upper left', bbox_to_anchor=(0.0, 0.84), fontsize=7)
    plot_style.label_axes(
        axes,
        '',
        'self-rotation φ, deg',
        'A session: a hand turns the handle, a slave meets a wall, four things fail, an end stop',
    )


def _torque(axes: Axes, found: Session) -> None:
    axes.plot(
        found.time,
        found.commanded,
        color=COMMANDED.light,
        linewidth=2.2,
        label='the slave asks for',
    )
    axes.plot(
        found.time,
        found.rendered,
        color=RENDERED.light,
        linewidth=1.1,
        label='the motors render: what the hand feels',
    )
    stopped = (found.time >= END_STOP[0]) & (found.time < END_STOP[1])
    axes.plot(
        found.time[stopped],
        -found.felt[stopped],
        color=STOP_COLOUR,
        linewidth=1.4,
        label='the end stop, about all axes',
    )
    for loss in LOSSES:
        row = round(loss.time * 1000)
        zero = found.time_to_zero(loss)
        axes.annotate(
            f'0 after\n{1e3 * zero:.0f} ms',
            (loss.time, found.rendered[row - 1]),
            xytext=(-38, -24),
            textcoords='offset points',
            fontsize=8,
            color=FAULT_COLOUR,
        )
    axes.axhline(-0.3, color='grey', linestyle=':', linewidth=0.8)
    axes.annotate(
        'limit',
        (END, -0.3),
        xytext=(-4, 2),
        textcoords='offset points',
        fontsize=7,
        ha='right',
        color='grey',
    )
    axes.set_ylim(-0.45, 0.1)
    axes.legend(loc='lower left', fontsize=7)
    plot_style.label_axes(axes, '', 'torque about\nthe handle, N m')


def _strip(axes: Axes, found: Session) -> None:
    step = found.time[1] - found.time[0]
    words = [
        'dead' if time >= MASTER else text.partition(':')[0]
        for time, text in zip(found.time, found.states, strict=True)
    ]
    first = 0
    for word, group in groupby(words):
        length = len(list(group))
        begin, width = found.time[first], length * step
        axes.broken_barh([(begin, width)], (0.0, 1.0), color=STATES[word])
        if width > 0.25:
            axes.text(begin + 0.5 * width, 0.5, word, ha='center', va='center', fontsize=7)
        first += length
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks([])
    plot_style.label_axes(axes, 'time, s', 'state')
