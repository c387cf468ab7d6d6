# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recording of the encoders while a jig holds the device at a pose, with a bar."""

from __future__ import annotations

from collections.abc import Sequence
import sys
from typing import Any

from spm_haptic_master.calibration.recording import Completeness, raw_counts, record_counts
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes.source_factory import make_source
from spm_haptic_master.tools.motion_source import report_left_out
from spm_haptic_master.tools.progress_bar import ProgressBar

# Length of a recording at a jig's pose (s).
JIG_SECONDS = 5.0


def wait_for_pose(number: int, count: int, pose: Sequence[float]) -> None:
    """
    Ask for a pose and wait for Enter.

    Parameters
    ----------
    number, count : int
        Of the pose, and of all of them.
    pose : sequence of 3 float
        psi, theta, phi (ZXZ), deg.

    Raises
    ------
    InputError
        Standard input has ended.

    """
    print(f'calibrate: pose {number} of {count}: hold the device at psi theta phi '
          f'{" ".join(f"{angle:g}" for angle in pose)} deg, then press Enter',
          file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise InputError('standard input has ended; expected Enter for each of '
                         f'{count} poses')


def record_pose(name: str, values: dict[str, Any], seconds: float) -> list[list[int]]:
    """
    Return the counts of the sets that arrive within some seconds; show the progress.

    Parameters
    ----------
    name : str
        Source.
    values : dict
        Its checked settings.
    seconds : float
        Length of the recording, s.

    Raises
    ------
    CalibrationError
        No set arrived.

    """
    source = make_source(name, values | raw_counts(values['sensors']))
    bar = ProgressBar('calibrate')
    completeness = Completeness()
    try:
        counts = record_counts(
            source, values['encoders.counts_per_turn'], seconds,
            lambda done, sets: bar.recorded(done, seconds, sets, source), completeness)
    finally:
        bar.end()
        source.close()
    report_left_out(completeness)
    return counts
