# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recording of a live motion: what came is kept, however it ends."""

from math import nan
import signal
import threading
import time

import numpy as np
import pytest
from spm_haptic_master.calibration.motion import recording as motion_recording
from spm_haptic_master.calibration.motion.recording import record_motion
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.exceptions import CalibrationError, InputError, SourceEnded
from spm_haptic_master.tools import motion_source


class Device:
    """A source of sets that stops after some: for good, with an error, or with the recording."""

    fault = 'no answer from joint_1a'

    def __init__(self, sets, then=None):
        self._left, self._then = sets, then

    def read(self, timeout):
        """Return the next set, None after the last one, or raise what comes then."""
        if self._left:
            self._left -= 1
            return JointSample(1_000_000 * self._left, (0.1, 0.2, 0.3, 0.4))
        if self._then is not None:
            raise self._then
        time.sleep(timeout)
        return None


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Wait for less."""
    monkeypatch.setattr(motion_recording, 'EVALUATION_PERIOD', 0.05)
    monkeypatch.setattr(motion_recording, 'PATIENCE', 0.5)


@pytest.mark.parametrize('then, ended', (
    (None, 'no set of the encoders comes any more: no answer from joint_1a'),
    (InputError('can0: the interface is down'), 'can0: the interface is down'),
    (SourceEnded(), '')))
def test_what_came_before_the_end_of_the_source_is_kept(then, ended):
    stamps, angles, why = record_motion(Device(300, then), 60.0, lambda recording, since: False)
    assert len(stamps) == len(angles) == 300 and why == ended


def test_what_came_before_ctrl_c_is_kept():
    def interrupt():
        time.sleep(0.4)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    def evaluate(recording, since):
        # In the middle of an evaluation.
        time.sleep(5.0)
        return False

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Thread(target=interrupt).start()
        begin = time.monotonic()
        stamps, _, why = record_motion(Device(300), 60.0, evaluate)
        assert len(stamps) == 300 and why == '' and time.monotonic() - begin < 4.0
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize('then, text', (
    (None, 'no set of the encoders came: no answer from joint_1a'),
    (InputError('can0: the interface is down'), 'can0: the interface is down')))
def test_nothing_at_all_is_an_error(then, text):
    with pytest.raises((CalibrationError, InputError), match=text):
        record_motion(Device(0, then), 60.0, lambda recording, since: False)


def test_the_recording_ends_when_it_is_enough_or_long_enough():
    seen = []
    record_motion(Device(300), 60.0, lambda recording, since: seen.append(since) or len(seen) > 2)
    assert len(seen) == 3
    begin = time.monotonic()
    record_motion(Device(300), 0.2, lambda recording, since: False)
    assert time.monotonic() - begin < 10.0


class Running(Device):
    """A source that goes on, 1 ms of its own time at each set."""

    def __init__(self):
        super().__init__(10 ** 9)
        self._stamp = 0

    def read(self, timeout):
        """Return the next set."""
        time.sleep(1e-4)
        self._stamp += 1_000_000
        return super().read(timeout)._replace(stamp=self._stamp)


def test_the_recording_is_as_long_as_it_says_however_long_an_evaluation_takes():
    def evaluate(recording, since):
        time.sleep(0.3)
        return False

    stamps, _, why = record_motion(Running(), 0.25, evaluate)
    assert why == '' and len(stamps) == 251 and stamps[-1] - stamps[0] == 250_000_000


class Lacking(Device):
    """Five encoders of which the last has no reading in each `nth` set."""

    fault = None

    def __init__(self, sets, nth):
        super().__init__(sets)
        self._nth = nth

    def read(self, timeout):
        """Return as the device does."""
        sample = super().read(timeout)
        return sample and sample._replace(
            angles=(*sample.angles, nan if self._left % self._nth == 0 else 0.5))


def test_sets_with_a_joint_missing_are_left_out():
    stamps, angles, _ = record_motion(Lacking(300, 10), 60.0, lambda recording, since: False)
    assert len(stamps) == len(angles) == 270 and np.isfinite(angles).all()


def test_a_joint_that_is_not_there_ends_the_recording_with_its_name():
    with pytest.raises(CalibrationError, match='joint_3b has no reading in 300 of 300 sets'):
        record_motion(Lacking(300, 1), 60.0, lambda recording, since: False)


def test_sets_that_are_left_out_are_reported_with_their_joint(monkeypatch, capsys):
    device = Lacking(300, 10)
    device.close = lambda: None
    monkeypatch.setattr(motion_source, 'make_source', lambda source, values: device)
    stamps, _ = motion_source.read_motion(
        'can', {}, 60.0, 20.0, 'move it',
        lambda source: (lambda recording, since: False, lambda: None))
    assert len(stamps) == 270
    assert 'calibrate: joint_3b has no reading in 30 of 300 sets; these are left out\n' \
        in capsys.readouterr().err
