# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of calibrate in which a jig holds the device in known poses."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np
from spm_haptic_master.calibration import calibration_file, jig
from spm_haptic_master.calibration.axis_file import axis_parameters
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.encoders.decoder_factory import make_harmonics
from spm_haptic_master.exceptions import InputError, UnreachableError
from spm_haptic_master.kinematics import measured_angles, zxz_rotation
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.encoders import HARMONIC_SETTINGS, sensors_of
from spm_haptic_master.parameters.geometry import geometry_from, MECHANISM_SETTINGS
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.parameters.setting import SENSORS_SETTING
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.motion_source import (
    check_source,
    POSE_SECONDS,
    record_pose,
    wait_for_pose,
)

# Default pose of the jig, psi theta phi (deg): the workspace's centre, with a self-rotation far
# from the singularity near 50 deg.
POSE_DEFAULT = (degrees(trajectories.CENTRE_PSI), degrees(trajectories.CENTRE_THETA), 0.0)
# Defaults of the settings that a calibration rests on, by name; None stands for zeros. Its file
# has the values that are others.
KEPT = {each.name: each.default for each in (*MECHANISM_SETTINGS, *HARMONIC_SETTINGS)}
# Bound of each sensor's systematic error after a calibration in a jig (deg), where the error of
# the jig is not given: that of a good jig, of links and of a 14-bit encoder.
BIAS_DEFAULT = 0.05


@dataclass(frozen=True, slots=True)
class Rig:
    """
    The rig in the jig, as its parameters say.

    Attributes
    ----------
    source : str
        Name of the source, `can` or `replay`.
    sensors : int
        Number N of sensors.
    values : dict
        Checked parameters of the source, by name.
    mechanism : dict
        Checked parameters of the mechanism, by name.

    """

    source: str
    sensors: int
    values: dict[str, Any]
    mechanism: dict[str, Any]

    @property
    def counts_per_turn(self) -> tuple[int, ...]:
        """Return the counts of each encoder in a turn."""
        counts: tuple[int, ...] = self.values['encoders.counts_per_turn']
        return counts

    def readings(self, pose: Sequence[float]) -> tuple[float, ...]:
        """
        Return what the encoders read at a pose, but for zeros and directions.

        Parameters
        ----------
        pose : sequence of float
            psi, theta, phi (ZXZ), deg.

        Returns
        -------
        tuple of float
            rad, in the order of ALL_JOINT_NAMES.

        Raises
        ------
        InputError
            The pose is out of reach.

        """
        try:
            angles = measured_angles(
                rotation=zxz_rotation(*map(radians, pose)),
                geometry=geometry_from(self.mechanism),
                working_mode=self.mechanism['working_mode'],
                sensors=self.sensors,
            )
        except UnreachableError as error:
            given = ' '.join(f'{angle:g}' for angle in pose)
            raise InputError(f'--pose {given}: out of reach of the manipulator') from error
        return tuple(
            angle if harmonics is None else float(harmonics.readings(angle))
            for angle, harmonics in zip(angles, make_harmonics(self.values), strict=True)
        )

    def kept_settings(self) -> dict[str, Any]:
        """Return the settings that the calibration rests on and that are not the defaults."""
        kept = {}
        for name, value in (self.values | self.mechanism).items():
            if name not in KEPT:
                continue
            default = KEPT[name]
            if default is None:
                is_other = any(value)
            else:
                is_other = value != default
            if is_other:
                kept[name] = value
        return kept


def run(options: argparse.Namespace) -> int:
    """
    Calibrate from known poses of a jig.

    For each --pose it waits for Enter, if there are several, and records --seconds at rest. What
    is not given is as in the file to be overwritten, whose poses help to determine the directions.
    It writes -o FILE and prints zero count, noise, bias and direction of each encoder.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    int
        Exit code 0.

    Raises
    ------
    InputError
        The command line is not as expected, or a pose is out of reach.
    CalibrationError
        The device moved or is noisy, or the poses contradict each other.

    """
    if options.output is None:
        raise InputError('no -o FILE; expected the parameter file to write')
    given = command_line.given(options)
    source = str(given.get('source', 'can'))
    poses = options.pose or [POSE_DEFAULT]
    _check_poses(source, poses)
    calibration_file.check_output(options.output, options.force)
    before = None
    if options.output.exists():
        before = calibration_file.read_calibration(options.output)
        given = _settings_of(options.output) | given
    rig = _rig(source, given)
    readings = [rig.readings(pose) for pose in poses]
    _check_counts(options.output, before, rig)
    calibration = jig.calibrate(
        _recorded_stations(options, rig, poses, readings),
        rig.values['encoders.direction'],
        rig.counts_per_turn,
        datetime.now().astimezone().isoformat(timespec='seconds'),
        _bias(options.jig_error, rig, poses),
        radians(options.tolerance),
        before,
    )
    kept = rig.kept_settings() | axis_parameters(options.output)
    text = calibration_file.calibration_text(calibration, kept)
    calibration_file.write_text(options.output, text)
    _report(options.output, calibration, replaced=before)
    return 0


def _check_poses(
    source: str,
    poses: Sequence[Sequence[float]],
) -> None:
    """Raise InputError for a source of no real device, and for a log with several poses."""
    check_source(source, 'calibrate')
    if source == 'replay' and len(poses) > 1:
        raise InputError(
            f'--pose is given {len(poses)} times; expected once for a recording: run '
            'calibrate again, with --force, for the recording at the next pose'
        )


def _settings_of(path: Path) -> dict[str, object]:
    """Return the mechanism of the file to be overwritten: a calibration belongs to it."""
    names = KEPT.keys() | {SENSORS_SETTING.name}
    return {name: value for name, value in read_parameters(path).items() if name in names}


def _rig(
    source: str,
    given: dict[str, object],
) -> Rig:
    """Return the rig that given parameters describe, in raw counts where they do not say more."""
    sensors = sensors_of(given)
    return Rig(
        source=source,
        sensors=sensors,
        values=command_line.checked(raw_counts(sensors) | given, SOURCE_SETTINGS[source], source),
        mechanism=command_line.checked(given, MECHANISM_SETTINGS),
    )


def _check_counts(
    path: Path,
    before: jig.Calibration | None,
    rig: Rig,
) -> None:
    """Raise InputError where the file to be overwritten is for other encoders."""
    if before is not None and before.counts_per_turn != rig.counts_per_turn:
        raise InputError(
            f'{path}: it is for {list(before.counts_per_turn)} counts per '
            f'turn, the encoders have {list(rig.counts_per_turn)}'
        )


def _recorded_stations(
    options: argparse.Namespace,
    rig: Rig,
    poses: Sequence[Sequence[float]],
    readings: Sequence[tuple[float, ...]],
) -> list[jig.Station]:
    """
    Record the device at rest in each pose.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    rig : Rig
        The rig in the jig.
    poses : sequence of sequence of float
        Poses of the jig: psi, theta, phi (ZXZ), deg.
    readings : sequence of tuple of float
        What the encoders read at each of them, rad.

    Returns
    -------
    list of jig.Station
        One for each pose.

    """
    stations = []
    for number, (pose, expected) in enumerate(zip(poses, readings, strict=True), 1):
        if len(poses) > 1:
            wait_for_pose(number, len(poses), pose)
        counts = record_pose(rig.source, rig.values, options.seconds or POSE_SECONDS)
        means, noise = jig.read_still(
            counts,
            rig.counts_per_turn,
            radians(options.noise_limit),
            radians(options.drift_limit),
        )
        stations.append(
            jig.Station(
                pose=tuple(map(radians, pose)),
                angles=expected,
                counts=tuple(means.tolist()),
                sigma=tuple(noise.tolist()),
                sets=len(counts),
            )
        )
    return stations


def _bias(
    jig_error_deg: float | None,
    rig: Rig,
    poses: Sequence[Sequence[float]],
) -> list[float]:
    """
    Return the bound of each sensor's systematic error.

    Parameters
    ----------
    jig_error_deg : float or None
        Largest error of the jig's pose, deg; None if it is not given.
    rig : Rig
        The rig in the jig.
    poses : sequence of sequence of float
        Poses of the jig: psi, theta, phi (ZXZ), deg.

    Returns
    -------
    list of float
        N bounds, rad: `BIAS_DEFAULT`, or the largest that the error of the jig makes at a pose.

    """
    if jig_error_deg is None:
        return [radians(BIAS_DEFAULT)] * rig.sensors
    bounds = [
        jig.jig_bias(
            [*map(radians, pose)],
            geometry_from(rig.mechanism),
            rig.mechanism['working_mode'],
            radians(jig_error_deg),
            rig.sensors,
        )
        for pose in poses
    ]
    largest: list[float] = np.max(bounds, axis=0).tolist()
    return largest


def _report(
    path: Path,
    calibration: jig.Calibration,
    replaced: jig.Calibration | None,
) -> None:
    """Print what was written, a line for each encoder, and which directions are not verified."""
    if replaced is None:
        print(f'{path}: written')
    else:
        print(f'{path}: overwritten (it held the calibration of {replaced.date})')
    for index, joint in enumerate(ALL_JOINT_NAMES[: len(calibration.zero_count)]):
        verified = 'verified' if calibration.direction_verified[index] else 'NOT verified'
        print(
            f'  {joint}: zero count {calibration.zero_count[index]}, '
            f'sigma {degrees(calibration.sigma[index]):.4f} deg, '
            f'bias {degrees(calibration.bias[index]):.4f} deg, '
            f'direction {calibration.direction[index]:+d} ({verified})'
        )
    if not all(calibration.direction_verified):
        print(
            'The driver refuses directions that are not verified: move the jig to a second '
            'pose, which\nturns each joint by more than '
            f'{degrees(jig.TRAVEL_MINIMUM):g} deg, and run calibrate --force with that --pose.'
        )
