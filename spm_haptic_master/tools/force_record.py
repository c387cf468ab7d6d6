# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Record a bring-up of force: a step of each motor, releases, and poses for the weight."""

from __future__ import annotations

from collections.abc import Callable
import csv
from math import isfinite, pi, remainder
from pathlib import Path
import time
from typing import NamedTuple, Protocol

from spm_haptic_master.calibration.motor_bring_up import motor_sign
from spm_haptic_master.drives.drives import DriveReport
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force import ForceLimits
from spm_haptic_master.force.energy import JointMotion
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.force.statics import clipped
from spm_haptic_master.kinematics import estimate_sample, Geometry, UsedSensors
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion
from spm_haptic_master.tools.force_poses import (
    Angles,
    DAMPING,
    Phase,
    PoseHold,
)

# Columns of a recording.
ANGLES = ['th1a', 'th1b', 'th1c', 'th3a']
TORQUES = ['tau1a', 'tau1b', 'tau1c', 'tau3a']
# Time at rest, and the last of it without torque, which is recorded; of a torque; of the opposite
# one that ends a step, or of none after a release (s).
REST, SHOWN, PUSH, AFTER = 0.6, 0.05, 0.05, 0.15
# Torque of a motor alone, and about the handle's z axis (N m): a turn of some degrees.
STEP, RELEASES = 0.01, (0.005, -0.01, 0.01, -0.005)
# Longest time for a pose (s).
PATIENCE = 300.0
# Longest time until angles come and the drives are ready (s).
READY = 30.0
# Longest time between two steps of the drives meanwhile (s).
WAIT = 0.005
# Turn of a joint in one part that ends the recording (rad): nothing of it turns so far.
FARTHEST = 0.6
# A row of a recording: part, time, angles, torques.
Row = tuple[str, float, Angles, tuple[float, ...]]


class Stage(NamedTuple):
    """A part of the bring-up: its name, the motor alone or None, and the torque, N m."""

    name: str
    motor: int | None
    torque: float


class MotorDrives(Protocol):
    """What the drives of a bring-up do: see `drives.Drives`."""

    def step(self, torques: tuple[float, ...] | None, now: float) -> DriveReport:
        """Send torques, N m; return the state."""


def steps(motors: int) -> list[Stage]:
    """Return the steps of each motor alone."""
    return [Stage(f'step {name[2:]}', motor, STEP) for motor, name in enumerate(ANGLES[:motors])]


def releases() -> list[Stage]:
    """Return the releases of the handle."""
    return [Stage(f'release z {number}', None, torque)
            for number, torque in enumerate(RELEASES, start=1)]


class BringUp:
    """Torques of a bring-up, sample by sample; `sigma` is the noise of the encoders, rad."""

    def __init__(self, motors: int, geometry: Geometry, working_mode: WorkingMode,
                 sigma: tuple[float, ...]) -> None:
        self.motors, self._geometry = motors, geometry
        self._statics = make_statics(geometry, working_mode, motors, ForceLimits())
        self._sensors = UsedSensors(sigma)

    def torques(self, stage: Stage, since: float, angles: tuple[float, ...],
                velocity: tuple[float, ...] | None) -> tuple[float, ...]:
        """Return the torques, N m, at a time, s, since the rest of a part began."""
        nothing = (0.0,) * self.motors
        if since < REST:
            if stage.motor is not None or velocity is None or since >= REST - SHOWN:
                return nothing
            return tuple([clipped(-DAMPING * rate, STEP) for rate in velocity])
        if stage.motor is not None:
            # The opposite step takes the speed away again, whatever the sign.
            torque = stage.torque if since < REST + PUSH else -stage.torque
            return tuple([torque if motor == stage.motor and since < REST + 2.0 * PUSH else 0.0
                          for motor in range(self.motors)])
        if since >= REST + PUSH:
            return nothing
        rotation = rotation_from_quaternion(
            *estimate_sample(angles[:4], self._sensors, self._geometry).quaternion)
        self._statics.place(rotation)
        tau, _ = self._statics.render((stage.torque * rotation[2], stage.torque * rotation[5],
                                       stage.torque * rotation[8]))
        return tau


def record(path: Path, source: EncoderSource, drives: MotorDrives, bring_up: BringUp,
           silence: float, show: Callable[[str], None], poses: int = 0) -> None:
    """
    Move the device through a bring-up, and write the recording.

    Only where each motor turned its joint in its own sense, the motors release the handle, and
    hold it in `poses` poses to which a hand brings it. `silence` is the longest time without
    angles, s. InputError: no angles come, the drives are not ready, a
    joint turns too far, or the file cannot be written.
    """
    motors = bring_up.motors
    _wait(source, drives, (0.0,) * motors)
    rows: list[Row] = []
    for stage in steps(motors):
        show(stage.name)
        rows += _stage(stage, source, drives, bring_up, silence)
    if all(_sign(rows, stage) == 1 for stage in steps(motors)):
        for stage in releases():
            show(stage.name)
            rows += _stage(stage, source, drives, bring_up, silence)
        held: list[Angles] = []
        while len(held) < poses:
            show(f'pose {len(held) + 1} of {poses}: bring the handle to a new pose, 10 deg or '
                 'more from the others, and keep it still')
            rows += _pose(PoseHold(bring_up.motors, held), source, drives, silence, show)
        show('all is recorded: nothing holds the handle any more')
    try:
        with path.open('w', encoding='utf-8', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(('part', 'time', *ANGLES, *TORQUES[:motors]))
            writer.writerows((name, f'{since:.6f}', *angles, *tau)
                             for name, since, angles, tau in rows)
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error


def _stage(stage: Stage, source: EncoderSource, drives: MotorDrives, bring_up: BringUp,
           silence: float) -> list[Row]:
    """Do a part; return its rows, from the end of the rest on."""
    motion, rows = JointMotion(bring_up.motors), []
    start, first = _read(source, silence)
    stamp, angles, since, before = start, first, 0.0, 0.0
    tau: tuple[float, ...] = (0.0,) * bring_up.motors
    while since < REST + PUSH + AFTER:
        motion.take(stamp, angles, tau, since - before)
        tau = bring_up.torques(stage, since, angles, motion.velocity)
        _command(drives, tau, stage.name)
        if REST - SHOWN <= since and (stage.motor is None or since < REST + PUSH):
            rows.append((stage.name, since, angles[:4], tau))
        stamp, angles = _read(source, silence)
        before, since = since, 1e-9 * (stamp - start)
        turn = max(abs(remainder(a - b, 2.0 * pi)) for a, b in zip(angles, first, strict=True))
        if turn > FARTHEST:
            raise InputError(f'{stage.name}: a joint turned by {turn:.2f} rad: expected some '
                             'degrees; is the device balanced, and nobody holds it?')
    return rows


def _pose(hold: PoseHold, source: EncoderSource, drives: MotorDrives, silence: float,
          show: Callable[[str], None]) -> list[Row]:
    """Let the motors hold the handle in one pose; return its rows."""
    rows: list[Row] = []
    start, angles = _read(source, silence)
    stamp, phase = start, hold.phase
    while hold.phase is not Phase.OVER:
        since = 1e-9 * (stamp - start)
        tau = hold.torques(stamp, since, angles)
        _command(drives, tau, hold.name)
        if hold.phase is Phase.RECORDING:
            rows.append((hold.name, since, angles[:4], tau))
        if hold.phase is not phase:
            phase = hold.phase
            show(f'{hold.name}: {phase.value}')
        if since > PATIENCE:
            raise InputError(f'{hold.name}: not at rest within {PATIENCE:g} s')
        stamp, angles = _read(source, silence)
    return rows


def _command(drives: MotorDrives, tau: tuple[float, ...], name: str) -> None:
    report = drives.step(tau, time.monotonic())
    if not report.ready:
        raise InputError(f'{name}: the drives are no longer ready: {report.fault}')


def _sign(rows: list[Row], stage: Stage) -> int:
    own = [row for row in rows if row[0] == stage.name]
    motor = stage.motor or 0
    return motor_sign([row[3][motor] for row in own], [row[2][motor] for row in own])


def _wait(source: EncoderSource, drives: MotorDrives, nothing: tuple[float, ...]) -> None:
    """Wait until angles come and the drives are ready, without torque."""
    end = time.monotonic() + READY
    while time.monotonic() < end:
        sample = source.read(WAIT)
        report = drives.step(nothing, time.monotonic())
        if sample is not None and report.ready:
            return
    if sample is None:
        raise InputError(f'no set of angles within {READY:g} s: {source.fault}')
    raise InputError(f'the drives are not ready after {READY:g} s: {report.fault}')


def _read(source: EncoderSource, silence: float) -> tuple[int, tuple[float, ...]]:
    """Return stamp, ns, and angles, rad, of the next set."""
    sample = source.read(silence)
    if sample is None:
        raise InputError(f'no set of angles within {silence:g} s: {source.fault}')
    if not isfinite(sum(sample.angles)):
        raise InputError(f'angles {sample.angles}: expected those of all joints')
    return sample.stamp, sample.angles
