# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a calibration from free motion, which is filed with the device."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from spm_haptic_master.calibration.motion.calibration import MotionCalibration
from spm_haptic_master.calibration.motion.file import Origin, Verdict
from spm_haptic_master.calibration.report.tables import report_text
from spm_haptic_master.exceptions import InputError


def report_paths(output: Path) -> tuple[Path, ...]:
    """
    Return the files of the report beside a parameter file, the picture first.

    Parameters
    ----------
    output : Path
        The parameter file.

    """
    return output.with_name(f'{output.stem}_parity.png'), output.with_suffix('.md')


def check_report(output: Path, force: bool) -> None:
    """
    Raise InputError where the report cannot go or replaces what it may not.

    Parameters
    ----------
    output : Path
        The parameter file.
    force : bool
        Whether files of an earlier report may be replaced.

    """
    if output in report_paths(output):
        raise InputError(f'-o {output}: the report is written there; expected another name, as '
                         f"{output.with_suffix('.yaml').name}")
    for path in report_paths(output):
        if path.exists() and not path.is_file():
            raise InputError(f'{path}: the report is written there; expected a regular file, or '
                             'none')
        if path.exists() and not force:
            raise InputError(f'{path}: the report is written there, and it already exists; '
                             'expected --force to overwrite it')


def write_report(output: Path, calibration: MotionCalibration, origin: Origin,
                 verdict: Verdict) -> str:
    """
    Write the report beside the parameter file; return what was written, in words.

    Without matplotlib it has no picture, and says so; that of an earlier report is removed.

    Parameters
    ----------
    output : Path
        The parameter file, which is complete.
    calibration : MotionCalibration
        Result of the motion.
    origin : Origin
        Where it comes from.
    verdict : Verdict
        What it is good for.

    Raises
    ------
    InputError
        The report cannot be written; nothing of it is left.

    """
    file, report = report_paths(output)
    try:
        checksum = hashlib.sha256(output.read_bytes()).hexdigest()
        drawn, missing = None, ''
        try:
            from spm_haptic_master.calibration.report import figures
        except InputError as error:
            missing = str(error)
            picture = f'No picture: {missing}.'
        else:
            drawn = figures.draw(calibration)
            picture = f'![parity]({file.name})\n\n{figures.CAPTION}'
        text = report_text(calibration, origin, verdict, output.name, checksum, picture)
        _write({file: drawn, report: text.encode()})
    except OSError as error:
        raise InputError(f'{report}: the report cannot be written: {error}; the parameter file '
                         f'{output} is complete') from error
    return f'report {report.name}' + (f' without picture: {missing}' if missing else '')


def _write(content: dict[Path, bytes | None]) -> None:
    """Write files, all or none; remove those without content."""
    beside = {path: path.with_name(path.name + '.new') for path in content}
    done: list[Path] = []
    try:
        for path, data in content.items():
            if data is not None:
                done.append(beside[path])
                beside[path].write_bytes(data)
        for path, data in content.items():
            if data is None:
                path.unlink(missing_ok=True)
            else:
                done.append(path)
                os.replace(beside[path], path)
    except OSError:
        for path in done:
            if path.is_file():
                path.unlink()
        raise
