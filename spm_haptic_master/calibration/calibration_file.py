# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A calibration on disk: a ROS parameter file for all nodes, with a record for calibrate."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from math import degrees, inf
import os
from pathlib import Path
from typing import Any

import numpy as np
from spm_haptic_master.calibration.jig import Calibration, Station
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.parameters.encoders import sensors_of
from spm_haptic_master.parameters.files import PARAMETERS, read_sections
from spm_haptic_master.parameters.setting import Setting
import yaml

# Name of the section with calibrate's own record: no node has it, so that ROS ignores the section.
RECORD = 'calibration_record'


def file_text(
    header: Iterable[str],
    parameters: Mapping[str, Any],
    record: Mapping[str, Any],
) -> str:
    """
    Return the text of a calibration file.

    The parameters are those of all nodes (section `/**`); the record is a section of no node,
    which ROS ignores and calibrate reads back.

    Parameters
    ----------
    header : iterable of str
        Lines of a comment at the beginning; characters beyond ASCII are written as escapes.
    parameters : mapping of str to object
        Values by dotted name.
    record : mapping of str to object
        What calibrate needs to know of the calibration, by name.

    Returns
    -------
    str
        A ROS parameter file, YAML.

    """
    return sections_text(header, {'/**': parameters, RECORD: record})


def sections_text(
    header: Iterable[str],
    sections: Mapping[str, Mapping[str, Any]],
) -> str:
    """
    Return the text of a ROS parameter file.

    Parameters
    ----------
    header : iterable of str
        Lines of a comment at the beginning; characters beyond ASCII are written as escapes.
    sections : mapping of str to mapping of str to object
        Values by dotted name, by the node or the pattern of nodes that they are for.

    Returns
    -------
    str
        YAML with each text quoted and each list on one line.

    """
    tree = {
        nodes if '*' in nodes else nodes.removeprefix('/'): {PARAMETERS: _nested(values)}
        for nodes, values in sections.items()
    }
    return ''.join(f'# {ascii(line)[1:-1]}\n' for line in header) + yaml.dump(
        tree,
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=False,
        width=inf,
    )


class _Dumper(yaml.SafeDumper):
    """`yaml.safe_dump` with quotes around each text that is a value, and lists on one line."""


class _Text(str):
    """A text that is quoted in the file: without quotes 1e5 and y would be read in two ways."""


_Dumper.add_representer(
    _Text,
    lambda dumper, text: dumper.represent_scalar('tag:yaml.org,2002:str', str(text), style='"'),
)
_Dumper.add_representer(
    list,
    lambda dumper, values: dumper.represent_sequence(
        'tag:yaml.org,2002:seq',
        values,
        flow_style=True,
    ),
)


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by dotted name as mappings within each other."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *groups, last = name.split('.')
        at = tree
        for group in groups:
            at = at.setdefault(group, {})
        if isinstance(value, (tuple, list)):
            at[last] = [*map(_quoted, value)]
        else:
            at[last] = _quoted(value)
    return tree


def _quoted(value: Any) -> Any:
    """Return a text as one that is quoted in the file, other values as they are."""
    if isinstance(value, str):
        return _Text(value)
    return value


def calibration_text(
    calibration: Calibration,
    mechanism: Mapping[str, Any],
) -> str:
    """
    Return the parameter file of a calibration in a jig.

    Parameters
    ----------
    calibration : Calibration
        Zeros, directions, noise and bias, with the readings at each pose.
    mechanism : mapping of str to object
        Parameters of mechanism and harmonics that the calibration rests on, by name; without those
        that have their default.

    Returns
    -------
    str
        Text of the file. A comment in it names the joints whose direction is not verified.

    """
    c = calibration
    joints = ALL_JOINT_NAMES[: len(c.zero_count)]
    unverified = [
        joint for joint, known in zip(joints, c.direction_verified, strict=True) if not known
    ]
    if not unverified:
        directions = 'All directions verified, by two poses.'
    else:
        directions = (
            f'Direction as configured, NOT verified: {", ".join(unverified)}. The driver '
            'refuses it; '
            'calibrate at a second pose determines it.'
        )
    stations = c.stations
    return file_text(
        (f'Calibration of {c.date}, a parameter file for all nodes: --params-file.', directions),
        {
            'calibration': f'jig, {c.date}',
            **sensors_entry(joints),
            'sigma_deg': rounded(c.sigma),
            'bias_deg': rounded(c.bias),
            'encoders.counts_per_turn': c.counts_per_turn,
            'encoders.direction': c.direction,
            'encoders.direction_verified': c.direction_verified,
            'encoders.zero_count': c.zero_count,
            **mechanism,
        },
        {
            'method': 'jig',
            'date': c.date,
            'poses_deg': rounded(chain.from_iterable(s.pose for s in stations)),
            'angles_deg': rounded(chain.from_iterable(s.angles for s in stations)),
            'mean_counts': [round(each, 3) for s in stations for each in s.counts],
            'noise_deg': rounded(chain.from_iterable(s.sigma for s in stations)),
            'sets': [s.sets for s in stations],
        },
    )


def sensors_entry(joints: Sequence[str]) -> dict[str, int]:
    """
    Return the parameter `sensors` where it is not the default.

    Parameters
    ----------
    joints : sequence of str
        Names of the calibrated joints.

    Returns
    -------
    dict of str to int
        Empty for the four sensors of the default.

    """
    if tuple(joints) == JOINT_NAMES:
        return {}
    return {'sensors': len(joints)}


def rounded(
    angles: Iterable[float],
    digits: int = 6,
) -> list[float]:
    """
    Return angles in rad as degrees, rounded as the file has them.

    Parameters
    ----------
    angles : iterable of float
        Angles, rad.
    digits : int, optional
        Decimal places.

    Returns
    -------
    list of float
        Angles, deg.

    """
    return [round(degrees(angle), digits) for angle in angles]


def read_calibration(path: Path) -> Calibration:
    """
    Read a calibration from a file that calibrate wrote.

    The parameters and the record are read. A calibration from free motion has no poses of a jig:
    its `stations` are empty.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    Calibration
        Angles in rad.

    Raises
    ------
    InputError
        The file cannot be read, or lacks a value that calibrate writes, or has another type or
        number of values.

    """
    record = _Record(
        {
            name: value
            for section in read_sections(path)
            if section.nodes in ('/**', f'/{RECORD}')
            for name, value in section.values.items()
        }
    )
    try:
        n = sensors_of(record.found)
        return Calibration(
            date=record.value('date', str),
            stations=record.stations(n),
            direction=record.value(
                'encoders.direction',
                int,
                n,
                (1, -1),
            ),
            zero_count=record.value('encoders.zero_count', int, n),
            counts_per_turn=record.value('encoders.counts_per_turn', int, n),
            direction_verified=record.value('encoders.direction_verified', bool, n),
            bias=tuple(np.radians(record.value('bias_deg', float, n)).tolist()),
        )
    except SettingError as error:
        raise InputError(f'{path}: not a calibration that calibrate wrote: {error}') from error


@dataclass(frozen=True, slots=True)
class _Record:
    """
    What a file of calibrate has.

    Attributes
    ----------
    found : dict of str to object
        Its values, by dotted name.

    """

    found: dict[str, Any]

    def value(
        self,
        name: str,
        kind: type,
        count: int | None = None,
        allowed: tuple[int, ...] = (),
    ) -> Any:
        """Return a value of the file after the checks that a setting of this type has."""
        return Setting(
            name=name,
            kind=kind,
            description='',
            allowed=allowed,
            count=count,
        ).check(self.found.get(name))

    def stations(self, sensors: int) -> tuple[Station, ...]:
        """Return the readings at the poses of a jig; a calibration from free motion has none."""
        poses = len(np.atleast_1d(self.found.get('sets', ())))
        if not poses:
            return ()
        return tuple(
            map(
                Station,
                self._of_poses('poses_deg', poses, 3),
                self._of_poses('angles_deg', poses, sensors),
                self._of_poses('mean_counts', poses, sensors),
                self._of_poses('noise_deg', poses, sensors),
                self.value('sets', int, poses),
            )
        )

    def _of_poses(
        self,
        name: str,
        poses: int,
        count: int,
    ) -> list[tuple[float, ...]]:
        """Return the values of each pose, degrees in rad: ROS allows no lists in lists."""
        rows = np.reshape(self.value(name, float, poses * count), (poses, count))
        if name.endswith('_deg'):
            rows = np.radians(rows)
        return [tuple(row) for row in rows.tolist()]


def check_output(path: Path, force: bool) -> None:
    """
    Check, before anything is recorded, that a file can be written.

    Parameters
    ----------
    path : Path
        The file that is to be written.
    force : bool
        Whether an existing file may be overwritten.

    Raises
    ------
    InputError
        The file exists without `force`, is no regular file, or its directory does not exist or is
        not writable.

    """
    try:
        _check_place(path, force)
        beside = path.with_name(path.name + '.new')
        beside.touch()
        beside.unlink()
    except OSError as error:
        raise InputError(f'-o: {path} cannot be written: {error}') from error


def _check_place(path: Path, force: bool) -> None:
    """Raise InputError where a file may not be written; OSError for a name that cannot be one."""
    if path.is_file() and not force:
        raise InputError(
            f'-o: {path} already exists; expected --force to overwrite it, or '
            '--motion --check to compare a motion with a calibration'
        )
    if not path.parent.is_dir():
        raise InputError(f'-o {path}; expected a file in an existing directory')
    if path.exists() and not path.is_file():
        raise InputError(f'-o: {path} exists; expected a regular file, or none')


def write_text(path: Path, text: str) -> None:
    """
    Write a text file in UTF-8, completely or not at all.

    Parameters
    ----------
    path : Path
        The file.
    text : str
        Its content.

    Raises
    ------
    InputError
        The file cannot be written.

    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """
    Write a file, completely or not at all.

    The content goes to a file beside it, which then takes its name: a reader never sees a part.

    Parameters
    ----------
    path : Path
        The file.
    content : bytes
        Its content.

    Raises
    ------
    InputError
        The file cannot be written.

    """
    beside = path.with_name(path.name + '.new')
    try:
        beside.write_bytes(content)
        os.replace(beside, path)
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error
