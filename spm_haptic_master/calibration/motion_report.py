# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a calibration from free motion, which is filed with the device."""

from __future__ import annotations

from pathlib import Path

from spm_haptic_master.calibration.free_motion import MotionCalibration
from spm_haptic_master.calibration.motion_file import Origin


def write_report(output: Path, calibration: MotionCalibration, origin: Origin) -> str:
    """
    Write the report beside the parameter file; return what was written, in words.

    Parameters
    ----------
    output : Path
        The parameter file.
    calibration : MotionCalibration
        Result of the motion.
    origin : Origin
        Where it comes from.

    """
    return f'no report of {origin.recording} for {output.name}, {calibration.direction}'
