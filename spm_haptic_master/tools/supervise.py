# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs a recording through the supervision of fkm, and proposes noise and nominal bias from it."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from math import ceil, degrees
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.encoders.single_axis import AxisReading
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.parameters.arguments import Parser
from spm_haptic_master.parameters.axes import AXES
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
from spm_haptic_master.tools.axis_gaps import axis_line, AxisRecord
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


@dataclass(frozen=True, slots=True)
class Recorded:
    """
    Joint angles of a recording, and what of it has none.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        Times of the samples, ns.
    angles : ndarray, shape (n, N)
        Joint angles, rad; NaN without a reading.
    cycles : int
        Number of cycles of the bus, with and without a set; of a table its rows.
    noun : str
        What these are, in words.
    dropped : mapping of str to int
        Number of cycles and frames without a set, by reason.
    axes : mapping of str to ndarray
        Times of the readings of each axis, s.

    """

    stamps: NDArray[np.int64]
    angles: NDArray[np.float64]
    cycles: int
    noun: str
    dropped: Mapping[str, int]
    axes: Mapping[str, NDArray[np.float64]]

    @property
    def seconds(self) -> NDArray[np.float64]:
        """Return the times since the first sample, s, (n,)."""
        return np.asarray((self.stamps - self.stamps[0]) * 1e-9)


@command_line.program('supervise')
def main(args: list[str]) -> int:
    """
    Supervise a recording as fkm does, and print what it would publish.

    RECORDING is a log of the bus, a directory of recorder, a rosbag2 or a CSV file. The parameters
    are those of the driver and of fkm. It writes supervise.png and regions.csv to -o DIR, and
    prints share, gaps, reasons and regions, with the sigma_deg and bias_deg that the recording
    supports.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.

    Returns
    -------
    int
        Exit code: 0. After an error, which is one line on stderr, it is 1.

    """
    options = _parser().parse(args)
    # matplotlib is an extra: report that it is missing before anything is computed.
    from spm_haptic_master.tools import supervision_figure

    given = command_line.given(
        options,
        (DRIVER, 'fkm'),
        DRIVER_NAMES | {setting.name for setting in FKM_SETTINGS},
    )
    recorded = _read(options, given)
    values = _values(recorded, given, options.recording)
    n = len(recorded.stamps)
    with ProgressBar('supervise') as bar:
        result = recording.run(
            recorded.stamps,
            recorded.angles,
            values,
            lambda done: bar.show(f'{done} of {n} samples', done / n),
        )
    found = parity_map.parity_map(
        recorded.angles,
        sigma_from(values),
        geometry_from(values),
        values['working_mode'],
    )
    table = parity_map.regions(found, result.published, result.protection_level)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        parity_map.write_regions(options.output / 'regions.csv', table)
    except OSError as error:
        raise InputError(f'{options.output}: cannot be written: {error}') from error
    supervision_figure.draw(
        options.output / 'supervise.png',
        recorded.seconds,
        found,
        result,
        values['alert_limit_deg'],
    )
    print(verdict(recorded, result))
    _report_gaps(recorded)
    _report_axes(recorded)
    _report(recorded, result)
    _report_regions(table)
    _propose(recorded.stamps, recorded.angles, table, values)
    print(f'{options.output}: supervise.png, regions.csv')
    return 0


def _values(
    recorded: Recorded,
    given: dict[str, object],
    path: Path,
) -> dict[str, Any]:
    """
    Return the parameters of fkm for a recording.

    Parameters
    ----------
    recorded : Recorded
        The recording.
    given : dict of str to object
        Given parameters, by name.
    path : Path
        Its file, for the error.

    Returns
    -------
    dict
        Checked values, by name.

    Raises
    ------
    SettingError
        Another number of sensors is given than recorded.

    """
    sensors = recorded.angles.shape[1]
    values = command_line.checked({SENSORS_SETTING.name: sensors} | given, FKM_SETTINGS)
    if values[SENSORS_SETTING.name] != sensors:
        raise SettingError(
            name=SENSORS_SETTING.name,
            value=values[SENSORS_SETTING.name],
            expected=f'{sensors}, as {path} has',
        )
    return values


def _parser() -> Parser:
    """Return the parser of the command line."""
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
    options: argparse.Namespace,
    given: dict[str, object],
) -> Recorded:
    """
    Return the joint angles of a table, a rosbag2 or a log of the bus.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    given : dict of str to object
        Given parameters, by name.

    Returns
    -------
    Recorded
        With what has no angles, and the times of the axes' readings.

    Raises
    ------
    InputError
        There are no joint angles, or the file cannot be read.

    """
    path = options.recording
    is_recording = path.is_dir() or path.suffix in bags.STORAGE_SUFFIXES
    if is_recording or (path.suffix == '.csv' and not _is_can_log(path)):
        return _read_table(path, options.topic)
    return _read_log(path, given)


def _read_table(path: Path, topic: str) -> Recorded:
    """
    Return the joint angles of a CSV table, of `recorder` or of a rosbag2.

    Parameters
    ----------
    path : Path
        The recording.
    topic : str
        Topic of the joint angles in a rosbag2.

    Returns
    -------
    Recorded
        Its rows.

    Raises
    ------
    InputError
        There are no joint angles, or the file cannot be read.

    """
    track = recordings.read_joints(path, topic)
    if track is None:
        raise InputError(f'{path}: nothing on topic {topic}')
    dropped = {}
    if track.left_out:
        dropped[f'rows with fewer than {len(JOINT_NAMES)} readings'] = track.left_out
    times = {axis: recordings.read_axis_times(path, axis) for axis in AXES}
    return Recorded(
        stamps=np.round(track.time * 1e9).astype(np.int64),
        angles=track.values,
        cycles=len(track.time) + track.left_out,
        noun='samples',
        dropped=dropped,
        axes={axis: found for axis, found in times.items() if found.size},
    )


def _read_log(
    path: Path,
    given: dict[str, object],
) -> Recorded:
    """
    Return the joint angles of a log of the bus.

    Parameters
    ----------
    path : Path
        The log.
    given : dict of str to object
        Given parameters, by name.

    Returns
    -------
    Recorded
        Its cycles.

    """
    values = command_line.checked(
        given | {'replay.path': str(path)},
        SOURCE_SETTINGS['replay'],
        'replay',
    )
    samples: list[JointSample] = []
    with closing(make_replay(values)) as source, ProgressBar('supervise') as bar:
        axis_stamps: dict[str, list[int]] = {axis.name: [] for axis in source.axes}
        for found in source.recorded_with_axes():
            if isinstance(found, AxisReading):
                axis_stamps[found.name].append(found.stamp)
                continue
            samples.append(found)
            bar.show(f'{len(samples)} sets read')
        # The last cycle of a log has no SYNC that ends it.
        cycles = max(source.cycles, len(samples))
        dropped = source.dropped
    return Recorded(
        stamps=np.array([sample.stamp for sample in samples]),
        angles=np.array([sample.angles for sample in samples]),
        cycles=cycles,
        noun='cycles of the bus',
        dropped=dropped,
        axes={axis: np.array(stamps, dtype=float) * 1e-9 for axis, stamps in axis_stamps.items()},
    )


def _is_can_log(path: Path) -> bool:
    """Return whether a CSV file is a log of python-can and not a table of joint angles."""
    try:
        with open(path, encoding='utf-8-sig') as file:
            return 'arbitration_id' in file.readline()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: cannot be read: {error}') from error


def verdict(recorded: Recorded, result: Supervised) -> str:
    """
    Return in one line what share of the cycles is published, and which sensor was checked.

    Parameters
    ----------
    recorded : Recorded
        The recording.
    result : Supervised
        Result of its supervision.

    Returns
    -------
    str
        Share, number of orientations, and the longest time that a sensor was unchecked.

    """
    published = int(result.published.sum())
    longest = longest_unchecked(recorded.seconds, result.unchecked)
    never = [name for name, seconds in longest.items() if seconds is None]
    known = {name: seconds for name, seconds in longest.items() if seconds is not None}
    if never:
        checked = f'{", ".join(never)} NEVER checked'
    else:
        name = max(known, key=lambda each: known[each])
        checked = f'every sensor checked, {name} the least ({known[name]:.1f} s without)'
    share = 100.0 * published / recorded.cycles
    return (
        f'{share:.2f} % of {recorded.cycles} {recorded.noun} published '
        f'({published} orientations in {recorded.seconds[-1]:.1f} s); {checked}'
    )


def longest_unchecked(
    seconds: NDArray[np.float64],
    unchecked: NDArray[np.float64],
) -> dict[str, float | None]:
    """
    Return for how long each sensor was unchecked at most.

    Before its first check, and after a pause of the recording, the time counts from the first
    sample there: what happened in a pause was not published.

    Parameters
    ----------
    seconds : ndarray, shape (n,)
        Times of the samples, s.
    unchecked : ndarray, shape (n, N)
        Time since the last check of each sensor, s; infinite before the first one.

    Returns
    -------
    dict of str to float or None
        By joint, s; None if it was never checked.

    """
    found: dict[str, float | None] = {}
    for name, times in zip(ALL_JOINT_NAMES, unchecked.T, strict=False):
        never = np.isinf(times)
        begins = never & ~np.concatenate([[False], never[:-1]])
        since = np.maximum.accumulate(np.where(begins, seconds, 0.0))
        longest = float(np.where(never, seconds - since, times).max())
        found[name] = None if never.all() else longest
    return found


def _report_gaps(recorded: Recorded) -> None:
    """Print the cycles without a set, joints without readings, and samples without parity."""
    for reason, count in recorded.dropped.items():
        print(f'  {count:8d} {reason}')
    missing = np.isnan(recorded.angles)
    for name, count in zip(ALL_JOINT_NAMES, missing.sum(axis=0).tolist(), strict=False):
        if count:
            print(f'  {name} has no reading in {count} samples')
    without = int(missing[:, : len(JOINT_NAMES)].any(axis=1).sum())
    if without:
        print(f'  {without} samples without parity, which needs {", ".join(JOINT_NAMES)}')


def _report_axes(recorded: Recorded) -> None:
    """Print share and gaps of insertion and gripper."""
    seconds = recorded.seconds
    for name, times in recorded.axes.items():
        since_begin = times - recorded.stamps[0] * 1e-9
        period = float(np.median(np.diff(seconds)))
        record = AxisRecord(
            name=name,
            seconds=since_begin,
            length=float(seconds[-1]),
            period=period,
        )
        print(f'  {axis_line(record)}')


def _report(recorded: Recorded, result: Supervised) -> None:
    """Print why orientations are withheld, the states, and the longest time without a check."""
    for reason, count in result.reasons.most_common(REASONS):
        print(f'  {count:8d} withheld: {with_remedy(reason, reason)}')
    seconds = recorded.seconds
    for index, text in result.state[:REASONS]:
        print(f'  {seconds[index]:8.3f} s: {text}')
    if len(result.state) > REASONS:
        print(f'  and {len(result.state) - REASONS} more changes of the state')
    for name, longest in longest_unchecked(seconds, result.unchecked).items():
        text = 'never checked' if longest is None else f'unchecked for {longest:.1f} s at most'
        print(f'  {name}: {text}')


def _report_regions(table: list[parity_map.RegionRow]) -> None:
    """Print the parity by region of the workspace."""
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
    table: list[parity_map.RegionRow],
    values: Values,
) -> None:
    """
    Print the parameters that the recording supports, as lines of a parameter file.

    White noise by `parity_map.white_noise`, bias by the largest mean parity of a region.

    Parameters
    ----------
    stamps : ndarray of int, shape (n,)
        Times of the samples, ns.
    angles : ndarray, shape (n, N)
        Joint angles, rad.
    table : list of parity_map.RegionRow
        Parity by region.
    values : Values
        Checked parameters of fkm.

    """
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


def proposed_bias(
    parity: float,
    now: Sequence[float],
) -> list[float]:
    """
    Return the bias to propose for each sensor.

    Parameters
    ----------
    parity : float
        Largest mean parity of a region, deg.
    now : sequence of float
        Bias in use of each sensor, deg.

    Returns
    -------
    list of float
        Bias, deg; that of the parity, rounded up to `BIAS_UNIT`, and not below that in use.

    """
    each = round(ceil(round(parity / BIAS_UNIT, 6)) * BIAS_UNIT, 6)
    return [max(each, bound) for bound in now]
