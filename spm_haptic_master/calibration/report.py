# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a calibration from free motion, one page of Markdown, filed with the device."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import hashlib
from itertools import pairwise
from math import degrees, tau
from pathlib import Path

import numpy as np
from spm_haptic_master.calibration.calibration_file import write_bytes, write_text
from spm_haptic_master.calibration.motion.calibration import MotionCalibration, rms
from spm_haptic_master.calibration.motion.coverage import around_middle, variances
from spm_haptic_master.calibration.motion.model import Array, GROUPS
from spm_haptic_master.calibration.motion.motion_file import (
    Checked,
    Origin,
    Verdict,
    zero_counts,
)
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, LEG_NAMES

# Step of the parameters in the differences of the angles between axes (rad).
DIFFERENCE = 1e-6


def report_paths(output: Path) -> tuple[Path, Path]:
    """
    Return the files of the report beside a parameter file.

    Parameters
    ----------
    output : Path
        The parameter file.

    Returns
    -------
    tuple of 2 Path
        Picture (PNG) and text (Markdown).

    Raises
    ------
    InputError
        The parameter file has the name of one of them.

    """
    found = output.with_name(f'{output.stem}_parity.png'), output.with_suffix('.md')
    if output in found:
        raise InputError(
            f'-o {output}: the report is written there; expected another name, as '
            f'{output.with_suffix(".yaml").name}'
        )
    return found


def write_report(output: Path, verdict: Verdict) -> str:
    """
    Write the report beside the parameter file.

    Without matplotlib it has no picture, and says so; that of an earlier report is removed.

    Parameters
    ----------
    output : Path
        The parameter file, which is complete: the report has its checksum.
    verdict : Verdict
        The calibration, and what it is good for.

    Returns
    -------
    str
        A text that names the report.

    Raises
    ------
    InputError
        A file cannot be written.

    """
    file, report = report_paths(output)
    missing = ''
    try:
        from spm_haptic_master.calibration import report_picture
    except InputError as error:
        missing = f' without picture: {error}'
        picture = f'No picture: {error}.'
        file.unlink(missing_ok=True)
    else:
        picture = f'![parity]({file.name})\n\n{report_picture.CAPTION}'
        write_bytes(file, report_picture.draw(verdict.calibration))
    write_text(report, _text(verdict, output, picture))
    return f'report {report.name}{missing}'


def checksum(path: Path) -> str:
    """
    Return the SHA-256 of a file.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    str
        64 hexadecimal digits.

    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _text(
    verdict: Verdict,
    file: Path,
    picture: str,
) -> str:
    """
    Return the report, one page of Markdown with the verdict in its first line.

    Parameters
    ----------
    verdict : Verdict
        The calibration, and what it is good for.
    file : Path
        The parameter file.
    picture : str
        The picture or the reason why there is none, as Markdown.

    Returns
    -------
    str
        The text of the report.

    """
    c = verdict.calibration
    origin = verdict.origin
    checked = verdict.checked
    cautions = ''.join(f'**CAUTION**: {caution}.\n\n' for caution in verdict.cautions)
    return f"""\
# {verdict.text}

{verdict.reached} `fkm` publishes {100.0 * verdict.published:.2f} % of the motion with this
calibration.

{cautions}Device, serial number: ______________________ Name, signature: ______________________

{_made_from(c, origin, file)}

{_encoders(verdict)}

Angles are in deg, ± is one standard deviation of the error that is left. Bias is the bound of the
sensor's error for {c.region.text}; together these
errors move the parity by {degrees(c.parity_bias):.3f} deg at most. {_checked_text(checked)}
All parameters are in `calibration_record` of the file.

{_mechanism(c)}

Left as drawn: {_left(c)}. What would determine more: {c.advice}.

{picture}
"""


def _checked_text(checked: Checked) -> str:
    """Return what the column `checked` of the table of encoders means."""
    return (
        'Checked is the share of that\nregion in which the other encoders check this one with '
        f'`alert_limit_deg` {checked.alert_limit_deg:g}; from\n'
        f'{checked.least_limit_deg:.2f} on all '
        'are checked somewhere.'
    )


def _made_from(
    c: MotionCalibration,
    origin: Origin,
    file: Path,
) -> str:
    """Return the table of what the calibration was made from: recording, checksums, parity."""
    return _table(
        ('', ''),
        (
            ('recording', _code(origin.recording)),
            (
                'SHA-256 of the recording',
                _code(origin.checksum) if origin.checksum else 'none: recorded from the bus',
            ),
            ('date', origin.date),
            ('spm_haptic_master', origin.version),
            ('parameter file', _code(file.name)),
            ('SHA-256 of the parameter file', _code(checksum(file))),
            (
                'sets of readings',
                f'{c.readings.sets} in {c.readings.seconds[-1]:.1f} s, of which '
                f'{c.readings.spikes} left out as spikes and {100.0 * c.cut:.1f} % cut',
            ),
            (
                'parity',
                f'{degrees(rms(c.parity)):.4f} deg rms, as drawn '
                f'{degrees(rms(c.parity_before)):.4f}, white noise '
                f'{degrees(rms(c.readings.sigma)):.4f}',
            ),
        ),
    )


def _encoders(verdict: Verdict) -> str:
    """
    Return the table of the encoders, a row each.

    It has zero count and direction, the standard deviation of the zero, noise and bias, the share
    of the region where the other sensors check this one, and the angles that the motion went
    through.
    """
    c = verdict.calibration
    origin = verdict.origin
    checked = verdict.checked
    zeros, _ = zero_counts(c, origin.counts_per_turn)
    deviation = c.deviations[c.layout.slices['zeros']]
    angles = c.model.corrected(c.turned, c.vector)
    moved = np.degrees([around_middle(angle) for angle in angles.T])
    rows = [
        (
            joint,
            f'{origin.counts_per_turn[at]}',
            f'{c.direction[at]:+d}',
            f'{zeros[at]}',
            f'{deviation[at] * origin.counts_per_turn[at] / tau:.2f}',
            f'{degrees(deviation[at]):.4f}',
            f'{degrees(c.noise[at]):.4f}',
            f'{degrees(c.bias[at]):.4f}',
            f'{100.0 * checked.share[at]:.0f} %',
            f'{np.nanmin(moved[at]):.1f} to {np.nanmax(moved[at]):.1f}',
        )
        for at, joint in enumerate(ALL_JOINT_NAMES[: c.layout.sensors])
    ]
    return _table(
        (
            'encoder',
            'counts a turn',
            'direction',
            'zero count',
            '± counts',
            '± deg',
            'noise, deg',
            'bias, deg',
            'checked',
            'moved through, deg',
        ),
        rows,
    )


def _mechanism(c: MotionCalibration) -> str:
    """
    Return the table of the link angles and of the angles between axes, as drawn and as found.

    The standard deviation of an angle between two axes follows from the covariance of the
    parameters by forward differences.
    """
    layout = c.layout
    links, base, platform = map(layout.columns, ('links', 'base axes', 'platform axes'))
    names = [
        *(layout.names[column] for column in links),
        *(
            f'angle from Z{joint}{first} to Z{joint}{second}'
            for joint in (1, 3)
            for first, second in pairwise((*LEG_NAMES, LEG_NAMES[0]))
        ),
    ]
    # Of each angle, the parameters that it depends on.
    columns = [*((column,) for column in links), *[base] * 3, *[platform] * 3]
    drawn = _angles(layout.nominal)
    found = _angles(layout.geometry(c.vector))
    change = np.zeros((len(found), layout.count))
    for column in range(links.start, platform.stop):
        moved = c.vector.copy()
        moved[column] += DIFFERENCE
        change[:, column] = (_angles(layout.geometry(moved)) - found) / DIFFERENCE
    deviations = np.sqrt(variances(change, c.covariance))
    figures = np.degrees([drawn, found, found - drawn, deviations])
    return _table(
        ('', 'drawn, deg', 'found, deg', 'off by, deg', '±', ''),
        [
            (name, f'{of[0]:.4f}', f'{of[1]:.4f}', f'{of[2]:+.4f}', f'{of[3]:.4f}', _note(c, by))
            for name, of, by in zip(
                names,
                figures.T,
                columns,
                strict=True,
            )
        ],
    )


def _angles(geometry: Geometry) -> Array:
    """
    Return the angles of a mechanism that a drawing has.

    Returns
    -------
    ndarray, shape (12,)
        The proximal and distal link angles of the legs A, B, C, then the angles A to B, B to C, C
        to A of the base axes and of the platform axes, rad.

    """
    axes = np.array([geometry.base_axes, geometry.platform_axes])
    following = np.roll(axes, -1, axis=1)
    cosines = (axes * following).sum(axis=2)
    between = np.arccos(np.clip(cosines, -1.0, 1.0))
    return np.concatenate([geometry.alphas, geometry.betas, between.ravel()])


def _note(c: MotionCalibration, columns: Iterable[int]) -> str:
    """Return a note on parameters that are not all estimated; empty if all are."""
    left = set(columns).difference(c.estimated)
    if not left:
        return ''
    return 'partly as drawn' if left < set(columns) else 'as drawn'


def _left(c: MotionCalibration) -> str:
    """Return which groups and parameters were left as drawn, and why, in words."""
    reasons = [f'{group} ({reason})' for group, reason in c.left.items()]
    for group in GROUPS:
        alone = [
            c.layout.names[column]
            for column in c.layout.columns(group)
            if column not in c.estimated
        ]
        if group not in c.left and alone:
            reasons.append(f'{", ".join(alone)} (the motion does not determine them)')
    return '; '.join(reasons) or 'nothing'


def _code(text: str) -> str:
    """Return a text in a cell of a table as code, without the characters that would end it."""
    return f'`{text.replace("`", chr(39)).replace("|", "/")}`'.replace('\n', ' ')


def _table(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
) -> str:
    """Return a table as Markdown."""
    lines = '\n'.join(f'| {" | ".join(row)} |' for row in rows)
    return f'| {" | ".join(header)} |\n|{"---|" * len(header)}\n{lines}'
