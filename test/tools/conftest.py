# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The log of a rig's motion, and its calibration."""

import gzip

from harness import DATA
import pytest
from spm_haptic_master.calibration.motion import zero_search
from spm_haptic_master.tools import calibrate, calibrate_motion, calibration_verdict

# Sets per second of the log.
RATE = 1000.0
# Length of the part of the log that is used (s), and the sets of the log to one that is.
SECONDS = 20.0
EVERY = 10


@pytest.fixture(scope='session')
def motion_log(tmp_path_factory):
    """Return what writes the begin of a log, one set of some, and returns its arguments."""

    def write(name, every=EVERY, seconds=SECONDS):
        path = tmp_path_factory.mktemp('log') / f'{name}.log'
        cycles = begin = 0
        with gzip.open(DATA / 'rig' / f'{name}.log.gz', 'rt') as source, path.open('w') as log:
            for line in source:
                time = float(line[1 : line.index(')')])
                begin = begin or time
                if time - begin > seconds:
                    break
                cycles += ' 080#' in line
                if cycles % every == 1 % every:
                    log.write(line)
        return (
            '-p',
            'source:=replay',
            '-p',
            f'replay.path:={path}',
            '-p',
            f'rate:={RATE / every}',
        )

    return write


@pytest.fixture(scope='session')
def motion(motion_log):
    """Return the arguments of a motion."""
    return motion_log('dev_motion')


@pytest.fixture(scope='session')
def calibrated(motion, tmp_path_factory):
    """Calibrate from the motion; return the file, what is printed, and the verdict."""
    path = tmp_path_factory.mktemp('motion') / 'c.yaml'
    verdicts = []
    lines = []
    with pytest.MonkeyPatch.context() as patch:
        # The report has tests of its own, and its picture takes seconds.
        patch.setattr(
            calibrate_motion,
            'write_report',
            lambda path, verdict: verdicts.append(verdict) or 'report c.md',
        )
        patch.setattr(calibrate_motion, 'print', lines.append, raising=False)
        patch.setattr(calibration_verdict, 'SECONDS', 10.0)
        patch.setattr(zero_search, 'GUESSES', 12)
        assert (
            calibrate.main(
                ['calibrate', '--motion', *motion, '-o', str(path), '-p', 'alert_limit_deg:=30.0']
            )
            == 0
        )
    return path, '\n'.join(lines), *verdicts
