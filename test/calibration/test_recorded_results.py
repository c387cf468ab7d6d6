# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Results of simulated motions against recorded ones: file, report, guidance, checks, slips.

A result that shall change is removed from test/data/calibration, and recorded anew by its test.
"""

from dataclasses import replace
from math import tau
from pathlib import Path
from tempfile import TemporaryDirectory

from calibrated_rig import CalibratedRig, MODE, motion
from free_motions import (
    DEVIATIONS,
    model_of,
    poses,
    random_vector,
    SHORT,
    short_calibration,
    short_motion,
    SIGMA,
)
import numpy as np
import pytest
from recorded_text import assert_recorded
from simulated_hand import readings
from spm_haptic_master.calibration import report_picture
from spm_haptic_master.calibration.motion import free_motion, zero_search
from spm_haptic_master.calibration.motion.calibration import motion_text, Origin, Verdict
from spm_haptic_master.calibration.motion.calibration_check import CalibrationChecker
from spm_haptic_master.calibration.motion.coverage import Region
from spm_haptic_master.calibration.motion.fit import fit
from spm_haptic_master.calibration.motion.misfit import check_slip, slow_factor
from spm_haptic_master.calibration.motion.model import Layout
from spm_haptic_master.calibration.motion.readings import motion_readings
from spm_haptic_master.calibration.report import write_report
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.simulation.rig import random_rig

ORIGIN = Origin('2026-03-01T10:00:00+01:00', 'hand | motion.log', 'ab' * 32, '1.2.3',
                (16384, 16384, 4096, 65536), {'encoders.can_id': (1, 2, 3, 4)})


def deg(angles):
    """Return angles, rad, in a line."""
    return ' '.join(f'{angle:.4f}' for angle in np.degrees(angles))


def verdict():
    """Return what the short motion is good for, in a part of the workspace."""
    part = replace(short_calibration(), region=Region(14.0, 5.0, 75.0))
    return Verdict(part, ORIGIN, 0.5, 0.9987, 0.04)


def file_text():
    """Return the parameter file of the short motion."""
    return motion_text(verdict())


def report_text():
    """Return the report beside it."""
    with TemporaryDirectory() as directory, pytest.MonkeyPatch.context() as patch:
        patch.setattr(report_picture, 'draw', lambda calibration: b'the picture')
        path = Path(directory) / 'rig.yaml'
        path.write_text('the parameters')
        write_report(path, verdict())
        return path.with_suffix('.md').read_text()


def motion_results():
    """Return readings made ready, guidance of their beginnings, and the zeros of all of them."""
    stamps, raw, _, _ = short_motion()
    lines = []
    starts = []
    with pytest.MonkeyPatch.context() as patch:
        # Of a good motion, fewer guesses find the zeros, too.
        patch.setattr(zero_search, 'GUESSES', 12)
        patch.setattr(free_motion, 'find_start', lambda *given, **options: starts.append(
            zero_search.find_start(*given, **options)) or starts[-1])
        guide = free_motion.Guide(Layout(4))
        for count in (1500, 2500, 16000):
            found = guide.evaluate(stamps[:count:8], raw[:count:8])
            lines += [f'{count} sets: {found.text}', *(
                f'    {name}: {share:.4f}' for name, share in found.covered.items())]
    lines += [f'zeros {deg(start.vector[:4])}, directions {start.direction}' for start in starts]
    stamps, raw, _, _ = readings(random_rig(3, DEVIATIONS), replace(
        SHORT, seconds=12.0, outliers=0.05, dropout=0.05, rest=0.1), 8)
    found = motion_readings(stamps, raw)
    lines += [f'{found.sets} sets, {found.spikes} spikes, noise {deg(found.noise)}',
              *(f'    {deg(row)}' for row in found.readings[::1000])]
    return '\n'.join(lines)


def slip_results():
    """Return what slips of one sensor, and of all, are called during a motion and after it."""
    model = model_of()
    vector = random_vector(model, 5)
    turned = model.readings(poses(3000), vector)
    turned += SIGMA * np.random.default_rng(1).normal(size=turned.shape)
    seconds = 0.01 * np.arange(3000)
    lines = []
    for sensor, change in enumerate((
            0.5 * (seconds > 12.0), -0.4 * (seconds > 20.0), 0.02 * seconds, 0.0 * seconds)):
        slipped = turned + np.outer(np.radians(change), np.eye(4)[sensor])
        found = fit(model, slipped, vector, range(4))
        lines.append(f'slow factor {slow_factor(seconds, found.normal):.3f}')
        try:
            check_slip(model, slipped, seconds, found)
        except CalibrationError as error:
            lines.append(f'    {error}')
    for sensors in (6, 4):
        rig = CalibratedRig(2, sensors)
        angles = rig.angles(motion(2002, 20.0, 25.0))
        for slip in ((0.0, 0.0, 0.0, 0.0), (0.0, 0.2, 0.0, 0.0), (0.0, 0.3, 0.0, 0.4),
                     (0.0, 0.0, 0.0, 2.5))[:8 - sensors]:
            moved = angles + np.radians([*slip, *[0.0] * (sensors - 4)])
            found = CalibrationChecker(rig.sigma, rig.bias, rig.geometry, MODE).check(
                (moved + np.pi) % tau - np.pi)
            each = found.evaluation
            lines += [f'{"holds" if found.holds else found.text}: merit {each.merit:.3f}, white '
                      f'{np.degrees(each.white):.4f}, limit {each.limit:.2f}, visible '
                      f'{deg(each.visible)}, {each.poses} poses']
    return '\n'.join(lines)


RESULTS = {'short.yaml': file_text, 'short.md': report_text, 'motion.txt': motion_results,
           'slips.txt': slip_results}


@pytest.mark.parametrize('name', RESULTS)
def test_a_result_is_the_recorded_one(name):
    assert_recorded(f'calibration/{name}', RESULTS[name]())
