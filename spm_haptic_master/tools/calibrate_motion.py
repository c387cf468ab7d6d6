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

from spm_haptic_master.calibration.calibration_file import check_output, write_text
from spm_haptic_master.calibration.motion.calibration import motion_text, Origin, Verdict
from spm_haptic_master.calibration.motion.free_motion import calibrate_motion, Guide
from spm_haptic_master.calibration.motion.mechanism_parameters import Layout
from spm_haptic_master.calibration.recording import raw_counts, Recording
from spm_haptic_master.calibration.report import check_report, checksum, write_report
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.encoders import (
    ACCEPT_SETTING,
    CAN_SETTINGS,
    for_sensors,
    HARMONIC_SETTINGS,
    LAYOUT_SETTINGS,
    sensors_of,
    VERIFIED_SETTING,
)
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import geometry_from, MECHANISM_SETTINGS
from spm_haptic_master.parameters.nodes import DRIVER_NAMES, SOURCE_SETTINGS
from spm_haptic_master.parameters.setting import CALIBRATION_SETTING, SENSORS_SETTING
from spm_haptic_master.simulation.source_factory import source_text
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.calibration_verdict import FkmValues, published_share, supported
from spm_haptic_master.tools.motion_source import Evaluate, given_for_motion, read_motion
from spm_haptic_master.tools.outside_orientations import (
    check_references,
    mounted_by,
    mounting_settings,
    print_mounting,
)
from spm_haptic_master.tools.progress_bar import ProgressBar, with_trouble

# Takes an instruction and the shares of what it needs, 0 .. 1, by name.
Publish = Callable[[str, Mapping[str, float]], None]
# Longest motion (s), and predicted error at which a recording ends by itself (deg).
SECONDS_DEFAULT, TARGET_DEFAULT = 120.0, 0.04
# Settings that the calibration's file has in any case.
DETERMINED = {CALIBRATION_SETTING.name, SENSORS_SETTING.name, VERIFIED_SETTING.name,
              ACCEPT_SETTING.name, 'encoders.direction', 'encoders.zero_count',
              'encoders.counts_per_turn', *(setting.name for setting in HARMONIC_SETTINGS)}


def run(options: argparse.Namespace) -> int:
    """Calibrate from free motion; errors as SpmError."""
    source, both = given_for_motion(options, 'calibrate')
    given = {name: value for name, value in both.items() if name in DRIVER_NAMES}
    output = options.output
    if output is None:
        raise InputError('no -o FILE; expected the parameter file to write')
    check_output(output, options.force)
    check_report(output, options.force)
    check_references(options, source)
    sensors = sensors_of(given)
    values = command_line.checked(
        given | raw_counts(sensors) | {'encoders.direction_verified': (True,) * sensors},
        SOURCE_SETTINGS[source], source)
    mechanism = command_line.checked(given, MECHANISM_SETTINGS)
    layout = Layout(sensors, geometry_from(mechanism), mechanism['working_mode'],
                    radians(options.mechanism_tolerance), radians(options.harmonic_tolerance))
    seconds = options.seconds or SECONDS_DEFAULT
    with _guidance_topic(options.remap) as publish:
        stamps, angles = read_motion(
            source, values, options.seconds, SECONDS_DEFAULT, 'move the handle through its whole '
            'workspace: tilt it in all directions and turn it both ways,\ncalibrate: for '
            f'{seconds:g} s at most; Ctrl-C ends the recording and keeps it',
            _guided(Guide(layout), radians(options.target), publish),
            output.with_name(f'{output.stem}_motion.log'))
    directions = given.get('encoders.direction')
    with ProgressBar('calibrate') as bar:
        found = calibrate_motion(
            layout, stamps, angles, directions if isinstance(directions, (list, tuple)) else None,
            bar.stage)
    mounting = None
    if options.pose or options.capture is not None:
        mounting = mounted_by(options, source, values, found)
        found = mounting.calibration
    origin = Origin(
        datetime.now().astimezone().isoformat(timespec='seconds'),
        source_text(source, values).removeprefix('replay: '),
        checksum(Path(values['replay.path'])) if source == 'replay' else '',
        version('spm_haptic_master'), values['encoders.counts_per_turn'],
        kept_settings(source, given, values, mechanism) | mounting_settings(mounting))
    fkm = FkmValues(both, origin)
    with ProgressBar('calibrate') as bar:
        found, limit = supported(found, fkm)
        share = published_share(found, (stamps, angles), fkm, bar.stage)
    verdict = Verdict(found, origin, limit, share, options.target)
    write_text(output, motion_text(verdict))
    _print(output, write_report(output, verdict), verdict)
    if mounting is not None:
        print_mounting(mounting)
    return 0


def _guidance_topic(remaps: Sequence[str]) -> AbstractContextManager[Publish]:
    """Return what publishes the state for `view`: without rclpy only the terminal shows it."""
    try:
        from spm_haptic_master.nodes.guidance_publisher import published
    except ImportError:
        return nullcontext(lambda text, covered: None)
    return published(remaps)


def _guided(guide: Guide, target: float, publish: Publish) -> Evaluate:
    """Return what shows how to go on; a motion is enough at an error, rad, of the target."""
    def evaluate(bar: ProgressBar, source: EncoderSource, recording: Recording,
                 seconds: float) -> bool:
        found = guide.evaluate(*recording)
        # The information there is, over that of the target: the inverse variance.
        share = 0.0 if found.error is None else min(1.0, (target / found.error) ** 2)
        text = with_trouble(f'{seconds:.0f} s, {len(recording[0])} sets: {found.text}', source)
        bar.stage(text, share)
        publish(text, {'precision': share, **found.covered})
        return found.error is not None and found.error <= target

    return evaluate


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


def _print(path: Path, report: str, verdict: Verdict) -> None:
    """Print what was written; what it is good for comes last."""
    found, readings = verdict.calibration, verdict.calibration.readings
    print(f'{path}: written; {report}')
    print(f'  {readings.sets} sets in {readings.seconds[-1]:.1f} s, {readings.spikes} left out as '
          f'spikes, {100.0 * found.cut:.1f} % of the samples cut')
    for index, joint in enumerate(ALL_JOINT_NAMES[:found.layout.sensors]):
        print(f'  {joint}: direction {found.direction[index]:+d}, sigma '
              f'{degrees(found.noise[index]):.4f} deg, bias {degrees(found.bias[index]):.2f} deg')
    for group, reason in found.left.items():
        print(f'  {group} left as drawn: {reason}')
    for caution in found.cautions:
        print(f'  CAUTION, {caution}')
    print(f'  a further motion that would determine more: {found.advice}')
    print(f'  {100.0 * verdict.published:.2f} % of the motion published by fkm with this file')
    default = float(command_line.checked({}, FKM_SETTINGS)['alert_limit_deg'])
    if verdict.alert_limit_deg > default:
        print(f'fkm needs alert_limit_deg {verdict.alert_limit_deg:g} or more in rig.yaml: with '
              f'its default, {default:g}, it publishes less')
    print(f'{verdict.reached}\n{verdict.text}')
