# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of calibrate that takes a free motion: records, computes, writes file and report."""

from __future__ import annotations

import argparse
from datetime import datetime
import hashlib
from math import degrees, radians
from pathlib import Path
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
import spm_haptic_master
from spm_haptic_master.calibration.calibration_file import write_text
from spm_haptic_master.calibration.free_motion import MotionCalibration, MotionCalibrator
from spm_haptic_master.calibration.jig_pose import read_still
from spm_haptic_master.calibration.mechanism_parameters import Tolerances
from spm_haptic_master.calibration.motion_file import motion_text, Origin
from spm_haptic_master.calibration.motion_guide import Guidance, Guide
from spm_haptic_master.calibration.motion_model import MotionModel
from spm_haptic_master.calibration.motion_recording import read_log, record_motion, Recording
from spm_haptic_master.calibration.motion_report import check_report, write_report
from spm_haptic_master.calibration.outside_reference import Mounted, mounted
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.settings import (
    BUS_SETTINGS,
    for_sensors,
    HARMONIC_SETTINGS,
    LAYOUT_SETTINGS,
    sensors_of,
)
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.geometry_settings import geometry_from
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import (
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
    zxz_from_matrix,
)
from spm_haptic_master.parameter_files import source_defaults
from spm_haptic_master.source_factory import (
    make_replay,
    make_source,
    MECHANISM_SETTINGS,
    SOURCE_SETTINGS,
    source_text,
)
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.pose_recording import JIG_SECONDS, record_pose, wait_for_pose
from spm_haptic_master.tools.progress_bar import CountBar, StageBar
from spm_haptic_master.validation.alignment import align, interpolate
from spm_haptic_master.validation.recordings import read_capture

# Longest motion (s), and predicted error at which a recording ends by itself (deg).
SECONDS_DEFAULT, TARGET_DEFAULT = 120.0, 0.04
# Standard deviation of a jig's pose without --jig-error, and of a capture (deg).
JIG_SIGMA, CAPTURE_SIGMA = 0.1, 0.2
# Time between two captured orientations that are used (s): their errors last about so long.
CAPTURE_PERIOD = 0.25
# Least number of captured orientations.
CAPTURED_MINIMUM = 20
# Settings that the calibration itself determines.
DETERMINED = {'encoders.direction', 'encoders.direction_verified', 'encoders.zero_count',
              'encoders.counts_per_turn', *(setting.name for setting in HARMONIC_SETTINGS)}


def run(options: argparse.Namespace) -> int:
    """Calibrate from free motion; errors as SpmError."""
    output = options.output
    given = command_line.given(options)
    source = str(given.get('source', 'can'))
    check_output(output, source, options.force)
    _check_references(options, source)
    sensors = sensors_of(given)
    values = command_line.checked(
        given | raw_counts(sensors) | {'encoders.direction_verified': (True,) * sensors},
        SOURCE_SETTINGS[source], source)
    mechanism = command_line.checked(given, MECHANISM_SETTINGS)
    nominal, working_mode = geometry_from(mechanism), mechanism['working_mode']
    tolerances = Tolerances(
        links=radians(options.mechanism_tolerance), axes=radians(options.mechanism_tolerance),
        first_harmonics=radians(options.harmonic_tolerance))
    stamps, angles = recorded(source, values, options, Guide(nominal, working_mode, tolerances))
    directions = given.get('encoders.direction')
    bar = StageBar('calibrate')
    try:
        found = MotionCalibrator(nominal, working_mode, tolerances, bar.show).calibrate(
            stamps, angles, directions if isinstance(directions, (list, tuple)) else None)
    finally:
        bar.end()
    mounting = None
    if options.pose or options.capture is not None:
        mounting = mounted_by(options, source, values, found, working_mode)
        found = mounting.calibration
    origin = Origin(
        datetime.now().astimezone().isoformat(timespec='seconds'),
        source_text(source, values).removeprefix('replay: '),
        _checksum(values['replay.path']) if source == 'replay' else '',
        spm_haptic_master.__version__, values['encoders.counts_per_turn'],
        _kept(source, given, values, mechanism) | _mounting_settings(mounting))
    write_text(output, motion_text(found, origin))
    report = write_report(output, found, origin)
    _print(output, found, report)
    if mounting is not None:
        _print_mounting(mounting)
    return 0


def check_output(output: Path | None, source: str, force: bool) -> None:
    """Raise InputError for arguments that cannot lead to a calibration."""
    if source not in ('can', 'replay'):
        raise InputError(f"parameter 'source' is {source!r}; expected can or replay "
                         '(a simulation has nothing to calibrate)')
    if output is None:
        raise InputError('no -o FILE; expected the parameter file to write')
    if not output.parent.is_dir():
        raise InputError(f'-o {output}; expected a file in an existing directory')
    if output.exists() and not output.is_file():
        raise InputError(f'-o {output}; expected a regular file, or none')
    if output.exists() and not force:
        raise InputError(f'-o {output}: it already exists; expected --force to overwrite it, or '
                         '--check to compare a motion with it')
    check_report(output, force)


def _check_references(options: argparse.Namespace, source: str) -> None:
    """Raise InputError for orientations from outside that do not fit together."""
    if options.pose and options.capture is not None:
        raise InputError('--pose and --capture; expected one of the two')
    if source != 'replay' and options.pose_recording:
        raise InputError(f'--pose-recording with source {source!r}; expected it with replay')
    if source == 'replay' and len(options.pose or ()) != len(options.pose_recording or ()):
        raise InputError(f'--pose is given {len(options.pose or ())} times and --pose-recording '
                         f'{len(options.pose_recording or ())} times; expected as many')


def recorded(source: str, values: dict[str, Any], options: argparse.Namespace,
             guide: Guide) -> Recording:
    """Return the recording of a motion: a log at once, a bus while the user moves the device."""
    if source == 'replay':
        bar = CountBar('calibrate', None, 'sets read')
        replay = make_replay(values)
        try:
            return read_log(replay, bar.show)
        finally:
            bar.end()
            replay.close()
    live = make_source(source, values)
    seconds = options.seconds or SECONDS_DEFAULT
    print('calibrate: move the handle through its whole workspace: tilt it in all directions and '
          f'turn it both ways,\ncalibrate: for {seconds:g} s at most; Ctrl-C ends the recording '
          'and keeps it', file=sys.stderr, flush=True)
    progress = _Guided(live, guide, seconds, radians(options.target))
    try:
        return record_motion(live, seconds, progress.evaluate)
    finally:
        progress.end()
        live.close()


def mounted_by(options: argparse.Namespace, source: str, values: dict[str, Any],
               found: MotionCalibration, working_mode: tuple[int, int, int]) -> Mounted:
    """Return a calibration with the mounting by a jig's poses or a motion capture."""
    model = MotionModel(found.layout, working_mode, found.readings.sigma)
    if options.capture is not None:
        turned, outside = _captured(options, found)
        return mounted(found, model, turned, outside, radians(options.capture_sigma))
    recordings = options.pose_recording or [None] * len(options.pose)
    counts_per_turn = values['encoders.counts_per_turn']
    rows = []
    for number, (pose, recording) in enumerate(zip(options.pose, recordings, strict=True), 1):
        if recording is None:
            wait_for_pose(number, len(options.pose), pose)
        counts = record_pose(
            source, values | ({} if recording is None else {'replay.path': str(recording)}),
            JIG_SECONDS)
        readings = read_still(counts, counts_per_turn, radians(options.noise_limit),
                              radians(options.drift_limit))
        rows.append([each.counts * TURN / per_turn for each, per_turn
                     in zip(readings, counts_per_turn, strict=True)])
    poses = matrix_from_zxz(*np.radians(options.pose).T)
    return mounted(found, model, np.array(rows) * np.array(found.direction), poses,
                   radians(options.jig_error or JIG_SIGMA))


def _captured(options: argparse.Namespace,
              found: MotionCalibration) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return readings by their directions, and captured orientations, at the same times."""
    capture = read_capture(options.capture, options.capture_topic)
    seconds = found.readings.seconds
    known = np.isfinite(found.rotation).all(axis=(1, 2))
    times, quaternions = seconds[known], quaternion_from_matrix(found.rotation[known])
    begin = capture.time - capture.time[0]
    fitted = align(times, quaternions, begin, capture.values, False)
    rows = np.flatnonzero(known)[::max(1, int(CAPTURE_PERIOD / np.median(np.diff(times))))]
    at = interpolate(begin + fitted.offset, capture.values, seconds[rows])
    inside = np.isfinite(at).all(axis=1)
    if inside.sum() < CAPTURED_MINIMUM:
        raise CalibrationError(f'{options.capture}: {int(inside.sum())} orientations at times of '
                               f'the motion; expected at least {CAPTURED_MINIMUM}')
    rows = rows[inside]
    return (found.readings.readings[rows] * np.array(found.direction),
            matrix_from_quaternion(at[inside]))


def _mounting_settings(mounting: Mounted | None) -> dict[str, Any]:
    """Return the parameters of a mounting."""
    if mounting is None:
        return {}
    return {f'mounting.{part}_zxz_deg': tuple(
        round(degrees(float(angle)), 6) for angle in zxz_from_matrix(rotation))
        for part, rotation in (('base', mounting.base), ('handle', mounting.handle))
        if part == 'base' or mounting.handle_deviations.any()}


def _print_mounting(mounting: Mounted) -> None:
    """Print the mounting that the orientations from outside determined."""
    for name, deviations in (('base', mounting.base_deviations),
                             ('handle', mounting.handle_deviations)):
        if deviations.any():
            print(f'  mounting of the {name}: standard deviations '
                  f'{" ".join(f"{degrees(each):.3f}" for each in deviations)} deg')
    print(f'  left of the orientations from outside: {degrees(mounting.rms):.3f} deg rms')


class _Guided:
    """Shows what a motion still lacks, and how far the target precision is."""

    def __init__(self, source: EncoderSource, guide: Guide, seconds: float, target: float):
        self._source = source
        self._guide = guide
        self._seconds = seconds
        self._target = target
        self._bar = StageBar('calibrate')

    def evaluate(self, recording: Recording, seconds: float) -> bool:
        """Show the state of a motion; return whether its precision is reached."""
        found = self._guide.evaluate(*recording)
        share = self._share(found)
        text = f'{seconds:.0f} s, {len(recording[0])} sets: {found.text}'
        if self._source.fault:
            text += f' ({self._source.fault})'
        self._bar.show(text, share)
        return found.error is not None and found.error <= self._target

    def _share(self, found: Guidance) -> float:
        """Return how much of the target information there is: that is the inverse variance."""
        return 0.0 if found.error is None else min(1.0, (self._target / found.error) ** 2)

    def end(self) -> None:
        """End the line of the bar."""
        self._bar.end()


def _kept(source: str, given: dict[str, object], values: dict[str, Any],
          mechanism: dict[str, Any]) -> dict[str, Any]:
    """Return the settings that the calibration rests on, where they are not the defaults."""
    names = [setting.name for setting in for_sensors(LAYOUT_SETTINGS, values['sensors'])]
    names += ['encoders.sync_id', 'can.protocol', 'encoders.node_id']
    defaults = source_defaults('can')
    kept: dict[str, Any] = {}
    if source == 'can':
        kept['source'] = 'can'
        names += [setting.name for setting in BUS_SETTINGS]
    for name in names:
        if name in given and name not in DETERMINED and values[name] != defaults.get(name):
            kept[name] = values[name]
    if mechanism['working_mode'] != (1, 1, 1):
        kept['working_mode'] = mechanism['working_mode']
    return kept


def _checksum(path: str) -> str:
    found = hashlib.sha256()
    with open(path, 'rb') as file:
        while block := file.read(1 << 20):
            found.update(block)
    return found.hexdigest()


def _print(path: Path, found: MotionCalibration, report: str) -> None:
    """Print what was written."""
    print(f'{path}: written; {report}')
    readings = found.readings
    print(f'  {readings.sets} sets in {readings.seconds[-1]:.1f} s, {readings.spikes} left out as '
          'spikes')
    for index, joint in enumerate(ALL_JOINT_NAMES[:found.layout.sensors]):
        print(f'  {joint}: direction {found.direction[index]:+d}, sigma '
              f'{degrees(found.noise[index]):.4f} deg, bias {degrees(found.bias[index]):.2f} deg')
    print(f'  predicted error of the orientation: {degrees(found.error):.3f} deg rms over the '
          f'motion, {degrees(found.target_error):.3f} over the workspace')
    for group, reason in found.left.items():
        print(f'  {group} left as drawn: {reason}')
    if found.advice:
        print(f'  a further motion that would determine more: {found.advice[0].text}')
