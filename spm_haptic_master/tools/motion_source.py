# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of a motion or a pose for calibrate, from a log at once or from a bus."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import closing
from math import inf
from pathlib import Path
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.recording import raw_counts, read_log, record, Recording
from spm_haptic_master.encoders.can_source import CanSource
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.recording_files import FrameLog, free_path
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.nodes import DRIVER_NAMES
from spm_haptic_master.simulation.source_factory import make_replay, make_source
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.command_line import ProgressBar

# Shows the state of a live source's recording, which has lasted some s; returns whether it is
# enough.
Evaluate = Callable[[ProgressBar, EncoderSource, Recording, float], bool]

# Time between two recordings that are joined (s).
BETWEEN = 1.0
# Length of a recording at a pose of a jig (s).
POSE_SECONDS = 5.0
# Time between two updates of a pose's bar (s).
POSE_PERIOD = 0.1
# Nodes whose parameters the evaluation of a motion takes, and the names of these.
NODES = ('encoder_driver', 'fkm')
FKM_NAMES = {setting.name for setting in FKM_SETTINGS}


def check_source(source: str, nothing_to: str) -> None:
    """
    Raise InputError for a source that has no motion of a real device.

    Parameters
    ----------
    source : str
        Name of the source.
    nothing_to : str
        What the program does with a motion, for the error.

    Raises
    ------
    InputError
        It is neither `can` nor `replay`.

    """
    if source not in ('can', 'replay'):
        raise InputError(
            f"parameter 'source' is {source!r}; expected can or replay "
            f'(a simulation has nothing to {nothing_to})'
        )


def joined(recordings: Sequence[Recording]) -> Recording:
    """
    Return recordings of several motions of one rig as one, in their order.

    A recording that is not later than the one before begins `BETWEEN` s after it: only the times
    within a recording matter.

    Parameters
    ----------
    recordings : sequence of Recording
        Stamps, ns, and angles, rad, of each motion.

    Returns
    -------
    Recording
        One recording with increasing stamps.

    """
    stamps = [recordings[0][0]]
    for later, _ in recordings[1:]:
        earliest = int(stamps[-1][-1]) + round(BETWEEN * 1e9)
        stamps.append(later + max(0, earliest - int(later[0])))
    return np.concatenate(stamps), np.concatenate([angles for _, angles in recordings])


def given_for_motion(
    options: argparse.Namespace,
    nothing_to: str,
) -> tuple[str, dict[str, Any]]:
    """
    Return the source of a motion and the given parameters.

    --motion with logs is the source `replay`.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    nothing_to : str
        What the program does with a motion, for the error.

    Returns
    -------
    source : str
        `can` or `replay`.
    given : dict
        Given parameters of driver and fkm, by name.

    Raises
    ------
    InputError
        The source has no motion of a real device, or as of `command_line.given`.

    """
    given = command_line.given(options, NODES, DRIVER_NAMES | FKM_NAMES)
    if options.motion:
        source = 'replay'
    else:
        source = str(given.get('source', 'can'))
    if options.motion:
        given['replay.path'] = str(options.motion[0])
    check_source(source, nothing_to)
    return source, given


def read_motion(
    source: str,
    values: dict[str, Any],
    given: float | None,
    live_seconds: float,
    instruction: str,
    evaluate: Evaluate | None = None,
    keep: Path | None = None,
) -> Recording:
    """
    Return the recording of a motion, of a log at once or of a bus while it happens.

    On a bus the user reads the instruction first, and the frames are written to a log while they
    come.

    Parameters
    ----------
    source : str
        `can` or `replay`.
    values : dict
        Checked parameters of the source.
    given : float or None
        Longest time that the user has given, s; without one it is the whole log, or `live_seconds`
        of a bus.
    live_seconds : float
        Longest time on a bus where the user has given none, s.
    instruction : str
        What the user is asked to do.
    evaluate : Evaluate or None, optional
        Shows the state of a live recording, and returns whether it is enough.
    keep : Path or None, optional
        Log to write; where it exists, the next free number is appended to its name.

    Returns
    -------
    Recording
        Stamps, ns, and angles, rad.

    Raises
    ------
    CalibrationError, ReplayError
        No set comes, or the log is broken.

    """
    if source == 'replay':
        with closing(make_replay(values)) as replay, ProgressBar('calibrate') as bar:
            recording, notes = read_log(
                replay,
                lambda count: bar.show(f'{count} sets read'),
                given or inf,
            )
        say(*notes)
        return recording
    live = make_source(source, values)
    say(instruction)
    log = None
    if keep is not None and isinstance(live, CanSource):
        log = FrameLog(free_path(keep))
        live.keep(log.take)
        say(
            f'the motion is kept in {log.path}; from it again: -p source:=replay -p '
            f'replay.path:={log.path}'
        )
    try:
        return _recorded(live, given or live_seconds, evaluate)
    finally:
        if log is not None:
            log.close()
            if log.error:
                say(
                    f'{log.path}: cannot be written: {log.error}; the motion is not kept from '
                    'then on'
                )


def _recorded(
    live: EncoderSource,
    seconds: float,
    evaluate: Evaluate | None = None,
    **how: Any,
) -> Recording:
    """
    Record a source, close it and say what is left out.

    Parameters
    ----------
    live : EncoderSource
        The source.
    seconds : float
        Longest time, s.
    evaluate : Evaluate or None, optional
        Shows the state and returns whether it is enough; without it the time is shown.
    **how : object
        Further arguments of `recording.record`.

    Returns
    -------
    Recording
        Stamps, ns, and angles, rad.

    """
    with closing(live), ProgressBar('calibrate') as bar:

        def show(recording: Recording, since: float) -> bool:
            if evaluate is not None:
                return evaluate(bar, live, recording, since)
            bar.show(
                with_trouble(f'{since:4.1f} of {seconds:g} s, {len(recording[0])} sets', live),
                since / seconds,
            )
            return False

        recording, notes = record(live, seconds, show, **how)
    say(*notes)
    return recording


def with_trouble(text: str, source: EncoderSource) -> str:
    """
    Return a text with the fault or the caution of a source, if it has any.

    Parameters
    ----------
    text : str
        The text.
    source : EncoderSource
        Source of readings.

    Returns
    -------
    str
        The text, and the trouble in brackets.

    """
    trouble = source.fault or source.caution
    return f'{text} ({trouble})' if trouble else text


def wait_for_pose(
    number: int,
    count: int,
    pose: Sequence[float],
) -> None:
    """
    Ask for a pose, and wait for Enter.

    Parameters
    ----------
    number : int
        Number of the pose, from 1.
    count : int
        Number of all poses.
    pose : sequence of float
        psi, theta, phi (ZXZ), deg.

    Raises
    ------
    InputError
        Standard input has ended.

    """
    say(
        f'pose {number} of {count}: hold the device at psi theta phi '
        f'{" ".join(f"{angle:g}" for angle in pose)} deg, then press Enter'
    )
    if not sys.stdin.readline():
        raise InputError(f'standard input has ended; expected Enter for each of {count} poses')


def record_pose(
    source: str,
    values: dict[str, Any],
    seconds: float,
) -> NDArray[np.int64]:
    """
    Return the counts of a device at rest.

    Parameters
    ----------
    source : str
        Name of the source, `can` or `replay`.
    values : dict
        Checked parameters of the source.
    seconds : float
        Length of the recording, s.

    Returns
    -------
    ndarray of int, shape (n, N)
        Counts, in [0, counts per turn).

    Raises
    ------
    CalibrationError
        No set of readings arrives, or a joint lacks too many.

    """
    live = make_source(source, values | raw_counts(values['sensors']))
    _, angles = _recorded(live, seconds, period=POSE_PERIOD, keep=False)
    per_turn = np.array(values['encoders.counts_per_turn'])
    counts = np.rint(angles * per_turn / TURN).astype(np.int64)
    within_turn: NDArray[np.int64] = counts % per_turn
    return within_turn


def say(*lines: str) -> None:
    """
    Print lines for the user of calibrate, on stderr.

    Parameters
    ----------
    *lines : str
        The lines.

    """
    for line in lines:
        print(f'calibrate: {line}', file=sys.stderr)
