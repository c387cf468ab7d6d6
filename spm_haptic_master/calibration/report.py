# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a calibration from free motion, one page of Markdown, filed with the device."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import hashlib
from math import acos, degrees, tau
from pathlib import Path

import numpy as np
from spm_haptic_master.calibration.motion.calibration import (
    MotionCalibration,
    Origin,
    rms,
    Verdict,
    zero_counts,
)
from spm_haptic_master.calibration.motion.coverage import variances
from spm_haptic_master.calibration.motion.mechanism_parameters import Array, GROUPS
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, LEG_NAMES
from spm_haptic_master.kinematics.rotations import wrapped

# Step of the parameters in the differences of the angles between axes (rad).
DIFFERENCE = 1e-6


def report_paths(output: Path) -> tuple[Path, ...]:
    """Return the files of the report beside a parameter file, the picture first."""
    return output.with_name(f'{output.stem}_parity.png'), output.with_suffix('.md')


def check_report(output: Path, force: bool) -> None:
    """Raise InputError where a file's report cannot or, without `force`, may not be written."""
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


def write_report(output: Path, verdict: Verdict) -> str:
    """
    Write the report beside the parameter file, which is complete; return what was written.

    Without matplotlib it has no picture, and says so; that of an earlier report is removed.
    InputError where the report cannot be written; nothing of it is left.
    """
    file, report = report_paths(output)
    drawn, missing = None, ''
    try:
        from spm_haptic_master.calibration import report_picture
    except InputError as error:
        missing = str(error)
        picture = f'No picture: {missing}.'
    else:
        drawn = report_picture.draw(verdict.calibration)
        picture = f'![parity]({file.name})\n\n{report_picture.CAPTION}'
    text = _text(verdict, output, picture)
    try:
        _write({file: drawn, report: text.encode()})
    except OSError as error:
        raise InputError(f'{report}: the report cannot be written: {error}; the parameter file '
                         f'{output} is complete') from error
    return f'report {report.name}' + (f' without picture: {missing}' if missing else '')


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _write(content: dict[Path, bytes | None]) -> None:
    """Write files, all or none; remove those without content."""
    try:
        for path, data in content.items():
            if data is None:
                path.unlink(missing_ok=True)
            else:
                path.write_bytes(data)
    except OSError:
        for path in content:
            if path.is_file():
                path.unlink()
        raise


def _text(verdict: Verdict, file: Path, picture: str) -> str:
    """Return one page of Markdown, with the verdict in its first line; the picture is Markdown."""
    c, origin = verdict.calibration, verdict.origin
    cautions = ''.join(f'**CAUTION**: {caution}.\n\n' for caution in c.cautions)
    return f"""\
# {verdict.text}

{verdict.reached} `fkm` publishes {100.0 * verdict.published:.2f} % of the motion with this
calibration.

{cautions}Device, serial number: ______________________ Name, signature: ______________________

{_made_from(c, origin, file)}

{_encoders(c, origin)}

Angles are in deg, ± is one standard deviation of the error that is left. Bias is the bound of the
sensor's error for {c.region.text}. All parameters are in `calibration_record` of the file.

{_mechanism(c)}

Left as drawn: {_left(c)}. What would determine more: {c.advice}.

{picture}
"""


def _made_from(c: MotionCalibration, origin: Origin, file: Path) -> str:
    readings = c.readings
    return _table(('', ''), (
        ('recording', _code(origin.recording)),
        ('SHA-256 of the recording',
         _code(origin.checksum) if origin.checksum else 'none: recorded from the bus'),
        ('date', origin.date),
        ('spm_haptic_master', origin.version),
        ('parameter file', _code(file.name)),
        ('SHA-256 of the parameter file', _code(checksum(file))),
        ('sets of readings', f'{readings.sets} in {readings.seconds[-1]:.1f} s, of which '
         f'{readings.spikes} left out as spikes and {100.0 * c.cut:.1f} % cut'),
        ('parity', f'{degrees(rms(c.parity)):.4f} deg rms, as drawn '
         f'{degrees(rms(c.parity_before)):.4f}, white noise {degrees(rms(c.readings.sigma)):.4f}'
         )))


def _encoders(c: MotionCalibration, origin: Origin) -> str:
    zeros, _ = zero_counts(c, origin.counts_per_turn)
    deviation = c.deviations[c.layout.slices['zeros']]
    angles = c.model.corrected(c.readings.readings * np.array(c.direction), c.vector)
    # Around the middle of the motion, without jumps by a turn.
    middle = np.angle(np.nanmean(np.exp(1j * angles), axis=0))
    moved = np.degrees(middle + wrapped(angles - middle))
    rows = [(joint, f'{origin.counts_per_turn[at]}', f'{c.direction[at]:+d}', f'{zeros[at]}',
             f'{deviation[at] * origin.counts_per_turn[at] / tau:.2f}',
             f'{degrees(deviation[at]):.4f}', f'{degrees(c.noise[at]):.4f}',
             f'{degrees(c.bias[at]):.4f}',
             f'{np.nanmin(moved[:, at]):.1f} to {np.nanmax(moved[:, at]):.1f}')
            for at, joint in enumerate(ALL_JOINT_NAMES[:c.layout.sensors])]
    return _table(('encoder', 'counts a turn', 'direction', 'zero count', '± counts', '± deg',
                   'noise, deg', 'bias, deg', 'moved through, deg'), rows)


def _mechanism(c: MotionCalibration) -> str:
    layout = c.layout
    built, deviation = layout.geometry(c.vector), c.deviations
    names = [f'{part} link {leg}' for part in ('proximal', 'distal') for leg in LEG_NAMES]
    rows = [_row(name, drawn, found, deviation[column], _estimated(c, (column,)))
            for name, drawn, found, column in zip(
                names, (*layout.nominal.alphas, *layout.nominal.betas),
                (*built.alphas, *built.betas), layout.columns('links'), strict=True)]
    drawn, found = _between(layout.nominal), _between(built)
    change = np.zeros((len(found), layout.count))
    for column in (*layout.columns('base axes'), *layout.columns('platform axes')):
        moved = c.vector.copy()
        moved[column] += DIFFERENCE
        change[:, column] = (_between(layout.geometry(moved)) - found) / DIFFERENCE
    angles = np.sqrt(variances(change, c.covariance))
    for at in range(len(found)):
        joint, group = ((1, 'base axes'), (3, 'platform axes'))[at // 3]
        first, second = (LEG_NAMES[(at + step) % 3] for step in (0, 1))
        columns = layout.columns(group)
        rows.append(_row(f'angle from Z{joint}{first} to Z{joint}{second}', drawn[at], found[at],
                         angles[at], _estimated(c, columns)))
    return _table(('', 'drawn, deg', 'found, deg', 'off by, deg', '±', ''), rows)


def _row(name: str, drawn: float, found: float, deviation: float, note: str) -> tuple[str, ...]:
    return (name, f'{degrees(drawn):.4f}', f'{degrees(found):.4f}',
            f'{degrees(found - drawn):+.4f}', f'{degrees(deviation):.4f}', note)


def _between(geometry: Geometry) -> Array:
    """Return the angles A to B, B to C, C to A of the base's and the platform's axes, rad."""
    return np.array([acos(min(1.0, max(-1.0, float(np.dot(axes[leg], axes[(leg + 1) % 3])))))
                     for axes in (geometry.base_axes, geometry.platform_axes)
                     for leg in range(3)])


def _left(c: MotionCalibration) -> str:
    chosen = set(c.estimated)
    reasons = [f'{group} ({reason})' for group, reason in c.left.items()]
    for group in GROUPS:
        alone = [c.layout.names[column] for column in c.layout.columns(group)
                 if column not in chosen]
        if group not in c.left and alone:
            reasons.append(f'{", ".join(alone)} (the motion does not determine them)')
    return '; '.join(reasons) or 'nothing'


def _estimated(c: MotionCalibration, columns: Iterable[int]) -> str:
    """Return a note on parameters that are not all estimated."""
    inside = [column in c.estimated for column in columns]
    return '' if all(inside) else 'partly as drawn' if any(inside) else 'as drawn'


def _code(text: str) -> str:
    """Return text as it is, in a cell of a table."""
    return f"`{text.replace('`', chr(39)).replace('|', '/')}`".replace('\n', ' ')


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = '\n'.join(f'| {" | ".join(row)} |' for row in rows)
    return f'| {" | ".join(header)} |\n|{"---|" * len(header)}\n{lines}'
