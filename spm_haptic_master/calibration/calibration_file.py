# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A calibration on disk: a ROS parameter file for all nodes, with a record for calibrate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import degrees, isfinite, radians
import os
from pathlib import Path
from typing import Any

from spm_haptic_master.calibration.jig_pose import Calibration, Station
from spm_haptic_master.encoders.settings import sensors_of
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
import yaml

# Name of the section with calibrate's own record: no node has it, so that ROS ignores the section.
RECORD = 'calibration_record'


def calibration_text(calibration: Calibration,
                     mechanism: Mapping[str, Any] | None = None) -> str:
    """
    Return the text of the parameter file.

    Parameters
    ----------
    calibration : Calibration
        What it describes.
    mechanism : mapping, optional
        Parameters of the mechanism and the harmonics that it rests on, by name; without the
        defaults.

    """
    c = calibration
    rests_on = ''.join(f'    {name}: {list(value) if isinstance(value, tuple) else value}\n'
                       for name, value in (mechanism or {}).items())
    if rests_on:
        rests_on = '    # Mechanism and harmonics with which it was made.\n' + rests_on
    joints = ALL_JOINT_NAMES[:len(c.zero_count)]
    sensors = '' if joints == JOINT_NAMES else f'    sensors: {len(joints)}\n'
    unverified = [joint for joint, known in zip(joints, c.direction_verified, strict=True)
                  if not known]
    if unverified:
        directions = (f'# Direction as configured, NOT verified: {", ".join(unverified)}. The '
                      'driver refuses it;\n# calibrate at a second pose determines it.')
    else:
        directions = '# All directions verified, by two poses.'
    stations = c.stations
    return f"""\
# Calibration of {c.date}, a parameter file for all nodes: --params-file.
{directions}
/**:
  ros__parameters:
    calibration: "jig, {c.date}"
{sensors}    # {', '.join(joints)}
    sigma_deg: [{_row(c.sigma, degrees, '.6f')}]   # white noise, 1 sigma
    bias_deg: [{_row(c.bias, degrees, '.6f')}]    # bound of the systematic error
    encoders:
      counts_per_turn: [{_row(c.counts_per_turn)}]
      direction: [{_row(c.direction)}]
      direction_verified: [{', '.join(str(known).lower() for known in c.direction_verified)}]
      zero_count: [{_row(c.zero_count)}]
{rests_on}# Readings that it was computed from, one group of values for each pose of the jig.
{RECORD}:
  ros__parameters:
    date: "{c.date}"
    poses_deg: [{_row(_chained(s.pose for s in stations), degrees, '.6f')}]
    angles_deg: [{_row(_chained(s.angles for s in stations), degrees, '.6f')}]
    mean_counts: [{_row(_chained(s.counts for s in stations), float, '.3f')}]
    noise_deg: [{_row(_chained(s.sigma for s in stations), degrees, '.6f')}]
    sets: [{_row(s.sets for s in stations)}]
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
        parameters = content['/**']['ros__parameters']
        encoders = parameters['encoders']
        n = sensors_of(parameters)
        # A calibration from free motion has no poses.
        sets = _numbers(record.get('sets', ()), len(record.get('sets', ())), _integer)
        stations = tuple(map(
            Station, _groups(record, 'poses_deg', len(sets), 3, radians),
            _groups(record, 'angles_deg', len(sets), n, radians),
            _groups(record, 'mean_counts', len(sets), n),
            _groups(record, 'noise_deg', len(sets), n, radians), sets))
        return Calibration(
            str(record['date']), stations, _numbers(encoders['direction'], n, _sign),
            _numbers(encoders['zero_count'], n, _integer),
            _numbers(encoders['counts_per_turn'], n, _integer),
            _numbers(encoders['direction_verified'], n, _flag),
            _numbers(parameters['bias_deg'], n, radians))
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError) as error:
        raise InputError(f'{path}: not a calibration that calibrate wrote: '
                         f'{type(error).__name__}: {error}') from error


def write_calibration(path: Path, calibration: Calibration,
                      mechanism: Mapping[str, Any] | None = None) -> None:
    """
    Write the file, completely or not at all; arguments of `calibration_text`.

    Raises
    ------
    InputError
        The file cannot be written.

    """
    write_text(path, calibration_text(calibration, mechanism))


def write_text(path: Path, text: str) -> None:
    """
    Write a text file, completely or not at all.

    Raises
    ------
    InputError
        The file cannot be written.

    """
    beside = path.with_name(path.name + '.new')
    try:
        beside.write_text(text, encoding='utf-8')
        os.replace(beside, path)
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error


def _row(values: Iterable[float], convert: Callable[[float], float] = int,
         form: str = 'd') -> str:
    return ', '.join(format(convert(value), form) for value in values)


def _chained(groups: Iterable[Sequence[float]]) -> list[float]:
    return [value for group in groups for value in group]


def _numbers(values: Any, count: int, convert: Callable[[Any], Any]) -> tuple[Any, ...]:
    if isinstance(values, (str, Mapping)) or len(values) != count:
        raise ValueError(f'{values!r} is not a list of {count}')
    converted = tuple(map(convert, values))
    if not all(map(isfinite, converted)):
        raise ValueError(f'{values!r} is not finite')
    return converted


def _groups(record: Mapping[str, Any], name: str, groups: int, count: int,
            convert: Callable[[Any], Any] = float) -> list[tuple[Any, ...]]:
    """Return a flat list as groups of `count` values: ROS allows no nested lists."""
    flat = _numbers(record.get(name, ()), groups * count, convert)
    return [flat[start:start + count] for start in range(0, len(flat), count)]


def _integer(value: Any) -> int:
    if type(value) is not int:
        raise ValueError(f'{value!r} is not an integer')
    return value


def _flag(value: Any) -> bool:
    if type(value) is not bool:
        raise ValueError(f'{value!r}; expected true or false')
    return value


def _sign(value: Any) -> int:
    if value not in (1, -1):
        raise ValueError(f'direction {value!r}; expected 1 or -1')
    return int(value)
