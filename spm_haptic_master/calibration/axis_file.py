# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of insertion and gripper in a calibration file, beside all that it has."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spm_haptic_master.calibration import calibration_file
from spm_haptic_master.calibration.axis_ends import AxisCalibration
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.axes import AXES, INSERTION
from spm_haptic_master.parameters.files import read_sections

# Section of the parameters of all nodes.
ALL_NODES = '/**'


def axis_parameters(path: Path, *axes: str) -> dict[str, Any]:
    """
    Return the parameters of axes in a calibration file.

    Parameters
    ----------
    path : Path
        The file; it need not exist.
    *axes : str
        Names of the axes; by default all.

    Returns
    -------
    dict
        By dotted name, those for all nodes; empty without the file.

    """
    if not path.exists():
        return {}
    prefixes = tuple(f'{axis}.' for axis in axes or AXES)
    return {
        name: value
        for section in read_sections(path)
        if section.nodes == ALL_NODES
        for name, value in section.values.items()
        if name.startswith(prefixes)
    }


def read_axis(
    path: Path,
    axis: str,
    counts_per_turn: int,
) -> AxisCalibration:
    """
    Return the calibration of an axis in a file.

    Parameters
    ----------
    path : Path
        The file.
    axis : str
        Name of the axis, `insertion` or `gripper`.
    counts_per_turn : int
        Counts of the gripper's encoder in a turn; the scale of the slide is in the file.

    Returns
    -------
    AxisCalibration
        The calibration.

    Raises
    ------
    InputError
        The file has no calibration of the axis.

    """
    found = axis_parameters(path, axis)
    scale = 'counts_per_metre' if axis == INSERTION else None
    limits = f'{axis}.{"range" if axis == INSERTION else "range_deg"}'
    needed = [f'{axis}.zero_count', f'{axis}.direction', limits]
    needed += [f'{axis}.{scale}'] if scale else []
    if missing := [name for name in needed if name not in found]:
        raise InputError(
            f'{path}: no {", ".join(missing)}; expected what calibrate --{axis} wrote'
        )
    return AxisCalibration(
        axis=axis,
        zero_count=found[f'{axis}.zero_count'],
        direction=found[f'{axis}.direction'],
        counts_per_unit=found[f'{axis}.{scale}'] if scale else counts_per_turn / 360.0,
        range=tuple(found[limits]),
    )


def extended_text(
    path: Path,
    note: str,
    date: str,
    parameters: Mapping[str, Any],
) -> str:
    """
    Return the text of a calibration file with further parameters for all nodes.

    Its other parameters, its sections and its lines of comment stay; without a file these
    parameters are all.

    Parameters
    ----------
    path : Path
        The file to extend; it need not exist.
    note : str
        Begin of one more line of comment, which takes the place of one that begins so.
    date : str
        The rest of that line.
    parameters : mapping of str to object
        Values to add or to replace, by dotted name.

    Returns
    -------
    str
        The text of the extended file.

    Raises
    ------
    InputError
        The file is not a parameter file.

    """
    comments: list[str] = []
    sections: dict[str, dict[str, Any]] = {ALL_NODES: {}}
    if path.exists():
        sections |= {section.nodes: section.values for section in read_sections(path)}
        lines = map(str.strip, path.read_text(encoding='utf-8-sig').splitlines())
        comments = [line.lstrip('# ') for line in lines if line.startswith('#')]
    sections[ALL_NODES] = {**sections[ALL_NODES], **parameters}
    kept = [comment for comment in comments if not comment.startswith(note)]
    return calibration_file.sections_text([*kept, f'{note} {date}'], sections)
