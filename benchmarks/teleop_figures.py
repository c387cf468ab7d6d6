# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The figures of a demonstrated tele-operation, from all commands and poses of the slave."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import degrees, sqrt

from benchmarks.surgeon import Arrived
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.kinematics.vectors import subtracted
from spm_haptic_master.nodes.sim_slave import SHAFT
from spm_haptic_master.teleoperation.command import Pose
from spm_haptic_master.teleoperation.remote_centre import (
    depth_of,
    distance_from_shaft,
    MILLIMETRES,
)
from spm_haptic_master.teleoperation.vectors import norm
from spm_haptic_master.timing import SECOND

# Interval without a command that separates two stretches (ns): the shortest time-out of teleop.
PAUSE = 500_000_000
# Time after a loss in which a command may be on its way, on a busy machine (ns): what is lost is
# missed after 50 ms at most.
ON_ITS_WAY = 200_000_000
# Longest time between a command and the pose of the slave that it is compared with (ns).
PAIRED = 20_000_000
# Nanoseconds in a millisecond.
MILLISECOND = 1e6


@dataclass(frozen=True, slots=True)
class Loss:
    """What was lost, and when."""

    what: str
    last: int  # time of the last value before the loss, ns
    enabled: int  # time of the next enable, ns


@dataclass(frozen=True, slots=True)
class Step:
    """The difference of two commands that follow each other."""

    angle: float  # rad
    distance: float  # of the tips, m
    seconds: float


def pose_of(arrived: Arrived) -> Pose:
    """Return a pose that has arrived."""
    return Pose(arrived.quaternion, arrived.position)


def table(
    commands: Sequence[Arrived],
    poses: Sequence[Arrived],
    trocar: tuple[float, float, float],
    losses: Sequence[Loss],
) -> str:
    """
    Return the figures of a run as a Markdown table.

    Parameters
    ----------
    commands, poses
        All commands, and all poses of the slave, in their order.
    trocar
        In the slave's base frame, m.
    losses
        What was lost meanwhile.

    """
    rows = [
        *_rows_of_starts(commands, poses),
        *_rows_of_steps(commands),
        *_rows_of_trocar(commands, trocar),
        *_rows_of_tracking(commands, poses),
        *(row for loss in losses for row in _rows_of_loss(commands, loss)),
    ]
    lines = [f'| {name} | {value} |' for name, value in rows]
    return '\n'.join(['| figure | value |', '|---|---|', *lines])


def _rows_of_starts(
    commands: Sequence[Arrived], poses: Sequence[Arrived]
) -> list[tuple[str, str]]:
    stretches = stretches_of(commands)
    starts = [(stretch[0], _before(poses, stretch[0].at)) for stretch in stretches]
    angles = [_angle(first, slave) for first, slave in starts if slave is not None]
    distances = [_distance(first, slave) for first, slave in starts if slave is not None]
    return [
        ('commands on `servo_cp`', f'{len(commands)}'),
        ('times that the slave began to follow', f'{len(stretches)}'),
        (
            'first command beside the slave, largest',
            f'{degrees(max(angles, default=0.0)):.3f} deg, '
            f'{MILLIMETRES * max(distances, default=0.0):.3f} mm',
        ),
    ]


def _rows_of_steps(commands: Sequence[Arrived]) -> list[tuple[str, str]]:
    steps = [
        Step(_angle(one, other), _distance(one, other), (other.stamp - one.stamp) / SECOND)
        for stretch in stretches_of(commands)
        for one, other in pairwise(stretch)
    ] or [Step(0.0, 0.0, 1.0)]
    return [
        (
            'step from one command to the next, largest',
            f'{degrees(max(step.angle for step in steps)):.3f} deg, '
            f'{MILLIMETRES * max(step.distance for step in steps):.3f} mm',
        ),
        (
            'angular speed of the command, largest',
            f'{max(step.angle / step.seconds for step in steps):.2f} rad/s',
        ),
    ]


def _rows_of_trocar(
    commands: Sequence[Arrived], trocar: tuple[float, float, float]
) -> list[tuple[str, str]]:
    poses = [pose_of(command) for command in commands]
    depths = [depth_of(trocar, pose) for pose in poses] or [0.0]
    distances = [distance_from_shaft(trocar, pose, SHAFT) for pose in poses]
    return [
        ('distance of the shaft from the trocar, largest', f'{max(distances, default=0.0):.1e} m'),
        (
            'depth of the tip, smallest and largest',
            f'{MILLIMETRES * min(depths):.1f} mm, {MILLIMETRES * max(depths):.1f} mm',
        ),
    ]


def _rows_of_tracking(
    commands: Sequence[Arrived], poses: Sequence[Arrived]
) -> list[tuple[str, str]]:
    errors = list(_tracking(commands, poses)) or [0.0]
    rms = sqrt(sum(error * error for error in errors) / len(errors))
    return [
        ('tracking error of the slave, rms', f'{degrees(rms):.3f} deg'),
        ('tracking error of the slave, largest', f'{degrees(max(errors)):.3f} deg'),
    ]


def _rows_of_loss(commands: Sequence[Arrived], loss: Loss) -> list[tuple[str, str]]:
    last = max((each.at for each in commands if each.at < loss.enabled), default=loss.last)
    after = sum(loss.last + ON_ITS_WAY < each.at < loss.enabled for each in commands)
    return [
        (
            f'{loss.what} lost: from its last value to the last command',
            f'{max(0.0, (last - loss.last) / MILLISECOND):.1f} ms',
        ),
        (f'{loss.what} lost: commands from then to the next enable', f'{after}'),
    ]


def stretches_of(commands: Sequence[Arrived]) -> list[list[Arrived]]:
    """Return the commands in stretches without a pause."""
    found: list[list[Arrived]] = []
    for command in commands:
        if not found or command.stamp - found[-1][-1].stamp > PAUSE:
            found.append([])
        found[-1].append(command)
    return found


def _tracking(commands: Sequence[Arrived], poses: Sequence[Arrived]) -> Iterator[float]:
    """Yield the angle from each command to the next pose of the slave, rad."""
    following = iter(poses)
    pose = next(following, None)
    for command in commands:
        while pose is not None and pose.at < command.at:
            pose = next(following, None)
        if pose is not None and pose.at - command.at < PAIRED:
            yield _angle(command, pose)


def _before(poses: Sequence[Arrived], at: int) -> Arrived | None:
    """Return the last pose that arrived before a time, ns."""
    return next((pose for pose in reversed(poses) if pose.at < at), None)


def _angle(one: Arrived, other: Arrived) -> float:
    return rotation_distance(one.quaternion, other.quaternion)


def _distance(one: Arrived, other: Arrived) -> float:
    return norm(subtracted(one.position, other.position))
