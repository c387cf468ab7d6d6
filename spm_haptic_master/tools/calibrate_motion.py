# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of calibrate that takes a free motion: records, computes, writes file and report."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from datetime import datetime
import hashlib
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
import spm_haptic_master
from spm_haptic_master.calibration.calibration_file import check_output, write_text
from spm_haptic_master.calibration.free_motion import (
    MotionCalibration,
    MotionCalibrator,
    UNUSUAL,
)
from spm_haptic_master.calibration.jig_pose import read_still
from spm_haptic_master.calibration.mechanism_parameters import Tolerances
from spm_haptic_master.calibration.motion_file import motion_text, Origin
from spm_haptic_master.calibration.motion_guide import Guidance, Guide
from spm_haptic_master.calibration.motion_model import MotionModel
from spm_haptic_master.calibration.motion_recording import Recording
from spm_haptic_master.calibration.motion_report import check_report, write_report
from spm_haptic_master.calibration.outside_reference import Mounted, mounted
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.settings import (
    ACCEPT_SETTING,
    CAN_SETTINGS,
    for_sensors,
    HARMONIC_SETTINGS,
    LAYOUT_SETTINGS,
    sensors_of,
    VERIFIED_SETTING,
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
from spm_haptic_master.shared_settings import CALIBRATION_SETTING, SENSORS_SETTING
from spm_haptic_master.source_factory import MECHANISM_SETTINGS, SOURCE_SETTINGS, source_text
from spm_haptic_master.tools import command_line, guidance_topic
from spm_haptic_master.tools.guidance_topic import Publish
from spm_haptic_master.tools.motion_source import check_source, Evaluate, read_motion
from spm_haptic_master.tools.pose_recording import JIG_SECONDS, record_pose, wait_for_pose
from spm_haptic_master.tools.progress_bar import StageBar
from spm_haptic_master.validation.alignment import align, interpolate
from spm_haptic_master.validation.recordings import read_capture

# Longest motion (s), and predicted error at which a recording ends by itself (deg).
SECONDS_DEFAULT, TARGET_DEFAULT = 120.0, 0.04
# Standard deviation of a jig's pose without --jig-error, and of a capture (deg).
JIG_SIGMA, CAPTURE_SIGMA = 0.1, 0.2
# Time between two captured orientations that are used (s): their errors last about so long.
CAPTURE_PERIOD = 0.25
# Columns of captured orientations.
QUATERNION_COLUMNS = 4
# Least number of captured orientations.
CAPTURED_MINIMUM = 20
# Tolerance of the second harmonics over that of the first ones (unit 1).
SECOND_HARMONIC = 0.1
# Settings that the calibration's file has in any case.
DETERMINED = {CALIBRATION_SETTING.name, SENSORS_SETTING.name, VERIFIED_SETTING.name,
              ACCEPT_SETTING.name, 'encoders.direction', 'encoders.zero_count',
              'encoders.counts_per_turn', *(setting.name for setting in HARMONIC_SETTINGS)}


def run(options: argparse.Namespace) -> int:
    """Calibrate from free motion; errors as SpmError."""
    given = command_line.given(options)
    source = str(given.get('source', 'can'))
    check_source(source, 'calibrate')
    output = _check_output(options.output, options.force)
    _check_references(options, source)
    sensors = sensors_of(given)
    values = command_line.checked(
        given | raw_counts(sensors) | {'encoders.direction_verified': (True,) * sensors},
        SOURCE_SETTINGS[source], source)
    mechanism = command_line.checked(given, MECHANISM_SETTINGS)
    nominal, working_mode = geometry_from(mechanism), mechanism['working_mode']
    tolerances = Tolerances(
        links=radians(options.mechanism_tolerance), axes=radians(options.mechanism_tolerance),
        first_harmonics=radians(options.harmonic_tolerance),
        second_harmonics=radians(options.harmonic_tolerance) * SECOND_HARMONIC)
    seconds = options.seconds or SECONDS_DEFAULT
    with guidance_topic.published(options.remap) as publish:
        guided = _Guided(Guide(nominal, working_mode, tolerances), radians(options.target),
                         publish)
        stamps, angles = read_motion(
            source, values, seconds, 'move the handle through its whole workspace: tilt it in all '
            f'directions and turn it both ways,\ncalibrate: for {seconds:g} s at most; Ctrl-C '
            'ends the recording and keeps it', guided.show)
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
        kept_settings(source, given, values, mechanism) | _mounting_settings(mounting))
    write_text(output, motion_text(found, origin))
    report = write_report(output, found, origin)
    _print(output, found, report)
    if mounting is not None:
        _print_mounting(mounting)
    return 0


def _check_output(output: Path | None, force: bool) -> Path:
    """Return the file to write; InputError where it or its report cannot be written."""
    if output is None:
        raise InputError('no -o FILE; expected the parameter file to write')
    if output.is_file() and not force:
        raise InputError(f'-o {output}: it already exists; expected --force to overwrite it, or '
                         '--check to compare a motion with it')
    check_output(output)
    check_report(output, force)
    return output


def _check_references(options: argparse.Namespace, source: str) -> None:
    """Raise InputError for orientations from outside that do not fit together."""
    if options.pose and options.capture is not None:
        raise InputError('--pose and --capture; expected one of the two')
    if source != 'replay' and options.pose_recording:
        raise InputError(f'--pose-recording with source {source!r}; expected it with replay')
    if source == 'replay' and len(options.pose or ()) != len(options.pose_recording or ()):
        raise InputError(f'--pose is given {len(options.pose or ())} times and --pose-recording '
                         f'{len(options.pose_recording or ())} times; expected as many')


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
    if capture.values.shape[1] != QUATERNION_COLUMNS:
        raise InputError(f'{options.capture}: markers; expected the pose of a body (qx, qy, qz, '
                         'qw), as the motion capture computes it')
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

    def __init__(self, guide: Guide, target: float, publish: Publish):
        self._guide = guide
        self._target = target
        self._publish = publish
        self._bar = StageBar('calibrate')
        self._source: EncoderSource | None = None

    def show(self, source: EncoderSource) -> tuple[Evaluate, Callable[[], None]]:
        """Return what evaluates the recording of a source, and what ends the bar."""
        self._source = source
        return self.evaluate, self._bar.end

    def evaluate(self, recording: Recording, seconds: float) -> bool:
        """Show the state of a motion; return whether its precision is reached."""
        found = self._guide.evaluate(*recording)
        share = self._share(found)
        text = f'{seconds:.0f} s, {len(recording[0])} sets: {found.text}'
        if self._source is not None \
                and (trouble := self._source.fault or self._source.caution):
            text += f' ({trouble})'
        self._bar.show(text, share)
        self._publish(text, {'precision': share, **found.covered})
        return found.error is not None and found.error <= self._target

    def _share(self, found: Guidance) -> float:
        """Return how much of the target information there is: that is the inverse variance."""
        return 0.0 if found.error is None else min(1.0, (self._target / found.error) ** 2)


def kept_settings(source: str, given: dict[str, object], values: dict[str, Any],
                  mechanism: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of the bus that were given, and the layout that it was measured with."""
    layout = {setting.name for setting in LAYOUT_SETTINGS}
    kept: dict[str, Any] = {'source': 'can'} if source == 'can' else {}
    kept |= {setting.name: values[setting.name]
             for setting in for_sensors(CAN_SETTINGS, values['sensors'])
             if (setting.name in given or setting.name in layout) and setting.name in values
             and setting.name not in DETERMINED}
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
    if found.unusual:
        print(f'  CAUTION, farther from the drawing than {UNUSUAL:g} tolerances: '
              f'{", ".join(found.unusual)}.\n  Check the drawing, encoders.counts_per_turn and '
              'the mounting of these parts.')
    if found.advice:
        print(f'  a further motion that would determine more: {found.advice[0].text}')
