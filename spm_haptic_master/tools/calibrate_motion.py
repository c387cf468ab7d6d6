# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of calibrate that takes a free motion: records, computes, writes file and report."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime
from importlib.metadata import version
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np
from spm_haptic_master import kinematics
from spm_haptic_master.calibration.axis_file import axis_parameters
from spm_haptic_master.calibration.calibration_file import check_output, write_text
from spm_haptic_master.calibration.jig import read_still
from spm_haptic_master.calibration.motion.calibration import MotionCalibration
from spm_haptic_master.calibration.motion.free_motion import calibrate_motion, Guide
from spm_haptic_master.calibration.motion.model import Array, Layout
from spm_haptic_master.calibration.motion.motion_file import motion_text, Origin, Verdict
from spm_haptic_master.calibration.motion.outside_reference import Mounted, mounted
from spm_haptic_master.calibration.recording import raw_counts, Recording
from spm_haptic_master.calibration.report import checksum, report_paths, write_report
from spm_haptic_master.encoders.counts_watch import smaller_resolution
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters import encoders
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import geometry_from, MECHANISM_SETTINGS
from spm_haptic_master.parameters.nodes import DRIVER_NAMES, SOURCE_SETTINGS
from spm_haptic_master.parameters.setting import CALIBRATION_SETTING, SENSORS_SETTING
from spm_haptic_master.simulation.source_factory import source_text
from spm_haptic_master.tools import command_line, motion_source
from spm_haptic_master.tools.calibration_verdict import (
    checked_region,
    FkmValues,
    published_share,
    supported,
)
from spm_haptic_master.tools.command_line import ProgressBar
from spm_haptic_master.validation import capture_rows
from spm_haptic_master.validation.alignment import align, interpolate
from spm_haptic_master.validation.recordings import read_capture, Track

# Takes an instruction and the shares of what it needs, 0 .. 1, by name.
Publish = Callable[[str, Mapping[str, float]], None]
# Longest motion (s), and predicted error at which a recording ends by itself (deg).
SECONDS_DEFAULT = 120.0
TARGET_DEFAULT = 0.04
# Standard deviation of a jig's pose without --jig-error, and of a capture (deg).
JIG_SIGMA = 0.1
CAPTURE_SIGMA = 0.2
# Time between two captured orientations that are used (s): their errors last about so long.
CAPTURE_PERIOD = 0.25
# Least number of captured orientations.
CAPTURED_MINIMUM = 20
# Settings that the calibration's file has in any case.
DETERMINED = {
    CALIBRATION_SETTING.name,
    SENSORS_SETTING.name,
    encoders.VERIFIED_SETTING.name,
    encoders.ACCEPT_SETTING.name,
    'encoders.direction',
    'encoders.zero_count',
    'encoders.counts_per_turn',
    *(each.name for each in encoders.HARMONIC_SETTINGS),
}


def run(options: argparse.Namespace) -> int:
    """
    Calibrate from free motion, and write the parameter file with its report.

    The motion is from the bus, while the user is guided, or from the logs of --motion. With --pose
    or --capture the mounting is found as well. No file is written unless the alert limit of fkm is
    supported (`supported`) and fkm publishes the motion with the result (`published_share`).

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    int
        Exit code 0.

    Raises
    ------
    InputError
        The command line is not as expected, or a file cannot be read or written.
    CalibrationError
        The motion does not determine a calibration that fkm can use.

    """
    source, both = motion_source.given_for_motion(options, 'calibrate')
    given = {name: value for name, value in both.items() if name in DRIVER_NAMES}
    output = options.output
    _check_outputs(output, options.force)
    _check_references(options, source)
    values = _source_values(source, given)
    mechanism = command_line.checked(given, MECHANISM_SETTINGS)
    layout = _drawn(options, values['sensors'], mechanism)
    recording = _recorded(options, source, values, layout)
    found = _calibrated(layout, recording, given, values['encoders.counts_per_turn'])
    kept = kept_settings(source, given, values, mechanism)
    mounting = None
    if options.pose or options.capture is not None:
        mounting = _mounted_by(options, source, values, found)
        found = mounting.calibration
        kept |= _mounting_settings(mounting)
    origin = _origin(options, source, values, kept | axis_parameters(output))
    verdict = _verdict(found, recording, FkmValues(both, origin), options.target)
    write_text(output, motion_text(verdict))
    _print(output, write_report(output, verdict), verdict)
    if mounting is not None:
        _print_mounting(mounting)
    return 0


def _check_outputs(output: Path | None, force: bool) -> None:
    """Raise InputError where the file and its report are not given, or cannot be written."""
    if output is None:
        raise InputError('no -o FILE; expected the parameter file to write')
    for path in (output, *report_paths(output)):
        check_output(path, force)


def _source_values(
    source: str,
    given: dict[str, Any],
) -> dict[str, Any]:
    """Return the checked parameters of a source of raw counts."""
    sensors = encoders.sensors_of(given)
    verified = {'encoders.direction_verified': (True,) * sensors}
    return command_line.checked(
        given | raw_counts(sensors) | verified,
        SOURCE_SETTINGS[source],
        source,
    )


def _drawn(
    options: argparse.Namespace,
    sensors: int,
    mechanism: dict[str, Any],
) -> Layout:
    """Return the rig as drawn, with the tolerances of the command line."""
    return Layout(
        sensors=sensors,
        nominal=geometry_from(mechanism),
        working_mode=mechanism['working_mode'],
        mechanism_tolerance=radians(options.mechanism_tolerance),
        harmonic_tolerance=radians(options.harmonic_tolerance),
    )


def _origin(
    options: argparse.Namespace,
    source: str,
    values: dict[str, Any],
    kept: dict[str, Any],
) -> Origin:
    """
    Return where a calibration comes from.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    source : str
        Name of the source, `can` or `replay`.
    values : dict
        Checked parameters of the source.
    kept : dict
        Settings that the file has beside the calibration.

    Returns
    -------
    Origin
        Date, recording and version.

    """
    logs = options.motion or []
    if source == 'replay' and not logs:
        logs = [Path(values['replay.path'])]
    return Origin(
        date=datetime.now().astimezone().isoformat(timespec='seconds'),
        recording=' + '.join(path.name for path in logs) or source_text(source, values),
        checksum=' '.join(checksum(path) for path in logs),
        version=version('spm_haptic_master'),
        counts_per_turn=values['encoders.counts_per_turn'],
        settings=kept,
    )


def _verdict(
    found: MotionCalibration,
    recording: Recording,
    fkm: FkmValues,
    target_deg: float,
) -> Verdict:
    """
    Return what a calibration is good for.

    Parameters
    ----------
    found : MotionCalibration
        Result of the motion.
    recording : Recording
        Stamps, ns, and angles, rad, by the counts alone.
    fkm : FkmValues
        Parameters of fkm, with the alert limit of the task.
    target_deg : float
        Error of the orientation that was wanted, deg rms.

    Returns
    -------
    Verdict
        The calibration for the largest region that it supports.

    Raises
    ------
    CalibrationError
        The alert limit is not supported, or fkm would not publish the motion.

    """
    with ProgressBar('calibrate') as bar:
        found, limit = supported(found, fkm)
        checked = checked_region(found, fkm, recording[0])
        share = published_share(
            calibration=found,
            recording=recording,
            values=fkm,
            progress=bar.stage,
        )
    return Verdict(found, fkm.origin, limit, share, target_deg, checked)


def _recorded(
    options: argparse.Namespace,
    source: str,
    values: dict[str, Any],
    layout: Layout,
) -> Recording:
    """
    Return the motion of a bus, of a log, or of several logs one after the other.

    On a bus the user is guided until the target error is reached; the frames are kept beside the
    file, as NAME_motion.log.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    source : str
        Name of the source, `can` or `replay`.
    values : dict
        Checked parameters, by name.
    layout : Layout
        The rig as drawn, for the guidance.

    Returns
    -------
    Recording
        Stamps, ns, and angles, rad, by the counts alone.

    """
    output = options.output
    seconds = options.seconds or SECONDS_DEFAULT
    with _guidance_topic(options.remap) as publish:
        first = motion_source.read_motion(
            source,
            values,
            options.seconds,
            SECONDS_DEFAULT,
            'move the handle through its whole '
            'workspace: tilt it in all directions and turn it both ways,\ncalibrate: for '
            f'{seconds:g} s at most; Ctrl-C ends the recording and keeps it',
            _guided(Guide(layout), radians(options.target), publish),
            output.with_name(f'{output.stem}_motion.log'),
        )
    further = [
        motion_source.read_motion(
            'replay',
            values | {'replay.path': str(path)},
            options.seconds,
            SECONDS_DEFAULT,
            '',
        )
        for path in (options.motion or [])[1:]
    ]
    return motion_source.joined([first, *further])


def _calibrated(
    layout: Layout,
    recording: Recording,
    given: dict[str, Any],
    counts_per_turn: Sequence[int],
) -> MotionCalibration:
    """
    Return the calibration of a motion.

    Parameters
    ----------
    layout : Layout
        The rig as drawn, and the meaning of the parameter vector.
    recording : Recording
        Stamps, ns, and angles, rad, by the counts alone.
    given : dict
        Given parameters; `encoders.direction` among them has to be confirmed.
    counts_per_turn : sequence of int
        Counts of each encoder in a turn, N values.

    Returns
    -------
    MotionCalibration
        Result of `calibrate_motion`.

    Raises
    ------
    CalibrationError
        As of `calibrate_motion`, with a hint if a resolution looks wrong.

    """
    stamps, angles = recording
    directions = given.get('encoders.direction')
    try:
        with ProgressBar('calibrate') as bar:
            return calibrate_motion(
                layout=layout,
                stamps=stamps,
                readings=angles,
                given=directions if isinstance(directions, (list, tuple)) else None,
                progress=bar.stage,
            )
    except CalibrationError as error:
        hint = _resolution_hint(layout, recording, counts_per_turn)
        raise CalibrationError(f'{error}{hint}') from error


def _resolution_hint(
    layout: Layout,
    recording: Recording,
    counts_per_turn: Sequence[int],
) -> str:
    """
    Return which smaller resolution makes the motion that of the mechanism.

    It is tried: encoders whose counts stay below it by chance do not have it.

    Parameters
    ----------
    layout : Layout
        The rig as drawn.
    recording : Recording
        Stamps, ns, and angles, rad, by the counts alone.
    counts_per_turn : sequence of int
        Configured counts of each encoder in a turn, N values.

    Returns
    -------
    str
        The hint; empty if there is no smaller resolution, or the motion does not fit by it.

    """
    stamps, angles = recording
    smaller = smaller_resolution(angles, counts_per_turn)
    if smaller is None:
        return ''
    rescaled = angles % TURN * (np.array(counts_per_turn) / smaller)
    try:
        with ProgressBar('calibrate') as bar:
            calibrate_motion(
                layout=layout,
                stamps=stamps,
                readings=rescaled,
                given=None,
                progress=bar.stage,
                swaps=False,
            )
    except CalibrationError:
        return ''
    return (
        f'; no count of the motion reaches {smaller}, and with {smaller} counts per turn it is '
        f'that of the mechanism: encoders.counts_per_turn is {min(counts_per_turn)} '
        '(can_scan prints what the encoders have)'
    )


def _check_references(options: argparse.Namespace, source: str) -> None:
    """
    Raise InputError for orientations from outside that do not fit together.

    --pose excludes --capture; with logs, each --pose needs its --pose-recording.
    """
    poses = options.pose or []
    logs = options.pose_recording or []
    if poses and options.capture is not None:
        raise InputError('--pose and --capture; expected one of the two')
    if source != 'replay' and logs:
        raise InputError(f'--pose-recording with source {source!r}; expected it with replay')
    if source == 'replay' and len(poses) != len(logs):
        raise InputError(
            f'--pose is given {len(poses)} times and --pose-recording '
            f'{len(logs)} times; expected as many'
        )


def _mounted_by(
    options: argparse.Namespace,
    source: str,
    values: dict[str, Any],
    found: MotionCalibration,
) -> Mounted:
    """
    Return a calibration with the mounting by a jig's poses or a motion capture.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    source : str
        Name of the source, `can` or `replay`.
    values : dict
        Checked parameters of the source.
    found : MotionCalibration
        Result of the motion.

    Returns
    -------
    Mounted
        Calibration and mounting.

    Raises
    ------
    CalibrationError
        The device moved at a pose, or the orientations contradict the motion.

    """
    if options.capture is not None:
        turned, outside = _captured(options, found)
        return mounted(found, turned, outside, radians(options.capture_sigma))
    recordings = options.pose_recording or [None] * len(options.pose)
    per_turn = values['encoders.counts_per_turn']
    rows = []
    for number, (pose, recording) in enumerate(zip(options.pose, recordings, strict=True), 1):
        if recording is None:
            motion_source.wait_for_pose(number, len(options.pose), pose)
        counts = motion_source.record_pose(
            source,
            values | ({} if recording is None else {'replay.path': str(recording)}),
            motion_source.POSE_SECONDS,
        )
        rows.append(
            read_still(
                counts=counts,
                counts_per_turn=per_turn,
                noise_limit=radians(options.noise_limit),
                drift_limit=radians(options.drift_limit),
            )[0]
        )
    return mounted(
        found,
        np.array(rows) * TURN / np.array(per_turn) * np.array(found.direction),
        kinematics.matrix_from_zxz(*np.radians(options.pose).T),
        radians(options.jig_error or JIG_SIGMA),
    )


def _captured(
    options: argparse.Namespace,
    found: MotionCalibration,
) -> tuple[Array, Array]:
    """
    Return readings and captured orientations at the same times.

    The clocks are aligned by the motion; orientations `CAPTURE_PERIOD` apart are used.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    found : MotionCalibration
        Result of the motion.

    Returns
    -------
    turned : ndarray, shape (k, N)
        Readings times their directions, rad.
    outside : ndarray, shape (k, 3, 3)
        Captured orientations.

    Raises
    ------
    InputError
        The capture has markers, is of another motion, or was exported wrongly.
    CalibrationError
        Fewer than `CAPTURED_MINIMUM` orientations are at times of the motion.

    """
    capture = _sifted_poses(options.capture, options.capture_topic)
    seconds = found.readings.seconds
    known = np.isfinite(found.rotation).all(axis=(1, 2))
    times = seconds[known]
    quaternions = kinematics.quaternion_from_matrix(found.rotation[known])
    begin = capture.time - capture.time[0]
    fitted = align(
        recorded_time=times,
        recorded=quaternions,
        captured_time=begin,
        captured=capture.values,
        body_known=False,
    )
    rows = np.flatnonzero(known)[:: max(1, int(CAPTURE_PERIOD / np.median(np.diff(times))))]
    at = interpolate(fitted.recorded_time(begin), capture.values, seconds[rows])
    inside = np.isfinite(at).all(axis=1)
    if inside.sum() < CAPTURED_MINIMUM:
        raise CalibrationError(
            f'{options.capture}: {int(inside.sum())} orientations at times of '
            f'the motion; expected at least {CAPTURED_MINIMUM}'
        )
    rows = rows[inside]
    return found.turned[rows], kinematics.matrix_from_quaternion(at[inside])


def _sifted_poses(path: Path, topic: str | None) -> Track:
    """
    Return a captured pose without the rows that no body and no hand can give.

    They are counted on stderr, by reason.

    Parameters
    ----------
    path : Path
        The motion capture.
    topic : str or None
        Topic of the pose in a rosbag2, or name of the rigid body in an export.

    Returns
    -------
    Track
        Unit quaternions x, y, z, w.

    Raises
    ------
    InputError
        The capture has markers, or too few rows are left.

    """
    capture = read_capture(path, topic)
    if capture.values.shape[1] != len('xyzw'):
        raise InputError(
            f'{path}: markers; expected the pose of a body (qx, qy, qz, '
            'qw), as the motion capture computes it'
        )
    sifted = capture_rows.sifted_capture(capture)
    sifted, _ = capture_rows.without_jumps(sifted, sifted.track.values)
    for reason, count in sifted.left_out.items():
        motion_source.say(f'{path}: {count} captured rows left out: {reason}')
    return sifted.track


def _mounting_settings(mounting: Mounted) -> dict[str, Any]:
    """Return the parameters of a mounting, deg; that of the handle only if it was estimated."""
    return {
        f'mounting.{part}_zxz_deg': tuple(
            round(degrees(float(angle)), 6) for angle in kinematics.zxz_from_matrix(rotation)
        )
        for part, rotation in (('base', mounting.base), ('handle', mounting.handle))
        if part == 'base' or mounting.handle_deviations.any()
    }


def _print_mounting(mounting: Mounted) -> None:
    """Print how well the orientations from outside determine the mounting, and their residual."""
    for name, deviations in (
        ('base', mounting.base_deviations),
        ('handle', mounting.handle_deviations),
    ):
        if deviations.any():
            print(
                f'  mounting of the {name}: standard deviations '
                f'{" ".join(f"{degrees(each):.3f}" for each in deviations)} deg'
            )
    print(f'  residual of the orientations from outside: {degrees(mounting.rms):.3f} deg rms')


def _guidance_topic(remaps: Sequence[str]) -> AbstractContextManager[Publish]:
    """
    Return the publisher of the guidance, which `view` shows.

    Parameters
    ----------
    remaps : sequence of str
        Remappings of the command line.

    Returns
    -------
    AbstractContextManager[Publish]
        Context with a function of instruction and shares; without rclpy it publishes nothing.

    """
    try:
        from spm_haptic_master.nodes.guidance_publisher import published
    except ImportError:
        return nullcontext(lambda text, covered: None)
    return published(remaps)


def _guided(
    guide: Guide,
    target: float,
    publish: Publish,
) -> motion_source.Evaluate:
    """
    Return an evaluation that shows the guidance, and ends at a target error.

    Parameters
    ----------
    guide : Guide
        Evaluates the motion so far.
    target : float
        Predicted error of the orientations at which the recording ends, rad rms.
    publish : callable
        Takes the instruction and the shares of what it needs.

    Returns
    -------
    motion_source.Evaluate
        Evaluation for `motion_source.read_motion`.

    """

    def evaluate(
        bar: ProgressBar,
        source: EncoderSource,
        recording: Recording,
        seconds: float,
    ) -> bool:
        """Show and publish the guidance; return whether the target is reached."""
        found = guide.evaluate(*recording)
        # The information there is, over that of the target: the inverse variance.
        if found.error is None:
            share = 0.0
        else:
            share = min(1.0, (target / found.error) ** 2)
        text = motion_source.with_trouble(
            f'{seconds:.0f} s, {len(recording[0])} sets: {found.text}', source
        )
        bar.stage(text, share)
        publish(text, {'precision': share, **found.covered})
        return found.error is not None and found.error <= target

    return evaluate


def kept_settings(
    source: str,
    given: dict[str, object],
    values: dict[str, Any],
    mechanism: dict[str, Any],
) -> dict[str, Any]:
    """
    Return the settings that the file has beside the calibration.

    Those of the bus that were given, and the frames of the encoders, with which it was measured:
    the file works by itself.

    Parameters
    ----------
    source : str
        Name of the source, `can` or `replay`.
    given : dict of str to object
        Given parameters, by name.
    values : dict
        Checked parameters of the source.
    mechanism : dict
        Checked parameters of the mechanism.

    Returns
    -------
    dict
        Values by name; `working_mode` only where it is not the default.

    """
    layout = {setting.name for setting in encoders.LAYOUT_SETTINGS}
    kept: dict[str, Any] = {'source': 'can'} if source == 'can' else {}
    kept |= {
        setting.name: values[setting.name]
        for setting in encoders.for_sensors(encoders.CAN_SETTINGS, values['sensors'])
        if (setting.name in given or setting.name in layout)
        and setting.name in values
        and setting.name not in DETERMINED
    }
    if mechanism['working_mode'] != (1, 1, 1):
        kept['working_mode'] = mechanism['working_mode']
    return kept


def _print(
    path: Path,
    report: str,
    verdict: Verdict,
) -> None:
    """
    Print what was written; what it is good for comes last.

    Parameters
    ----------
    path : Path
        The parameter file.
    report : str
        What was written beside it, in words.
    verdict : Verdict
        The calibration, and what it is good for.

    """
    found = verdict.calibration
    readings = verdict.calibration.readings
    print(f'{path}: written; {report}')
    print(
        f'  {readings.sets} sets in {readings.seconds[-1]:.1f} s, {readings.spikes} left out as '
        f'spikes, {100.0 * found.cut:.1f} % of the samples cut'
    )
    for joint, direction, noise, bias in zip(
        ALL_JOINT_NAMES,
        found.direction,
        found.noise,
        found.bias,
        strict=False,
    ):
        print(
            f'  {joint}: direction {direction:+d}, sigma {degrees(noise):.4f} deg, bias '
            f'{degrees(bias):.2f} deg'
        )
    for group, reason in found.left.items():
        print(f'  {group} left as drawn: {reason}')
    print(f'  parity_bias {degrees(found.parity_bias):.2f} deg')
    for line in verdict.checked.lines:
        print(f'  {line}')
    print(
        f'  with alert_limit_deg {verdict.checked.alert_limit_deg:g}; from '
        f'{verdict.checked.least_limit_deg:.2f} on every sensor is checked somewhere'
    )
    for caution in verdict.cautions:
        print(f'  CAUTION, {caution}')
    print(f'  a further motion that would determine more: {found.advice}')
    print(f'  {100.0 * verdict.published:.2f} % of the motion published by fkm with this file')
    default = float(command_line.checked({}, FKM_SETTINGS)['alert_limit_deg'])
    if verdict.alert_limit_deg > default:
        print(
            f'fkm needs alert_limit_deg {verdict.alert_limit_deg:g} or more: where rig.yaml sets '
            f'none it is {default:g}, and less is published'
        )
    print(f'{verdict.reached}\n{verdict.text}')
