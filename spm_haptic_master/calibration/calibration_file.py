# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A calibration on disk: a ROS parameter file for all nodes, with a record for calibrate."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import degrees, isfinite, radians
import os
from pathlib import Path
from typing import Any

from spm_haptic_master.calibration.jig import Calibration, Station
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.parameters.encoders import sensors_of
from spm_haptic_master.parameters.files import PARAMETERS
import yaml

# Name of the section with calibrate's own record: no node has it, so that ROS ignores the section.
RECORD = 'calibration_record'
# No line is folded: a value stays on its line.
LONGEST_LINE = 1_000_000
# What a value of the file has to be, by its type.
EXPECTED = {int: 'an integer', float: 'a number', bool: 'true or false'}


def file_text(header: Iterable[str], parameters: Mapping[str, Any],
              record: Mapping[str, Any]) -> str:
    """Return a parameter file: lines of a comment, values by dotted name, record for calibrate."""
    tree = {'/**': {PARAMETERS: _nested(parameters)}, RECORD: {PARAMETERS: _nested(record)}}
    return ''.join(f'# {ascii(line)[1:-1]}\n' for line in header) + yaml.dump(
        tree, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=LONGEST_LINE)


class _Dumper(yaml.SafeDumper):
    """`yaml.safe_dump` with quotes around each text that is a value, and lists on one line."""


class _Text(str):
    """A text that is quoted in the file: without quotes 1e5 and y would be read in two ways."""


_Dumper.add_representer(_Text, lambda dumper, text: dumper.represent_scalar(
    'tag:yaml.org,2002:str', str(text), style='"'))
_Dumper.add_representer(list, lambda dumper, values: dumper.represent_sequence(
    'tag:yaml.org,2002:seq', values, flow_style=True))


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by dotted name as mappings within each other."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *groups, last = name.split('.')
        at = tree
        for group in groups:
            at = at.setdefault(group, {})
        at[last] = [*map(_plain, value)] if isinstance(value, (tuple, list)) else _plain(value)
    return tree


def _plain(value: Any) -> Any:
    return _Text(value) if isinstance(value, str) else value


def calibration_text(calibration: Calibration, mechanism: Mapping[str, Any]) -> str:
    """Return a jig's parameter file, with the mechanism's values that are not the defaults."""
    c = calibration
    joints = ALL_JOINT_NAMES[:len(c.zero_count)]
    unverified = [joint for joint, known in zip(joints, c.direction_verified, strict=True)
                  if not known]
    directions = 'All directions verified, by two poses.' if not unverified else (
        f'Direction as configured, NOT verified: {", ".join(unverified)}. The driver refuses it; '
        'calibrate at a second pose determines it.')
    stations = c.stations
    return file_text(
        (f'Calibration of {c.date}, a parameter file for all nodes: --params-file.', directions),
        {'calibration': f'jig, {c.date}', **sensors_entry(joints),
         'sigma_deg': rounded(c.sigma), 'bias_deg': rounded(c.bias),
         'encoders.counts_per_turn': c.counts_per_turn, 'encoders.direction': c.direction,
         'encoders.direction_verified': c.direction_verified,
         'encoders.zero_count': c.zero_count, **mechanism},
        {'method': 'jig', 'date': c.date,
         'poses_deg': rounded(_chained(s.pose for s in stations)),
         'angles_deg': rounded(_chained(s.angles for s in stations)),
         'mean_counts': [round(each, 3) for each in _chained(s.counts for s in stations)],
         'noise_deg': rounded(_chained(s.sigma for s in stations)),
         'sets': [s.sets for s in stations]})


def sensors_entry(joints: Sequence[str]) -> dict[str, int]:
    """Return the parameter `sensors` where it is not the default."""
    return {} if tuple(joints) == JOINT_NAMES else {'sensors': len(joints)}


def rounded(angles: Iterable[float], digits: int = 6) -> list[float]:
    """Return angles in rad as degrees, as the file has them."""
    return [round(degrees(angle), digits) for angle in angles]


def read_calibration(path: Path) -> Calibration:
    """Read a file that calibrate wrote; InputError where it cannot be read or is another one."""
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        record = content[RECORD]['ros__parameters']
        parameters = content['/**']['ros__parameters']
        encoders = parameters['encoders']
        n = sensors_of(parameters)
        sets = record.get('sets', [])  # a calibration from free motion has no poses

        def groups(name: str, count: int) -> list[tuple[float, ...]]:
            """Return a flat list as groups of `count` values: ROS allows no nested lists."""
            flat = _values(record.get(name, []), len(sets) * count, float)
            if name.endswith('_deg'):
                flat = tuple(map(radians, flat))
            return [flat[start:start + count] for start in range(0, len(flat), count)]

        stations = tuple(map(Station, groups('poses_deg', 3), groups('angles_deg', n),
                             groups('mean_counts', n), groups('noise_deg', n),
                             _values(sets, len(sets), int)))
        direction = _values(encoders['direction'], n, int)
        for sign in direction:
            if sign not in (1, -1):
                raise ValueError(f'direction {sign}; expected 1 or -1')
        return Calibration(
            str(record['date']), stations, direction, _values(encoders['zero_count'], n, int),
            _values(encoders['counts_per_turn'], n, int),
            _values(encoders['direction_verified'], n, bool),
            tuple(map(radians, _values(parameters['bias_deg'], n, float))))
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError) as error:
        raise InputError(f'{path}: not a calibration that calibrate wrote: '
                         f'{type(error).__name__}: {error}') from error


def check_output(path: Path, force: bool) -> None:
    """Raise InputError where no calibration can or, without `force`, may be written."""
    if path.is_file() and not force:
        raise InputError(f'-o {path}: it already exists; expected --force to overwrite it, or '
                         '--motion --check to compare a motion with it')
    if not path.parent.is_dir():
        raise InputError(f'-o {path}; expected a file in an existing directory')
    if path.exists() and not path.is_file():
        raise InputError(f'-o {path}; expected a regular file, or none')
    beside = path.with_name(path.name + '.new')
    try:
        beside.touch()
        beside.unlink()
    except OSError as error:
        raise InputError(f'-o {path}: cannot be written: {error}') from error


def write_text(path: Path, text: str) -> None:
    """Write a text file, completely or not at all; InputError where it cannot be written."""
    beside = path.with_name(path.name + '.new')
    try:
        beside.write_text(text, encoding='utf-8')
        os.replace(beside, path)
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error


def _chained(groups: Iterable[Sequence[float]]) -> list[float]:
    return [value for group in groups for value in group]


def _values(values: Any, count: int, kind: type) -> tuple[Any, ...]:
    """Return a list of numbers or flags as a tuple; ValueError where it is none."""
    if not isinstance(values, list) or len(values) != count:
        raise ValueError(f'{values!r} is not a list of {count}')
    for value in values:
        if type(value) is not kind and (kind, type(value)) != (float, int):
            raise ValueError(f'{value!r}; expected {EXPECTED[kind]}')
    if not all(map(isfinite, values)):
        raise ValueError(f'{values!r} is not finite')
    return tuple(values)
