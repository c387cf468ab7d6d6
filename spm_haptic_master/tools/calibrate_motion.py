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

import spm_haptic_master
from spm_haptic_master.calibration.calibration_file import write_text
from spm_haptic_master.calibration.free_motion import MotionCalibration, MotionCalibrator
from spm_haptic_master.calibration.mechanism_parameters import Tolerances
from spm_haptic_master.calibration.motion_file import motion_text, Origin
from spm_haptic_master.calibration.motion_guide import Guidance, Guide
from spm_haptic_master.calibration.motion_recording import read_log, record_motion, Recording
from spm_haptic_master.calibration.motion_report import write_report
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.encoders.settings import (
    BUS_SETTINGS,
    for_sensors,
    HARMONIC_SETTINGS,
    LAYOUT_SETTINGS,
    sensors_of,
)
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.geometry_settings import geometry_from
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameter_files import source_defaults
from spm_haptic_master.source_factory import (
    make_replay,
    make_source,
    MECHANISM_SETTINGS,
    SOURCE_SETTINGS,
    source_text,
)
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.progress_bar import CountBar, StageBar

# Longest motion (s), and predicted error at which a recording ends by itself (deg).
SECONDS_DEFAULT, TARGET_DEFAULT = 120.0, 0.04
# Settings that the calibration itself determines.
DETERMINED = {'encoders.direction', 'encoders.direction_verified', 'encoders.zero_count',
              'encoders.counts_per_turn', *(setting.name for setting in HARMONIC_SETTINGS)}


def run(options: argparse.Namespace) -> int:
    """Calibrate from free motion; errors as SpmError."""
    output = options.output
    given = command_line.given(options)
    source = str(given.get('source', 'can'))
    check_output(output, source, options.force)
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
    origin = Origin(
        datetime.now().astimezone().isoformat(timespec='seconds'),
        source_text(source, values).removeprefix('replay: '),
        _checksum(values['replay.path']) if source == 'replay' else '',
        spm_haptic_master.__version__, values['encoders.counts_per_turn'],
        _kept(source, given, values, mechanism))
    write_text(output, motion_text(found, origin))
    report = write_report(output, found, origin)
    _print(output, found, origin, report)
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


def _print(path: Path, found: MotionCalibration, origin: Origin, report: str) -> None:
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
