# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of calibrate that checks by a motion whether a calibration still holds."""

from __future__ import annotations

import argparse
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.calibration_check import CalibrationChecker, Check
from spm_haptic_master.calibration.motion.readings import motion_readings, MotionReadings
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.fkm import FKM_SETTINGS, limits_from, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.motion_source import given_for_motion, read_motion
from spm_haptic_master.tools.progress_bar import ProgressBar

# Length of a live recording (s).
SECONDS_DEFAULT = 20.0
# What makes a parameter file a calibration.
NEEDED = ('encoders.zero_count', 'encoders.direction', 'sigma_deg', 'bias_deg')


def run(options: argparse.Namespace) -> int:
    """Check a calibration by a motion; 1 if it does not hold. Errors as SpmError."""
    path = options.check
    if options.output is not None:
        raise InputError(f'-o {options.output} with --check {path}; expected one of them: a check '
                         'writes nothing')
    of_file = read_parameters(path)
    missing = [name for name in NEEDED if name not in of_file]
    if missing:
        raise InputError(f'--check {path}: it has no {", ".join(missing)}; expected a file that '
                         'calibrate wrote')
    options.params_file.append(str(path))
    source, given = given_for_motion(options, 'check')
    values = command_line.checked(given, SOURCE_SETTINGS[source], source)
    settings = command_line.checked(given, FKM_SETTINGS)
    stamps, angles = read_motion(
        source, values, options.seconds, SECONDS_DEFAULT, 'tilt the handle in all directions and '
        f'turn it both ways, for {options.seconds or SECONDS_DEFAULT:g} s; Ctrl-C ends the '
        'recording and keeps it')
    _check_moves(angles)
    readings = motion_readings(stamps, angles)
    sigma = np.maximum(sigma_from(settings), readings.noise) / np.sqrt(readings.together)
    with ProgressBar('calibrate') as bar:
        found = CalibrationChecker(
            sigma, np.array(limits_from(settings).bias), geometry_from(settings),
            settings['working_mode'], bar.stage).check(readings.readings)
    _print(path, found, readings, settings)
    if not found.holds:
        raise CalibrationError(f'{path} does not hold: {found.text}')
    return 0


def _check_moves(angles: NDArray[np.float64]) -> None:
    """Raise CalibrationError for an encoder that repeats one value."""
    for name, column in zip(ALL_JOINT_NAMES, angles.T, strict=False):
        if len(column) and np.ptp(column) == 0.0:
            raise CalibrationError(f'{name} repeats one value, {degrees(column[0]):.2f} deg; '
                                   'expected a motion of every joint')


def _print(path: Path, found: Check, readings: MotionReadings, settings: dict[str, Any]) -> None:
    """Print the figures."""
    verdict, each = 'holds' if found.holds else 'does not hold', found.evaluation
    print(f'{path}: {verdict}; {readings.sets} sets in {readings.seconds[-1]:.1f} s, '
          f'{readings.spikes} left out as spikes, {each.poses if each else 0} poses')
    if each is None:
        print(f'  only {100.0 * found.usable:.0f} % of the angles fit the mechanism')
        return
    print(f'  slow parity {degrees(each.slow):.4f} deg rms; noise alone '
          f'{degrees(each.white):.4f}, noise and bias_deg {degrees(each.expected):.4f}')
    print(f'  figure of merit {each.merit:.2f} (1: as large as noise and bias_deg explain)')
    sigma = sigma_from(settings)
    for index, name in enumerate(ALL_JOINT_NAMES[:len(sigma)]):
        print(f'  {name}: if it alone slipped {degrees(each.slip[index]):+.3f} deg '
              f'+- {degrees(each.deviation[index]):.3f}, least that shows '
              f'{degrees(each.visible[index]):.3f}; noise {degrees(readings.noise[index]):.4f} '
              f'deg, sigma_deg {degrees(sigma[index]):.4f}')
