# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A calibration on disk: a ROS parameter file for the driver, with a record for calibrate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import degrees, radians
import os
from pathlib import Path
from typing import Any

from spm_haptic_master.calibration.jig_pose import Calibration
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import JOINT_NAMES
import yaml

# Name of the section with calibrate's own record: no node has it, so that ROS ignores the section.
RECORD = 'calibration_record'


def calibration_text(calibration: Calibration) -> str:
    """Return the text of the parameter file."""
    c = calibration
    unchecked = [joint for joint, checked in zip(JOINT_NAMES, c.direction_checked, strict=True)
                 if not checked]
    if unchecked:
        directions = (f'# Direction as configured, NOT checked: {", ".join(unchecked)}. '
                      'One pose cannot\n# determine it: run calibrate again at a second one.')
    else:
        directions = '# Directions checked at a second pose.'
    return f"""\
# Calibration of {c.date}, from {c.sets} sets at rest.
# Pose of the jig, psi theta phi (ZXZ): {_row(c.pose, degrees, '.6f')} deg.
# Noise, 1 sigma: {_row(c.sigma, degrees, '.4f')} deg.
{directions}
/**/encoder_driver:
  ros__parameters:
    encoders:
      # {', '.join(JOINT_NAMES)}
      counts_per_turn: [{_row(c.counts_per_turn)}]
      direction: [{_row(c.direction)}]
      zero_count: [{_row(c.zero_count)}]
{RECORD}:
  ros__parameters:
    date: "{c.date}"
    pose_deg: [{_row(c.pose, degrees, '.6f')}]
    sets: {c.sets}
    mean_counts: [{_row(c.counts, float, '.3f')}]
    sigma_deg: [{_row(c.sigma, degrees, '.6f')}]
    direction_checked: [{', '.join(str(checked).lower() for checked in c.direction_checked)}]
"""


def read_calibration(path: Path) -> Calibration:
    """
    Read a file that `write_calibration` wrote.

    Raises
    ------
    InputError
        The file cannot be read, or calibrate did not write it.

    """
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        record = content[RECORD]['ros__parameters']
        encoders = content['/**/encoder_driver']['ros__parameters']['encoders']
        return Calibration(
            str(record['date']), _numbers(record['pose_deg'], 3, radians),
            _numbers(record['mean_counts']), _numbers(record['sigma_deg'], 4, radians),
            _numbers(encoders['direction'], 4, int), _numbers(encoders['zero_count'], 4, int),
            _numbers(encoders['counts_per_turn'], 4, int),
            _numbers(record['direction_checked'], 4, bool), int(record['sets']))
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError) as error:
        raise InputError(f'{path}: not a calibration that calibrate wrote: '
                         f'{type(error).__name__}: {error}') from error


def write_calibration(path: Path, calibration: Calibration) -> None:
    """
    Write the file, completely or not at all.

    Raises
    ------
    InputError
        The file cannot be written.

    """
    beside = path.with_name(path.name + '.new')
    try:
        beside.write_text(calibration_text(calibration), encoding='utf-8')
        os.replace(beside, path)
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error


def _row(values: Iterable[float], convert: Callable[[float], float] = int,
         form: str = 'd') -> str:
    return ', '.join(format(convert(value), form) for value in values)


def _numbers(values: Any, count: int = 4,
             convert: Callable[[Any], Any] = float) -> tuple[Any, ...]:
    if isinstance(values, (str, Mapping)) or len(values) != count:
        raise ValueError(f'{values!r} is not a list of {count}')
    return tuple(map(convert, values))
