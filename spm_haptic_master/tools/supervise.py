# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs a recording through the supervision of fkm, and proposes noise and nominal bias from it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import closing
from math import ceil, degrees
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.parameters.arguments import Parser
from spm_haptic_master.parameters.fkm import FKM_SETTINGS, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.nodes import DRIVER_NAMES, SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import DRIVER
from spm_haptic_master.parameters.setting import SENSORS_SETTING, Values
from spm_haptic_master.simulation.source_factory import make_replay
from spm_haptic_master.supervision import recording
from spm_haptic_master.supervision.recording import Supervised
from spm_haptic_master.supervision.symptom import with_remedy
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.command_line import ProgressBar
from spm_haptic_master.validation import bags, parity_map, recordings

DESCRIPTION = """\
Runs recorded joint angles through the supervision of fkm, with the same parameters, and reports
the share of orientations published, the parity by region of the workspace, and the sigma_deg and
bias_deg that the recording supports; no bias_deg below the given one. RECORDING is a log of the
CAN bus (decoded with the parameters of the encoder driver), a directory of recorder, a rosbag2 or
a CSV file with measured_js. Writes supervise.png and regions.csv."""
# Unit that a proposed nominal bias is rounded up to (deg).
BIAS_UNIT = 0.01
# Number of reasons that are printed.
REASONS = 8


@command_line.program('supervise')
def main(args: list[str]) -> int:
    """Supervise a recording; 1 if it is not as expected."""
    options = _parser().parse(args)
    # matplotlib is an extra: report that it is missing before anything is computed.
    from spm_haptic_master.tools import supervision_figure

    given = command_line.given(
        options, (DRIVER, 'fkm'), DRIVER_NAMES | {setting.name for setting in FKM_SETTINGS}
    )
    stamps, angles, left_out = _read(options, given)
    sensors = angles.shape[1]
    values = command_line.checked({SENSORS_SETTING.name: sensors} | given, FKM_SETTINGS)
    if values[SENSORS_SETTING.name] != sensors:
        raise SettingError(
            SENSORS_SETTING.name,
            values[SENSORS_SETTING.name],
            f'{sensors}, as {options.recording} has',
        )
    n = len(stamps)
    with ProgressBar('supervise') as bar:
        result = recording.run(
            stamps, angles, values, lambda done: bar.show(f'{done} of {n} samples', done / n)
        )
    found = parity_map.parity_map(
        angles, sigma_from(values), geometry_from(values), values['working_mode']
    )
    table = parity_map.regions(found, result.published, result.protection_level)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        parity_map.write_regions(options.output / 'regions.csv', table)
    except OSError as error:
        raise InputError(f'{options.output}: cannot be written: {error}') from error
    seconds = (stamps - stamps[0]) * 1e-9
    supervision_figure.draw(
        options.output / 'supervise.png', seconds, found, result, values['alert_limit_deg']
    )
    _report_gaps(angles, left_out)
    _report(seconds, result, table)
    _propose(stamps, angles, table, values)
    print(f'{options.output}: supervise.png, regions.csv')
    return 0


def _parser() -> Parser:
    parser = Parser('supervise', DESCRIPTION)
    parser.add_argument(
        'recording',
        type=Path,
        metavar='RECORDING',
        help='log of the CAN bus, directory of recorder, rosbag2 (directory or file) or CSV',
    )
    parser.add_argument(
        '--topic',
        default='measured_js',
        help='topic of the joint angles in a rosbag2 (default: measured_js)',
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        default=Path('supervision'),
        metavar='DIR',
        help='directory for picture and table (default: supervision)',
    )
    return parser


def _read(
    options: argparse.Namespace, given: dict[str, object]
) -> tuple[NDArray[np.int64], NDArray[np.float64], int]:
    """Return the stamps, ns, the joint angles, rad, and how many rows have too few of them."""
    path = options.recording
    if (
        path.is_dir()
        or path.suffix in bags.STORAGE_SUFFIXES
        or path.suffix == '.csv'
        and not _is_can_log(path)
    ):
        track = recordings.read_joints(path, options.topic)
        if track is None:
            raise InputError(f'{path}: nothing on topic {options.topic}')
        return np.round(track.time * 1e9).astype(np.int64), track.values, track.left_out
    values = command_line.checked(
        given | {'replay.path': str(path)}, SOURCE_SETTINGS['replay'], 'replay'
    )
    samples = []
    with closing(make_replay(values)) as source, ProgressBar('supervise') as bar:
        for sample in source.recorded():
            samples.append(sample)
            bar.show(f'{len(samples)} sets read')
    return (
        np.array([sample.stamp for sample in samples]),
        np.array([sample.angles for sample in samples]),
        0,
    )


def _is_can_log(path: Path) -> bool:
    """Return whether a CSV file is a log of python-can and not a table of joint angles."""
    try:
        with open(path, encoding='utf-8-sig') as file:
            return 'arbitration_id' in file.readline()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: cannot be read: {error}') from error


def _report_gaps(angles: NDArray[np.float64], left_out: int) -> None:
    """Print the joints without readings, and the number of samples without parity."""
    if left_out:
        print(f'{left_out} rows with fewer than {len(JOINT_NAMES)} readings left out')
    missing = np.isnan(angles)
    for name, count in zip(ALL_JOINT_NAMES, missing.sum(axis=0).tolist(), strict=False):
        if count:
            print(f'  {name} has no reading in {count} samples')
    without = int(missing[:, : len(JOINT_NAMES)].any(axis=1).sum())
    if without:
        print(f'  {without} samples without parity, which needs {", ".join(JOINT_NAMES)}')


def _report(
    seconds: NDArray[np.float64], result: Supervised, table: list[parity_map.Region]
) -> None:
    """Print the share published, the reasons of the rest, and the regions."""
    n = len(seconds)
    published = int(result.published.sum())
    print(
        f'{n} samples in {seconds[-1]:.1f} s; {published} orientations published '
        f'({100.0 * published / n:.2f} %)'
    )
    for reason, count in result.reasons.most_common(REASONS):
        print(f'  {count:8d} withheld: {with_remedy(reason, reason)}')
    for index, text in result.state[:REASONS]:
        print(f'  {seconds[index]:8.3f} s: {text}')
    if len(result.state) > REASONS:
        print(f'  and {len(result.state) - REASONS} more changes of the state')
    for name, times in zip(ALL_JOINT_NAMES, result.unchecked.T, strict=False):
        # Before the first check it counts from the beginning.
        never = np.isinf(times)
        longest = np.where(never, seconds, times).max()
        print(
            f'  {name}: '
            + ('never checked' if never.all() else f'unchecked for {longest:.1f} s at most')
        )
    print(
        f'{"tilt, deg":>11}{"phi, deg":>13}{"samples":>9}{"published":>11}'
        f'{"parity, deg: mean":>19}{"rms":>8}{"level, deg":>12}'
    )
    for row in table:
        print(
            f'{row.tilt_from_deg:5g} .. {row.tilt_to_deg:2g}'
            f'{row.phi_from_deg:6g} .. {row.phi_to_deg:3g}{row.samples:9d}'
            f'{100.0 * row.published:9.2f} %{row.mean_deg:19.4f}{row.rms_deg:8.4f}'
            f'{row.level_deg:12.2f}'
        )


def _propose(
    stamps: NDArray[np.int64],
    angles: NDArray[np.float64],
    table: list[parity_map.Region],
    values: Values,
) -> None:
    """Print the parameters that the recording supports, as lines of a parameter file."""
    noise = np.degrees(parity_map.white_noise(stamps, angles))
    bias = parity_map.nominal_bias(table)
    print('The recording supports (parameters of fkm):')
    unknown = np.isnan(noise)
    now = [round(degrees(each), 4) for each in sigma_from(values)]
    if unknown.all():
        print('  no sigma_deg: fewer than four samples in a row')
    else:
        names = ', '.join(np.array(ALL_JOINT_NAMES)[: len(unknown)][unknown])
        sigma = ', '.join(f'{each:.4f}' for each in np.where(unknown, now, noise))
        kept = f'; as it is for {names}, which lack four readings in a row' if names else ''
        print(f'  sigma_deg: [{sigma}]   # now {now}{kept}')
    if bias is None:
        print(f'  no bias_deg: no region has {parity_map.REGION_SAMPLES} samples')
    else:
        now = values['bias_deg']
        print(
            f'  bias_deg: {proposed_bias(bias, now)}   # now {list(now)}; largest mean parity '
            f'{bias:.4f} deg;\n  # not below the bias_deg in use: a recording shows one '
            'combination of the errors, where it has been;\n  # calibrate bounds each over the '
            'workspace'
        )


def proposed_bias(parity: float, now: Sequence[float]) -> list[float]:
    """Return the bias to propose for each sensor, deg: that of `parity`, not below that in use."""
    each = round(ceil(round(parity / BIAS_UNIT, 6)) * BIAS_UNIT, 6)
    return [max(each, bound) for bound in now]
