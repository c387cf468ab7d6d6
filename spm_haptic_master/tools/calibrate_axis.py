# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of calibrate that takes a slide or a gripper from its one end to its other one."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from datetime import datetime
from pathlib import Path
import sys
import threading
from typing import Any

import numpy as np
from spm_haptic_master.calibration import axis_ends, axis_file, calibration_file
from spm_haptic_master.calibration.axis_ends import AxisCalibration, AxisMotion
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.encoders.single_axis import AxisReading, make_axes, SingleAxis
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import CalibrationError, InputError, SourceEnded
from spm_haptic_master.parameters.axes import AXIS_SETTINGS, GRIPPER, INSERTION
from spm_haptic_master.parameters.encoders import sensors_of
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.simulation.source_factory import make_replay, make_source
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.motion_source import check_source

# Longest wait for one reading (s), so that a recording ends with Enter.
READ_TIMEOUT = 0.05
# What each axis is called, and the unit of its positions.
NOUNS = {INSERTION: ('slide', 'm'), GRIPPER: ('gripper', 'deg')}
# Options of the other kinds of calibration.
OTHERS = ('motion', 'pose', 'pose_recording', 'capture', 'capture_topic', 'jig_error', 'seconds')
DEFAULTS = {setting.name: setting.default for setting in AXIS_SETTINGS}


def run(options: argparse.Namespace) -> int:
    """
    Calibrate or check one axis by a motion from one end to the other.

    With --insertion or --gripper the positions of the ends are given; a log, or a bus while the
    user moves the axis, gives the motion. With --check it compares with the calibration in that
    file, else it adds the axis to -o FILE.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    int
        Exit code: 0, or 1 where a check finds a change.

    Raises
    ------
    InputError
        The command line is not as expected, or the file cannot be written or read.
    CalibrationError
        The motion is not one between the given ends.

    """
    axis, ends = _axis_of(options)
    given = command_line.given(options)
    source = str(given.get('source', 'can'))
    check_source(source, 'calibrate')
    if options.check is None:
        _check_output(options, axis)
    values = command_line.checked(
        raw_counts(sensors_of(given)) | given | _of_counts(axis),
        SOURCE_SETTINGS[source],
        source,
    )
    if not values[f'{axis}.id']:
        raise InputError(f'{axis}.id is 0; expected the CAN identifier of the {axis} encoder')
    before = None
    if options.check is not None:
        before = axis_file.read_axis(options.check, axis, values['gripper.counts_per_turn'])
    if source == 'replay':
        motion = _replayed(axis, values)
    else:
        motion = _recorded(axis, source, values, ends)
    if before is not None:
        return _report_check(options.check, axis, axis_ends.change_since(motion, ends, before))
    found = axis_ends.calibrate_axis(motion, ends)
    parameters = _layout_of(axis, given) | found.parameters()
    # What the driver would refuse is refused here.
    checked = command_line.checked(values | parameters, SOURCE_SETTINGS[source], source)
    make_axes(checked, checked['can.heartbeat_timeout'])
    date = datetime.now().astimezone().isoformat(timespec='seconds')
    text = axis_file.extended_text(options.output, f'{axis} calibrated on', date, parameters)
    calibration_file.write_text(options.output, text)
    _report(options.output, found)
    return 0


def _axis_of(options: argparse.Namespace) -> tuple[str, tuple[float, float]]:
    """
    Return the axis to calibrate and the positions of its ends.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    axis : str
        `insertion` or `gripper`.
    ends : tuple of 2 float
        First and second position, m, or deg for the gripper.

    Raises
    ------
    InputError
        More than one kind of calibration is asked for, or both ends are equal.

    """
    given = {INSERTION: options.insertion, GRIPPER: options.gripper}
    chosen = {axis: ends for axis, ends in given.items() if ends is not None}
    if len(chosen) > 1:
        raise InputError('--insertion and --gripper; expected one of them')
    ((axis, (first, second)),) = chosen.items()
    for name in OTHERS:
        if getattr(options, name) is not None:
            raise InputError(f'--{name.replace("_", "-")} beside --{axis}; expected one of them')
    if first == second:
        raise InputError(f'--{axis} {first:g} {second:g}: both ends are equal; expected two')
    return axis, (first, second)


def _check_output(options: argparse.Namespace, axis: str) -> None:
    """
    Check, before anything is recorded, that the file can be extended.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    axis : str
        Name of the axis.

    Raises
    ------
    InputError
        There is no -o, the file cannot be written, or has a calibration of the axis and --force is
        not given.

    """
    path = options.output
    if path is None:
        raise InputError('no -o FILE; expected the calibration file to extend or to write')
    calibration_file.check_output(path, force=True)
    if not options.force and f'{axis}.zero_count' in axis_file.axis_parameters(path, axis):
        raise InputError(
            f'-o: {path} already has {axis}.zero_count; expected --force to replace it, or '
            '--check to compare'
        )


def _of_counts(axis: str) -> dict[str, Any]:
    """Return the settings with which no count is refused before it is read."""
    found: dict[str, Any] = {f'{axis}.direction': 1, f'{axis}.zero_count': 0}
    if axis == INSERTION:
        return found | {'insertion.counts_per_metre': 100.0, 'insertion.range': (0.0, 0.01)}
    return found | {'gripper.range_deg': DEFAULTS['gripper.range_deg']}


def _layout_of(
    axis: str,
    given: dict[str, object],
) -> dict[str, object]:
    """Return the given settings of an axis, which its calibration needs beside it in the file."""
    return {
        name: value
        for name, value in given.items()
        if name in DEFAULTS and name.startswith(f'{axis}.')
    }


def _replayed(
    axis: str,
    values: dict[str, Any],
) -> AxisMotion:
    """Return the motion of an axis in a log."""
    with closing(make_replay(values)) as source:
        encoder = _encoder(source, axis)
        readings = [
            found for found in source.recorded_readings() if isinstance(found, AxisReading)
        ]
        return _motion(encoder, readings, source)


def _recorded(
    axis: str,
    source_name: str,
    values: dict[str, Any],
    ends: tuple[float, float],
) -> AxisMotion:
    """
    Return the motion of an axis on a bus, from one Enter to the next.

    A thread collects the readings while the instructions wait for the user.

    Parameters
    ----------
    axis : str
        Name of the axis.
    source_name : str
        Name of the source, `can`.
    values : dict
        Checked parameters, by name.
    ends : tuple of 2 float
        Positions of both ends, for the instructions, m or deg.

    Returns
    -------
    AxisMotion
        Readings between the two Enters.

    Raises
    ------
    InputError
        Standard input has ended.
    CalibrationError
        There is no reading of the axis.

    """
    noun, unit = NOUNS[axis]
    first, second = ends
    readings: list[AxisReading] = []
    stop = threading.Event()
    with closing(make_source(source_name, values)) as source, ThreadPoolExecutor(1) as pool:
        encoder = _encoder(source, axis)
        reading: Future[None] = pool.submit(_collect, source, readings, stop)
        try:
            _ask(f'hold the {noun} at {first:g} {unit}, then press Enter')
            begin = len(readings)
            _ask(f'wait a second, move it slowly to {second:g} {unit}, wait a second, press Enter')
        finally:
            stop.set()
        reading.result()
        return _motion(encoder, readings[begin:], source)


def _encoder(source: EncoderSource, axis: str) -> SingleAxis:
    """Return the encoder of an axis, which reads counts from now on."""
    (encoder,) = (each for each in source.axes if each.name == axis)
    encoder.read_counts()
    return encoder


def _ask(text: str) -> None:
    """Print an instruction, and wait for Enter; InputError where stdin has ended."""
    print(f'calibrate: {text}', file=sys.stderr)
    if not sys.stdin.readline():
        raise InputError('standard input has ended; expected Enter at each end')


def _collect(
    source: EncoderSource,
    readings: list[AxisReading],
    stop: threading.Event,
) -> None:
    """Collect the readings of the axes until `stop`, or the end of the source."""
    while not stop.is_set():
        try:
            source.read(READ_TIMEOUT)
        except SourceEnded:
            return
        readings += source.take_readings()


def _motion(
    encoder: SingleAxis,
    readings: Iterable[AxisReading],
    source: EncoderSource,
) -> AxisMotion:
    """Return the readings of an axis; CalibrationError where there is none."""
    own = [reading for reading in readings if reading.name == encoder.name]
    if not own:
        fault = encoder.fault(source.axis_time)
        raise CalibrationError(f'{fault or f"{encoder.name} missing"}; expected its readings')
    return AxisMotion(
        axis=encoder.name,
        stamps=np.array([reading.stamp for reading in own], dtype=np.int64),
        counts=np.array([reading.position for reading in own]),
        ring=encoder.layout.counts_per_turn,
    )


def _report(path: Path, found: AxisCalibration) -> None:
    """Print what was written: zero count, direction, scale and range."""
    noun, unit = NOUNS[found.axis]
    least, greatest = found.range
    print(f'{path}: written')
    print(
        f'  {noun}: zero count {found.zero_count}, direction {found.direction:+d}, '
        f'{found.counts_per_unit:g} counts per {unit}, range {least:g} to {greatest:g} {unit}'
    )
    print('  One encoder: nothing checks it. Look at both ends with --check after each repair.')


def _report_check(
    path: Path,
    axis: str,
    change: str | None,
) -> int:
    """Print whether a calibration holds; return the exit code."""
    print(f'{path}: {change or f"the calibration of the {NOUNS[axis][0]} holds"}')
    return 0 if change is None else 1
