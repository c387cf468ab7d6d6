# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What force feedback has to hold, beside what is found in simulated time."""

from __future__ import annotations

import numpy as np
from paper.figure_entry import table
from paper.verdicts import COLUMN
from spm_haptic_master.force import ForceLimits, render
from spm_haptic_master.kinematics import workspace_pose
from study.force.crossing import exact_share, THROWN
from study.force.hand_figures import hand_rows
from study.force.limit_row import Row
from study.force.loop import constant, run, Slave, Trace, wall
from study.force.motions import axis, loops, pose, push, quaternion

# Grips of hands (N m/rad, N m s/rad).
SOFT, USUAL = (0.3, 0.01), (1.0, 0.01)
# Period of the slave, delay there and back (ms).
NEAR, FAR = (5, 10, 20), (10, 50, 20)
# Self-rotation in the fade zone (deg).
FADE_ZONE = 44.0


def _pushed(
    phi_deg: float,
    about: str,
    stiffness: float,
    seconds: float,
    hand: tuple[float, float],
    depth: float,
    delays: tuple[int, int, int],
    **motion: float,
) -> Trace:
    R = pose(phi_deg)
    direction = axis(R, about)
    return run(
        R,
        Slave(wall(quaternion(R), direction, stiffness), *delays),
        seconds,
        hand=hand,
        motion=push(direction, depth, **motion),
    )


def _statics() -> list[Row]:
    """Return the rows of the statics of three motors."""
    motor = handle = peak = 0.0
    for tilt in (0.0, 5.0, 12.0):
        for azimuth in (0.5, 2.5, 4.5):
            R = workspace_pose(np.radians(tilt), azimuth, np.radians(np.arange(20.0, 80.0, 0.05)))
            for direction in np.vstack([np.eye(3), np.full(3, 3.0**-0.5)]):
                found = render(R, THROWN * direction)
                peak = max(peak, np.abs(found.motor_torque).max())
                motor = max(motor, np.abs(np.diff(found.motor_torque, axis=0)).max())
                handle = max(handle, np.linalg.norm(np.diff(found.rendered, axis=0), axis=1).max())
    exact = 100.0 * exact_share(ForceLimits())
    return [
        Row('three motors: 0.3 N m is rendered exactly', exact, 75.0, '%', more_is_better=True),
        Row('three motors: largest torque of a motor', peak, 0.5, 'N m'),
        Row('poses 0.05 deg apart: step of a motor', motor, 0.05, 'N m'),
        Row('poses 0.05 deg apart: step at the handle', handle, 0.01, 'N m'),
    ]


def _walls() -> list[Row]:
    """Return the rows of the slave's wall."""
    cases = ((60.0, 'roll', USUAL), (60.0, 'roll', SOFT), (20.0, 'tilt', USUAL))
    deep = [_pushed(phi, about, 2.0, 3.5, hand, 0.2, NEAR) for phi, about, hand in cases]
    shallow = _pushed(20.0, 'roll', 2.0, 3.5, USUAL, 0.06, NEAR)
    far_cases = (
        ('roll', 2.0, USUAL),
        ('roll', 8.0, USUAL),
        ('tilt', 8.0, USUAL),
        ('roll', 8.0, SOFT),
    )
    far = [_pushed(20.0, about, K, 3.0, hand, 0.2, FAR) for about, K, hand in far_cases]
    near = 'wall of 2 N m/rad, 200 Hz, 30 ms'
    most_deep = max(found.generated for found in deep)
    most_far = max(found.generated for found in far)
    share = min(found.share.min() for found in (shallow, *deep))
    faults = sum(found.states[-1] != 'engaged' for found in far)
    return [
        Row(f'{near}, push of 0.06 rad: generated', 1e3 * shallow.generated, 5.0, 'mJ'),
        Row(f'{near}, push of 0.2 rad: generated', 1e3 * most_deep, 6.0, 'mJ'),
        Row(f'{near}: least share of the wrench', share, 0.9, '', more_is_better=True),
        Row('walls of 2 and 8 N m/rad, 100 Hz, 70 ms: generated', 1e3 * most_far, 20.0, 'mJ'),
        Row('these walls: runs that end in a fault', float(faults), 0.0, ''),
        _released(1.0, 1.0),
        _released(2.0, 8.0),
    ]


def _released(stiffness: float, limit: float) -> Row:
    """Return the row of a spring, N m/rad, that is pressed and released; the limit in %."""
    found = _pushed(20.0, 'roll', stiffness, 1.6, USUAL, 0.3, NEAR, rise=0.5, hold=0.5)
    asked = np.linalg.norm(found.asked, axis=1)
    pressed = asked > 0.02
    whole = asked[pressed] / found.share[pressed]
    lost = 100.0 * (1.0 - asked[pressed].sum() / whole.sum())
    return Row(f'press and release, {stiffness:g} N m/rad: torque lost', lost, limit, '%')


def _energy() -> list[Row]:
    """Return the rows of the fade zone and of rest."""
    R = pose(FADE_ZONE)
    generated = 0.0
    for speed in (1.0, 3.0):
        for sense in (1, -1):
            motion, environment, seconds = loops(R, speed, 12, sense)
            generated = max(
                generated, run(R, Slave(environment), seconds, motion=motion, hand=None).generated
            )
    before = pose(40.0)
    roll = axis(before, 'roll')
    x, y, z = (THROWN * roll).tolist()
    across = run(
        before,
        Slave(constant((x, y, z))),
        1.5,
        hand=(10.0, 0.03),
        motion=push(roll, 0.35, rise=1.2),
    )
    step = np.linalg.norm(np.diff(across.rendered[across.start :], axis=0), axis=1).max()
    quiet = run(pose(20.0), Slave(constant((0.0, 0.0, 0.0))), 3.0, hand=None)
    felt = quiet.rendered[quiet.start :]
    rest = run(pose(20.0), Slave(constant((0.1, 0.0, 0.0))), 60.0, hand=None)
    noise = 1e3 * np.sqrt(np.mean(np.sum(felt**2, axis=1)))
    least = 1e3 * rest.energy[rest.start :].min()
    return [
        Row(
            'twelve loops in the fade zone, 1 and 3 rad/s: generated', 1e3 * generated, 20.0, 'mJ'
        ),
        Row('across the surface, 0.3 N m, hand of 10 N m/rad: step', step, 0.15, 'N m a ms'),
        Row('at rest, damping alone: torque by noise, rms', noise, 1.0, 'mN m'),
        Row('a minute at rest with 0.1 N m: least budget', least, 1.5, 'mJ', more_is_better=True),
        Row('the same: least share of the wrench', rest.share.min(), 1.0, '', more_is_better=True),
    ]


def limits_table() -> str:
    """Return the table of limits and what is found, Markdown."""
    rows = []
    for row in (*_statics(), *_walls(), *_energy(), *hand_rows()):
        rows.append(
            (
                row.name,
                f'{row.found:.3g} {row.unit}',
                f'{">" if row.more_is_better else "<"}= {row.limit:g} {row.unit}',
                'holds' if row.holds else 'does not hold',
            )
        )
    return table(('', 'found', 'limit', COLUMN), rows)
