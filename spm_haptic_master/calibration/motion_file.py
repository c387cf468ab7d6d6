# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameter file of a calibration from free motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, tau
from typing import Any

import numpy as np
from spm_haptic_master.calibration.calibration_file import RECORD
from spm_haptic_master.calibration.free_motion import MotionCalibration
from spm_haptic_master.calibration.mechanism_parameters import Array
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES

# Number of values of a table: exact for a constant, the first and the second harmonic.
TABLE_VALUES = 5


@dataclass(frozen=True, slots=True)
class Origin:
    """
    Where a calibration comes from.

    Attributes
    ----------
    date : str
        ISO 8601 with the offset to UTC.
    recording : str
        Name of the log, or of the bus.
    checksum : str
        SHA-256 of the log; empty for a bus.
    version : str
        Of this package.
    counts_per_turn : tuple of N int
        Scale of each encoder.
    settings : mapping
        Further parameters that it rests on, by name: the bus and the frames of the encoders.

    """

    date: str
    recording: str
    checksum: str
    version: str
    counts_per_turn: tuple[int, ...]
    settings: Mapping[str, Any]


def zero_counts(calibration: MotionCalibration,
                counts_per_turn: Sequence[int]) -> tuple[tuple[int, ...], Array]:
    """
    Return the whole zero counts, and the reading that they leave at joint angle 0, rad.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of the motion.
    counts_per_turn : sequence of N int
        Scale of each encoder.

    """
    zeros = calibration.vector[calibration.layout.slices['zeros']]
    whole, rest = [], []
    for zero, sign, per_turn in zip(zeros, calibration.direction, counts_per_turn, strict=True):
        counts = sign * zero * per_turn / tau
        whole.append(round(counts) % per_turn)
        # reading = direction (count - zero count) tau / counts per turn
        rest.append(sign * (counts - round(counts)) * tau / per_turn)
    return tuple(whole), np.array(rest)


def motion_text(calibration: MotionCalibration, origin: Origin) -> str:
    """
    Return the text of the parameter file.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of the motion.
    origin : Origin
        Where it comes from.

    """
    c, layout = calibration, calibration.layout
    deviation, slices = c.deviations, layout.slices
    zeros, rest = zero_counts(c, origin.counts_per_turn)
    first, second = layout.harmonics(c.vector)
    geometry = layout.geometry(c.vector)
    joints = ALL_JOINT_NAMES[:layout.sensors]
    in_counts = ', '.join(f'{each * per_turn / tau:.2f}' for each, per_turn in zip(
        deviation[slices['zeros']], origin.counts_per_turn, strict=True))
    links = deviation[slices['links']]
    of_first = deviation[slices['first harmonics']].reshape(-1, 2)
    of_second = deviation[slices['second harmonics']].reshape(-1, 2)
    at = np.arange(TABLE_VALUES) * tau / TABLE_VALUES
    tables = ''.join(
        f'        {joint}: [{_row(left + c2 * np.cos(2.0 * at) + s2 * np.sin(2.0 * at))}]'
        f'   # second harmonic +- {degrees(sc):.4f}, {degrees(ss):.4f} deg\n'
        for joint, left, (c2, s2), (sc, ss) in zip(joints, rest, second, of_second, strict=True))
    sensors = '' if joints == JOINT_NAMES else f'    sensors: {layout.sensors}\n'
    left = '; '.join(f'{group}: {reason}' for group, reason in c.left.items()) or 'none'
    advice = c.advice[0].text if c.advice else ''
    return f"""\
# Calibration of {origin.date} from free motion, a parameter file for all nodes: --params-file.
# Recording: {origin.recording}{f', SHA-256 {origin.checksum}' if origin.checksum else ''}
# spm_haptic_master {origin.version}. +- is one standard deviation.
# Predicted error of the orientation, frames aligned: {degrees(c.error):.3f} deg rms over the
# motion, {degrees(c.target_error):.3f} over the workspace. Left as drawn: {left}.
/**:
  ros__parameters:
    calibration: "motion, {origin.date}"
{sensors}{_settings(origin.settings, False)}    # {', '.join(joints)}
    sigma_deg: [{_row(c.noise)}]   # white noise, 1 sigma
    bias_deg: [{_row(c.bias)}]    # bound of the systematic error
    geometry:
      proximal_deg: [{_row(geometry.alphas)}]   # +- {_row(links[:3], '.4f')}
      distal_deg: [{_row(geometry.betas)}]   # +- {_row(links[3:], '.4f')}
      # Axes: +- {_row(deviation[slices['base axes']], '.4f')} deg of the base's, \
{_row(deviation[slices['platform axes']], '.4f')} of the platform's
      base_axes: [{_plain(geometry.base_axes)}]
      platform_axes: [{_plain(geometry.platform_axes)}]
    encoders:
{_settings(origin.settings, True)}\
      counts_per_turn: [{', '.join(map(str, origin.counts_per_turn))}]
      direction: [{', '.join(map(str, c.direction))}]
      direction_verified: [{', '.join(['true'] * len(joints))}]
      zero_count: [{', '.join(map(str, zeros))}]   # +- {in_counts}
      harmonic_cos_deg: [{_row(first[:, 0])}]   # +- {_row(of_first[:, 0], '.4f')}
      harmonic_sin_deg: [{_row(first[:, 1])}]   # +- {_row(of_first[:, 1], '.4f')}
      # Second harmonic, and what the whole zero count leaves.
      table_deg:
{tables}# What it was computed from.
{RECORD}:
  ros__parameters:
    date: "{origin.date}"
    recording: "{origin.recording}"
    checksum: "{origin.checksum}"
    version: "{origin.version}"
    sets: {c.readings.sets}
    seconds: {c.readings.seconds[-1]:.1f}
    predicted_error_deg: {degrees(c.error):.6f}
    parity_deg: {degrees(float(np.sqrt(np.nanmean(c.parity ** 2)))):.6f}
    left_as_drawn: "{left}"
    advice: "{advice}"
"""


def _settings(values: Mapping[str, Any], of_encoders: bool) -> str:
    """Return the lines of the settings `encoders.NAME`, or of all others."""
    lines, group = [], ''
    for name, value in sorted(values.items()):
        *before, last = name.rsplit('.', 1)
        if (before == ['encoders']) != of_encoders:
            continue
        if before and not of_encoders and before[0] != group:
            group = before[0]
            lines.append(f'    {group}:\n')
        lines.append(f'{"      " if before else "    "}{last}: {_value(value)}\n')
    return ''.join(lines)


def _value(value: object) -> str:
    if isinstance(value, (tuple, list)):
        return f'[{", ".join(map(_value, value))}]'
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


def _row(angles: Iterable[float], form: str = '.6f') -> str:
    """Return angles in rad as degrees."""
    return ', '.join(format(degrees(angle), form) for angle in angles)


def _plain(axes: Iterable[Iterable[float]]) -> str:
    return ', '.join(f'{component:.12f}' for axis in axes for component in axis)
