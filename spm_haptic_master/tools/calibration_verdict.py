# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The alert limit that a calibration supports in fkm, and whether it holds for a motion."""

from __future__ import annotations

import argparse
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import degrees, inf, tau
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.calibration import MotionCalibration
from spm_haptic_master.calibration.motion.calibration_check import CalibrationChecker, Check
from spm_haptic_master.calibration.motion.coverage import Region, region_of, WORKSPACE
from spm_haptic_master.calibration.motion.model import Array
from spm_haptic_master.calibration.motion.motion_file import Checked, motion_parameters, Origin
from spm_haptic_master.calibration.motion.readings import motion_readings, MotionReadings
from spm_haptic_master.calibration.recording import Recording
from spm_haptic_master.encoders.decoder_factory import make_harmonics
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.rotations import wrapped
from spm_haptic_master.parameters.fkm import FKM_SETTINGS, limits_from, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.supervision.checkability import checkability
from spm_haptic_master.supervision.recording import run, Supervised
from spm_haptic_master.supervision.symptom import Reason, with_remedy
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.command_line import ProgressBar
from spm_haptic_master.tools.motion_source import FKM_NAMES, given_for_motion, read_motion

# Least share of a motion that has to be published (unit 1).
PUBLISHED = 0.99
# Alert limits that a calibration may be good for (deg).
ALERT_LIMITS_DEG = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0)
# Predicted error of the orientation beyond which no file is written for a region (deg rms).
ERROR_LIMIT_DEG = 0.5
# Simulated motion through a region: length (s), rate (Hz), and periods of azimuth, tilt and
# self-rotation (s), which are no multiples of each other.
SECONDS = 20.0
RATE = 100.0
PERIODS = 2.9, 7.1, 9.7
# Length of a live recording for a check (s).
SECONDS_DEFAULT = 20.0
# What makes a parameter file a calibration.
NEEDED = ('encoders.zero_count', 'encoders.direction', 'sigma_deg', 'bias_deg')


@dataclass(frozen=True, slots=True)
class FkmValues:
    """
    The parameters that fkm has with a calibration and what the user gave.

    Attributes
    ----------
    given : dict
        Given parameters, by name; those of the calibration override them.
    origin : Origin
        Where the calibration comes from.

    """

    given: dict[str, Any]
    origin: Origin

    def of(self, calibration: MotionCalibration) -> dict[str, Any]:
        """
        Return the values that fkm has with a calibration.

        Parameters
        ----------
        calibration : MotionCalibration
            Result of a calibration from free motion.

        Returns
        -------
        dict
            Checked parameters of fkm, by name.

        """
        given = {
            name: value for name, value in self.given.items() if not name.startswith('geometry.')
        }
        values = given | motion_parameters(calibration, self.origin)
        return command_line.checked(
            {name: values[name] for name in FKM_NAMES & values.keys()}, FKM_SETTINGS
        )

    def angles(self, calibration: MotionCalibration, readings: Array) -> Array:
        """
        Return the joint angles that the driver makes of raw readings with a calibration.

        Parameters
        ----------
        calibration : MotionCalibration
            Result of a calibration from free motion.
        readings : ndarray, shape (n, N)
            Angles by the counts alone, rad.

        Returns
        -------
        ndarray, shape (n, N)
            Joint angles, rad, with the rounding of the file.

        """
        values = command_line.checked(
            motion_parameters(calibration, self.origin) | {'replay.path': self.origin.recording},
            SOURCE_SETTINGS['replay'],
            'replay',
        )
        found = np.empty_like(readings)
        for sensor, harmonics in enumerate(make_harmonics(values)):
            zero = (
                values['encoders.zero_count'][sensor]
                * tau
                / values['encoders.counts_per_turn'][sensor]
            )
            angle = wrapped(values['encoders.direction'][sensor] * (readings[:, sensor] - zero))
            if harmonics is None:
                found[:, sensor] = angle
            else:
                found[:, sensor] = harmonics.angles(angle)
        return found


def supported(
    calibration: MotionCalibration,
    values: FkmValues,
) -> tuple[MotionCalibration, float]:
    """
    Return a calibration for the largest region that it supports.

    First the workspace is tried, then the region that the motion went through, if it is large
    enough.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.
    values : FkmValues
        Parameters of fkm; `alert_limit_deg` is that of the task.

    Returns
    -------
    calibration : MotionCalibration
        The calibration, with that region.
    limit : float
        Least alert limit that it supports there, deg.

    Raises
    ------
    CalibrationError
        No region supports `alert_limit_deg`; the text says what would help most.

    """
    limit = float(values.of(calibration)['alert_limit_deg'])
    moved = region_of(calibration.rotation)
    least = inf
    for region in (WORKSPACE, moved) if moved.is_large else (WORKSPACE,):
        candidate = calibration
        if region != calibration.region:
            candidate = replace(calibration, region=region)
        if degrees(candidate.region_error) > ERROR_LIMIT_DEG:
            continue
        supports = least_alert_limit(candidate, values)
        if supports <= limit:
            return candidate, supports
        least = min(least, supports)
    raise _unsupported(calibration, moved, limit, least)


def _unsupported(
    calibration: MotionCalibration,
    moved: Region,
    limit: float,
    least: float,
) -> CalibrationError:
    """
    Return the error for a calibration that supports the alert limit in no region.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.
    moved : Region
        The region that the motion went through.
    limit : float
        The alert limit, deg.
    least : float
        Least alert limit that a region supports, deg; inf if there is none.

    Returns
    -------
    CalibrationError
        What would help most, and the bounds as they are.

    """
    # No further motion mends a rig that is not the model's.
    cure = calibration.misfit or calibration.unusual or cure_text(calibration)
    more = ''
    if least < inf:
        more = f'; a task that tolerates more may take -p alert_limit_deg:={least:g}'
    bias = ' '.join(f'{each:.2f}' for each in np.degrees(calibration.bias))
    return CalibrationError(
        f'the motion does not support alert_limit_deg {limit:g}: {cure}{more} (bias_deg over the '
        f'workspace is {bias}, noise '
        f'up to {degrees(calibration.noise.max()):.2f} deg; the region moved, '
        f'{moved.text}, {"is no better" if moved.is_large else "is too small"})'
    )


def cure_text(calibration: MotionCalibration) -> str:
    """
    Return what to do about bounds that are too large, the best first, and what it costs.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.

    Returns
    -------
    str
        One or two phrases with the factors by which the predicted error falls.

    """
    cures = sorted(calibration.cures.items(), key=lambda cure: -cure[1])
    (best, gain), *others = cures
    rest = ', '.join(f'{name} by {factor:.1f}' for name, factor in others)
    return (
        f'{best} divides the predicted error by {gain:.1f} ({rest}); record only what is missing, '
        'and join both by --motion FIRST.log SECOND.log'
    )


def least_alert_limit(calibration: MotionCalibration, values: FkmValues) -> float:
    """
    Return the least alert limit that a calibration supports over its region.

    It is the smallest of `ALERT_LIMITS_DEG` and the given one, by bisection, with which fkm
    publishes `PUBLISHED` of a simulated motion.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.
    values : FkmValues
        Parameters of fkm.

    Returns
    -------
    float
        Alert limit, deg; inf where none suffices.

    """
    stamps, angles = _simulated(calibration)
    fkm = values.of(calibration)
    tried = sorted({*ALERT_LIMITS_DEG, float(fkm['alert_limit_deg'])})

    def suffices(limit: float) -> bool:
        """Return whether fkm publishes enough of the motion with an alert limit, deg."""
        result = run(
            stamps,
            angles,
            fkm | {'alert_limit_deg': limit},
            most_withheld=(1.0 - PUBLISHED) * len(stamps),
        )
        return bool(result.published.mean() >= PUBLISHED)

    return [*tried, inf][bisect_left(tried, True, key=suffices)]


def checked_region(
    calibration: MotionCalibration,
    values: FkmValues,
    stamps: NDArray[np.int64],
) -> Checked:
    """
    Return where in its region each sensor is checked by the others.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.
    values : FkmValues
        Parameters of fkm.
    stamps : ndarray of int, shape (n,)
        Recorded times, ns, which give the rate.

    Returns
    -------
    Checked
        Share of the region for each sensor, and the least limit with which all are checked
        somewhere.

    Raises
    ------
    CalibrationError
        `start_checked` is true, and a sensor is checked nowhere: nothing would be published.

    """
    fkm = values.of(calibration)
    found = checkability(
        geometry=calibration.layout.geometry(calibration.vector),
        sigma=sigma_from(fkm),
        limits=limits_from(fkm),
        poses=calibration.region.poses(calibration.model, calibration.vector),
        rate=1e9 / float(np.median(np.diff(stamps))),
        working_mode=calibration.layout.working_mode,
    )
    checked = Checked(
        alert_limit_deg=float(fkm['alert_limit_deg']),
        share=found.share,
        least_limit_deg=degrees(max(found.least_limit)),
    )
    if checked.caution and fkm['start_checked']:
        raise CalibrationError(f'start_checked is true, but {checked.caution}')
    return checked


def published_share(
    calibration: MotionCalibration,
    recording: Recording,
    values: FkmValues,
    progress: Callable[[str, float], None],
) -> float:
    """
    Return the share of the recorded motion that fkm publishes with a calibration.

    Sets with a spike, which no calibration can mend, are left out; so are those that fkm withholds
    as it starts, at the begin and after a gap of the recording.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.
    recording : Recording
        Stamps, ns, and angles, rad, by the counts alone.
    values : FkmValues
        Parameters of fkm.
    progress : callable
        Takes the stage and the share that is done.

    Returns
    -------
    float
        Share, 0 to 1.

    Raises
    ------
    CalibrationError
        It is less than `PUBLISHED`; the most frequent reason is given.

    """
    good = ~calibration.readings.spiked
    stamps = recording[0][good]
    readings = recording[1][good]
    result = run(
        stamps,
        values.angles(calibration, readings),
        values.of(calibration),
        lambda done: progress('supervision of the motion', done / len(stamps)),
    )
    judged = len(stamps) - _starts(result)
    if judged:
        share = float(result.published.sum()) / judged
    else:
        share = 0.0
    if share < PUBLISHED:
        raise CalibrationError(
            f'with this calibration fkm publishes {100.0 * share:.1f} % of the motion, expected '
            f'{100.0 * PUBLISHED:g} % at least: {_reason(result)}; nothing is written'
        )
    return share


def _reason(result: Supervised) -> str:
    """Return the most frequent reason of silence; the start, which follows others, comes last."""
    reason, count = max(
        result.reasons.items(), key=lambda each: (each[0] != Reason.STARTING.value, each[1])
    )
    return f'{with_remedy(reason, reason)} ({count} {"sample" if count == 1 else "samples"})'


def _starts(result: Supervised) -> int:
    """
    Return how many samples are withheld by nothing but a start.

    The supervision starts at the begin and after a gap. A start after any other reason of silence
    follows samples that are withheld, and is not counted.
    """
    published = result.published
    state = result.state
    ends = [index for index, _ in state[1:]] + [len(published)]
    return sum(
        end - begin
        for (begin, text), end in zip(state, ends, strict=True)
        if text == Reason.STARTING.value
        if begin == 0 or published[begin - 1]
        if end == len(published) or published[end]
    )


def _simulated(calibration: MotionCalibration) -> tuple[NDArray[np.int64], Array]:
    """
    Return a motion through the region of a calibration, without noise.

    Direction, tilt and self-rotation have periods that are no multiples of each other.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.

    Returns
    -------
    stamps : ndarray of int, shape (n,)
        Times, ns.
    angles : ndarray, shape (n, N)
        Joint angles, rad, of the poses within reach.

    """
    region = calibration.region
    t = np.arange(int(SECONDS * RATE)) / RATE
    around, out, about = (tau * t / period for period in PERIODS)
    middle = 0.5 * (region.from_deg + region.to_deg)
    half = 0.5 * (region.to_deg - region.from_deg)
    poses = workspace_pose(
        np.radians(region.tilt_deg) * (0.5 - 0.5 * np.cos(out)),
        around,
        np.radians(middle + half * np.sin(about)),
    )
    angles = calibration.model.joint_angles(poses, calibration.layout.geometry(calibration.vector))
    within = np.isfinite(angles).all(axis=1)
    return (t[within] * 1e9).astype(np.int64), angles[within]


def check(options: argparse.Namespace) -> int:
    """
    Check a calibration by a motion; it writes nothing.

    The motion is from the bus, for --seconds, or from a log. The file of --check gives the
    parameters, and what is printed says for each sensor how far it slipped if it alone did.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    int
        Exit code 0: the calibration holds.

    Raises
    ------
    InputError
        -o is given, the file is not one of calibrate, or another argument is wrong.
    CalibrationError
        The calibration does not hold, or the motion is too small to decide.

    """
    path = options.check
    if options.output is not None:
        raise InputError(
            f'-o {options.output} with --check {path}; expected one of them: a check '
            'writes nothing'
        )
    of_file = read_parameters(path)
    missing = [name for name in NEEDED if name not in of_file]
    if missing:
        raise InputError(
            f'--check {path}: it has no {", ".join(missing)}; expected a file that calibrate wrote'
        )
    options.params_file.append(str(path))
    source, given = given_for_motion(options, 'check')
    values = command_line.checked(given, SOURCE_SETTINGS[source], source)
    settings = command_line.checked(given, FKM_SETTINGS)
    stamps, angles = read_motion(
        source=source,
        values=values,
        given=options.seconds,
        live_seconds=SECONDS_DEFAULT,
        instruction='tilt the handle in all directions and '
        f'turn it both ways, for {options.seconds or SECONDS_DEFAULT:g} s; Ctrl-C ends the '
        'recording and keeps it',
    )
    readings = motion_readings(stamps, angles)
    sigma = np.maximum(sigma_from(settings), readings.noise) / np.sqrt(readings.together)
    with ProgressBar('calibrate') as bar:
        found = CalibrationChecker(
            sigma=sigma,
            bias=np.array(limits_from(settings).bias),
            geometry=geometry_from(settings),
            working_mode=settings['working_mode'],
            progress=bar.stage,
        ).check(readings.readings)
    _print(path, found, readings, settings)
    if not found.holds:
        raise CalibrationError(f'{path} does not hold: {found.text}')
    return 0


def _print(
    path: Path,
    found: Check,
    readings: MotionReadings,
    settings: dict[str, Any],
) -> None:
    """Print the result of a check, with slip and noise of each sensor."""
    verdict = 'holds' if found.holds else 'does not hold'
    each = found.evaluation
    print(
        f'{path}: {verdict}; {readings.sets} sets in {readings.seconds[-1]:.1f} s, '
        f'{readings.spikes} left out as spikes, {each.poses if each else 0} poses'
    )
    if each is None:
        print(f'  only {100.0 * found.usable:.0f} % of the angles fit the mechanism')
        return
    print(
        f'  slow parity {degrees(each.slow):.4f} deg rms; noise alone '
        f'{degrees(each.white):.4f}, noise and bias_deg {degrees(each.expected):.4f}'
    )
    print(f'  figure of merit {each.merit:.2f} (1: as large as noise and bias_deg explain)')
    sigma = sigma_from(settings)
    for index, name in enumerate(ALL_JOINT_NAMES[: len(sigma)]):
        print(
            f'  {name}: if it alone slipped {degrees(each.slip[index]):+.3f} deg '
            f'+- {degrees(each.deviation[index]):.3f}, least that shows '
            f'{degrees(each.visible[index]):.3f}; noise {degrees(readings.noise[index]):.4f} '
            f'deg, sigma_deg {degrees(sigma[index]):.4f}'
        )
