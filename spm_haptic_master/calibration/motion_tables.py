# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The text of the report of a calibration from free motion: Markdown with tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import acos, degrees, tau

import numpy as np
from spm_haptic_master.calibration.free_motion import MotionCalibration
from spm_haptic_master.calibration.mechanism_parameters import Array
from spm_haptic_master.calibration.motion_coverage import Proposal
from spm_haptic_master.calibration.motion_file import Origin, zero_counts
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.geometry_checks import LEG_NAMES

# Step of the parameters in the differences of the angles between axes (rad).
DIFFERENCE = 1e-6
# Number of further motions that are listed.
LISTED = 5
# Parities that are quoted beside the rms (percent).
PARITY_PERCENT = 95.0


@dataclass(frozen=True, slots=True)
class Picture:
    """
    A picture of the report.

    Attributes
    ----------
    file : str
        Name of the file, in the directory of the report.
    caption : str
        What it shows.

    """

    file: str
    caption: str


def report_text(calibration: MotionCalibration, origin: Origin, file: str, checksum: str,
                pictures: Mapping[str, Picture] | str) -> str:
    """
    Return the report, Markdown.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of the motion.
    origin : Origin
        Where it comes from.
    file, checksum : str
        Name and SHA-256 of the parameter file.
    pictures : mapping of str to Picture, or str
        Pictures by the names in `motion_figures.CAPTIONS`; or the reason that there are none.

    """
    c = calibration

    def picture(name: str) -> str:
        if isinstance(pictures, str):
            return ''
        return f'![{name}]({pictures[name].file})\n\n{pictures[name].caption}\n\n'

    missing = f'No pictures: {pictures}.\n\n' if isinstance(pictures, str) else ''
    return f"""\
# Calibration of {origin.date}

Device, serial number: ______________________ Name, signature: ______________________

The mechanism and its encoders, determined from free motion. All angles are in deg, and ± is one
standard deviation of the error that is left.

{missing}## What it was made from

{_made_from(c, origin, file, checksum)}

{_settings(origin)}## Quality

{_quality(c)}

A parity of 1.0 times the white noise is that of readings with nothing but noise. What is
above is systematic; `bias_deg` bounds it. The orientation errors are predicted from all
parameters, those left as drawn included, but for one rotation of the base's frame and one of the
handle's, which no motion of the device alone determines.

{picture('parity')}{picture('coverage')}## Encoders

{_encoders(c, origin)}

A zero count is the reading at joint angle 0. Noise is that of one reading, white; bias is the
bound of the systematic error.

| encoder | harmonic | cosine, deg | ± | sine, deg | ± | |
|---|---|---|---|---|---|---|
{_harmonics(c)}

{picture('harmonics')}## Mechanism

{_mechanism(c)}

Z1A, Z1B, Z1C are the motors' axes, Z3A, Z3B, Z3C those of the platform.

## What was left as drawn

{_left(c)}

{_advice(c)}

## Choice of the model

{_held_out(c)}

## All parameters

| number | parameter | value, deg | ± | |
|---|---|---|---|---|
{_parameters(c)}

{picture('correlation')}""".rstrip() + '\n'


def joint_angles(calibration: MotionCalibration) -> Array:
    """Return the joint angles of the motion without jumps by a turn, rad, shape (n, N)."""
    c = calibration
    angles = c.readings.readings * np.array(c.direction) - c.vector[c.layout.slices['zeros']]
    first, second = c.layout.harmonics(c.vector)
    angles = angles - (first[:, 0] * np.cos(angles) + first[:, 1] * np.sin(angles)
                       + second[:, 0] * np.cos(2.0 * angles)
                       + second[:, 1] * np.sin(2.0 * angles))
    middle = np.angle(np.nanmean(np.exp(1j * angles), axis=0))
    found: Array = middle + np.angle(np.exp(1j * (angles - middle)))
    return found


def further_motions(calibration: MotionCalibration) -> list[Proposal]:
    """Return the motions that would determine more, each text once, the best first."""
    found: dict[str, Proposal] = {}
    for proposal in calibration.advice:
        found.setdefault(proposal.text, proposal)
    return list(found.values())


def _made_from(c: MotionCalibration, origin: Origin, file: str, checksum: str) -> str:
    readings = c.readings
    return _table(('', ''), (
        ('recording', _code(origin.recording)),
        ('SHA-256 of the recording',
         _code(origin.checksum) if origin.checksum else 'none: recorded from the bus'),
        ('date', origin.date),
        ('spm_haptic_master', origin.version),
        ('parameter file', _code(file)),
        ('SHA-256 of the parameter file', _code(checksum)),
        ('sets of readings', f'{readings.sets}'),
        ('length', f'{readings.seconds[-1]:.1f} s'),
        ('sets left out because of a spike', f'{readings.spikes}'),
        ('means used', f'{len(readings.seconds)}, each of {readings.together} sets')))


def _settings(origin: Origin) -> str:
    if not origin.settings:
        return ''
    rows = [(_code(name), _code(str(list(value) if isinstance(value, tuple) else value)))
            for name, value in origin.settings.items()]
    return ('Settings that it rests on, beside the defaults:\n\n'
            f'{_table(("name", "value"), rows)}\n\n')


def _quality(c: MotionCalibration) -> str:
    noise = _rms(c.readings.sigma)
    rows = [(f'parity {when}, rms', f'{degrees(_rms(parity)):.4f}', f'{_rms(parity) / noise:.2f}')
            for when, parity in (('before, with zeros and directions only', c.parity_before),
                                 ('after', c.parity))]
    rows += [(f'parity after, {PARITY_PERCENT:g} % are below',
              f'{degrees(float(np.nanpercentile(np.abs(c.parity), PARITY_PERCENT))):.4f}', ''),
             ('white noise of the means, rms', f'{degrees(noise):.4f}', '1.00'),
             ('predicted orientation error, rms over the motion', f'{degrees(c.error):.4f}', ''),
             ('predicted orientation error, rms over the workspace',
              f'{degrees(c.target_error):.4f}', '')]
    return _table(('', 'deg', 'over the white noise'), rows)


def _encoders(c: MotionCalibration, origin: Origin) -> str:
    zeros, _ = zero_counts(c, origin.counts_per_turn)
    deviation = c.deviations[c.layout.slices['zeros']]
    moved = joint_angles(c)
    rows = [(joint, f'{origin.counts_per_turn[at]}', f'{c.direction[at]:+d}', f'{zeros[at]}',
             f'{deviation[at] * origin.counts_per_turn[at] / tau:.2f}',
             f'{degrees(deviation[at]):.4f}', f'{degrees(c.noise[at]):.4f}',
             f'{degrees(c.bias[at]):.4f}',
             f'{degrees(np.nanmin(moved[:, at])):.1f} to {degrees(np.nanmax(moved[:, at])):.1f}')
            for at, joint in enumerate(_joints(c))]
    return _table(('encoder', 'counts a turn', 'direction', 'zero count', '± counts', '± deg',
                   'noise, deg', 'bias, deg', 'moved through, deg'), rows)


def _harmonics(c: MotionCalibration) -> str:
    rows = []
    for at, joint in enumerate(_joints(c)):
        for order in ('first', 'second'):
            cosine = c.layout.slices[f'{order} harmonics'].start + 2 * at
            values = [f'{degrees(each):.4f}' for column in (cosine, cosine + 1)
                      for each in (c.vector[column], c.deviations[column])]
            rows.append((joint, order, *values, _estimated(c, (cosine, cosine + 1))))
    return _rows(rows)


def _mechanism(c: MotionCalibration) -> str:
    layout = c.layout
    built, deviation = layout.geometry(c.vector), c.deviations
    names = [f'{part} link {leg}' for part in ('proximal', 'distal') for leg in LEG_NAMES]
    rows = [_row(name, drawn, found, deviation[column], _estimated(c, (column,)))
            for name, drawn, found, column in zip(
                names, (*layout.nominal.alphas, *layout.nominal.betas),
                (*built.alphas, *built.betas), range(*layout.slices['links'].indices(
                    layout.count)), strict=True)]
    drawn, found = _between(layout.nominal), _between(built)
    change = np.zeros((len(found), layout.count))
    for column in range(layout.slices['base axes'].start, layout.slices['platform axes'].stop):
        moved = c.vector.copy()
        moved[column] += DIFFERENCE
        change[:, column] = (_between(layout.geometry(moved)) - found) / DIFFERENCE
    angles = np.sqrt(np.einsum('ap,pq,aq->a', change, c.covariance, change))
    for at in range(len(found)):
        joint, group = ((1, 'base axes'), (3, 'platform axes'))[at // 3]
        first, second = (LEG_NAMES[(at + step) % 3] for step in (0, 1))
        columns = range(*layout.slices[group].indices(layout.count))
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
    rows = [(group, reason) for group, reason in c.left.items()]
    chosen = set(c.estimated)
    for group, part in c.layout.slices.items():
        alone = [c.layout.names[column] for column in range(*part.indices(c.layout.count))
                 if column not in chosen]
        if group not in c.left and alone:
            rows.append((', '.join(alone), 'the motion does not determine them'))
    if not rows:
        return 'Nothing: the motion determines all parameters.'
    return _table(('parameters', 'why'), rows)


def _advice(c: MotionCalibration) -> str:
    listed = further_motions(c)[:LISTED]
    if not listed:
        return 'No further motion would determine more.'
    rows = [(motion.text, f'{motion.gain:.2f}', f'{100.0 * (1.0 - motion.gain ** -0.5):.0f} %')
            for motion in listed]
    return ('Further motions that would determine more, the best first, each of three seconds:'
            '\n\n' + _table(('motion', 'variance of the orientation error is divided by',
                             'error becomes less by'), rows))


def _held_out(c: MotionCalibration) -> str:
    if not c.held_out:
        return 'The motion is too short to hold a part of it out.'
    first = next(iter(c.held_out))
    rows = [(group if group == first else f'+ {group}', f'{degrees(rms):.4f}',
             f'{rms / _rms(c.readings.sigma):.2f}') for group, rms in c.held_out.items()]
    text = ('Parity of the third of the motion that was held out, as each group of parameters\n'
            'was added. A group is kept only where it does not make this parity worse.')
    return text + '\n\n' + _table(('model', 'parity, deg rms', 'over the white noise'), rows)


def _parameters(c: MotionCalibration) -> str:
    return _rows([(f'{column + 1}', name, f'{degrees(c.vector[column]):.4f}',
                   f'{degrees(c.deviations[column]):.4f}', _estimated(c, (column,)))
                  for column, name in enumerate(c.layout.names)])


def _estimated(c: MotionCalibration, columns: Iterable[int]) -> str:
    """Return a note on parameters that are not all estimated."""
    inside = [column in c.estimated for column in columns]
    return '' if all(inside) else 'partly as drawn' if any(inside) else 'as drawn'


def _joints(c: MotionCalibration) -> tuple[str, ...]:
    return ALL_JOINT_NAMES[:c.layout.sensors]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values ** 2)))


def _code(text: str) -> str:
    """Return text as it is, in a cell of a table."""
    return f"`{text.replace('`', chr(39)).replace('|', '/')}`".replace('\n', ' ')


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return f'| {" | ".join(header)} |\n|{"---|" * len(header)}\n{_rows(rows)}'


def _rows(rows: Iterable[Sequence[str]]) -> str:
    return '\n'.join(f'| {" | ".join(row)} |' for row in rows)
