# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recording of a live source: what came is kept or refused, however it ends."""

from math import nan
import signal
import time
from types import SimpleNamespace

import numpy as np
import pytest
from spm_haptic_master.calibration import recording
from spm_haptic_master.calibration.recording import raw_counts, read_log, record
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.exceptions import CalibrationError, InputError, SourceEnded
from spm_haptic_master.tools import motion_source

# Time between two evaluations (s).
PERIOD = 0.05
# Time without a set after which a recording ends (s), outside of these tests.
PATIENCE = recording.PATIENCE
DOWN = InputError('can0: the interface is down')


class Device:
    """
    A source of sets at 1 kHz of its own time that stops after some: for good, or with an error.

    In each `nth` set the last of the encoders has no reading.
    """

    fault = 'no answer from joint_1a'
    caution = None

    def __init__(
        self,
        sets,
        then=None,
        nth=0,
        pause=0.0,
    ):
        self._sets = sets
        self._then = then
        self._nth = nth
        self._pause = pause
        self._number = 0

    def read(self, timeout):
        """Return the next set, None after the last one, or raise what comes then."""
        time.sleep(self._pause)
        self._number += 1
        if self._number <= self._sets:
            if self._nth and self._number % self._nth == 0:
                last = nan
            else:
                last = -0.25 * TURN
            return JointSample(1_000_000 * self._number, (0.1, 0.2, 0.3, 0.4, last))
        if self._then is not None:
            raise self._then
        time.sleep(timeout)
        return None

    def close(self):
        """End nothing."""


def recorded(
    device,
    seconds=60.0,
    evaluate=lambda recording, since: False,
    keep=True,
):
    """Return stamps, angles and notes: what is left out, and why no more came."""
    (stamps, angles), notes = record(
        device,
        seconds,
        evaluate,
        PERIOD,
        keep,
    )
    return stamps, angles, notes


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Wait for less."""
    monkeypatch.setattr(recording, 'PATIENCE', 0.25)


@pytest.mark.parametrize(
    'then, ended',
    (
        (
            None,
            [
                'no more sets of readings arrive: no answer from joint_1a; what arrived before '
                'that is used'
            ],
        ),
        (DOWN, ['can0: the interface is down; what arrived before that is used']),
        (SourceEnded(), []),
    ),
)
def test_what_came_before_the_end_of_the_source_is_kept(then, ended):
    stamps, angles, notes = recorded(Device(300, then))
    np.testing.assert_array_equal(stamps, 1_000_000 * np.arange(1, 301))
    np.testing.assert_array_equal(angles, [(0.1, 0.2, 0.3, 0.4, -0.25 * TURN)] * 300)
    assert notes == ended


@pytest.mark.parametrize('keep', [True, False])
def test_what_came_before_ctrl_c_is_kept_where_the_caller_wants_it(keep):
    def evaluate(found, since):
        if len(found[0]) == 300:
            signal.raise_signal(signal.SIGINT)

    try:
        stamps, _, notes = recorded(Device(300), evaluate=evaluate, keep=keep)
        assert keep
        assert len(stamps) == 300
        assert notes == []
    except KeyboardInterrupt:
        assert not keep


@pytest.mark.parametrize(
    'sets, then, keep, text',
    (
        (0, None, True, 'no set of readings arrived: no answer from joint_1a'),
        (0, SourceEnded(), True, 'no set of readings arrived: no answer from joint_1a'),
        (0, DOWN, True, 'can0: the interface is down'),
        (300, DOWN, False, 'can0: the interface is down'),
        (300, KeyError('of the code'), True, 'of the code'),
    ),
)
def test_nothing_or_a_part_of_what_is_needed_whole_is_an_error(
    sets,
    then,
    keep,
    text,
):
    with pytest.raises((CalibrationError, InputError, KeyError), match=text):
        recorded(Device(sets, then), keep=keep)


def test_the_recording_ends_when_it_is_enough_or_long_enough(monkeypatch):
    seen = []
    recorded(Device(300), evaluate=lambda found, since: seen.append(since) or len(seen) > 2)
    assert len(seen) == 3
    assert seen[0] == 0.0 < seen[1]
    # As long as it says, however long an evaluation takes.
    stamps, _, notes = recorded(Device(10**9, pause=1e-4), 0.1, lambda *_: time.sleep(0.15))
    assert notes == []
    assert len(stamps) == 101
    assert stamps[-1] - stamps[0] == 100_000_000
    # The first evaluation is after a second; no read takes more than a tenth of one.
    waits = set()
    sleep = time.sleep
    wait = recording.wait
    monkeypatch.setattr(time, 'sleep', lambda each: waits.add(each) or sleep(0.01 * each))
    monkeypatch.setattr(
        recording,
        'wait',
        lambda collecting, each: waits.add(each) or wait(collecting, 0.01 * each),
    )
    record(Device(1), 60.0, lambda *_: True)
    assert 1.0 in waits <= {0.0, 0.1, 1.0}


def test_sets_that_are_left_out_are_reported_with_their_joint(monkeypatch, capsys):
    monkeypatch.setattr(
        motion_source,
        'make_source',
        lambda source, values: Device(300, SourceEnded(), nth=10),
    )
    values = {'sensors': 5, 'encoders.counts_per_turn': (360, 360, 3600, 360, 360)}
    stamps, angles = motion_source.read_motion(
        'can',
        {},
        60.0,
        20.0,
        'move it',
    )
    counts = motion_source.record_pose('can', values, 60.0)
    assert len(stamps) == 270
    assert np.isfinite(angles).all()
    # Each in a turn.
    np.testing.assert_array_equal(counts, [(6, 11, 172, 23, 270)] * 270)
    assert (
        capsys.readouterr().err.count(
            'calibrate: joint_3b has no reading in 30 of 300 sets; these are left out\n'
        )
        == 2
    )
    # In a third of the sets: that is no recording.
    with pytest.raises(
        CalibrationError,
        match='joint_3b has no reading in 100 of 300 sets; expected readings of all joints',
    ):
        recorded(Device(300, SourceEnded(), nth=3))


class Log:
    """A log of sets each 10 ms, in which the third joint lacks some readings."""

    def __init__(
        self,
        sets,
        lacking=(),
    ):
        self._sets = sets
        self._lacking = lacking

    def recorded(self):
        """Yield the sets."""
        for number in range(self._sets):
            third = nan if number in self._lacking else 0.3
            yield JointSample(5_000_000 + 10_000_000 * number, (0.1, 0.2, third, 0.4))


def test_a_log_is_read_to_its_end_or_for_some_seconds_from_its_first_set():
    counts = []
    (stamps, angles), notes = read_log(Log(50), counts.append)
    np.testing.assert_array_equal(stamps, 5_000_000 + 10_000_000 * np.arange(50))
    np.testing.assert_array_equal(angles, [(0.1, 0.2, 0.3, 0.4)] * 50)
    assert counts == list(range(1, 51))
    assert notes == []
    # The set after a tenth of a second is the last one.
    assert len(read_log(Log(50), seconds=0.1)[0][0]) == 11
    assert len(read_log(Log(50), seconds=0.099)[0][0]) == 10
    (stamps, angles), notes = read_log(Log(0))
    assert (len(stamps), len(angles), notes) == (0, 0, [])


def test_a_fifth_of_the_sets_may_lack_a_reading():
    (stamps, _), notes = read_log(Log(50, lacking=range(10)))
    assert len(stamps) == 40
    assert notes == ['joint_1c has no reading in 10 of 50 sets; these are left out']
    with pytest.raises(CalibrationError, match='^joint_1c has no reading in 11 of 50 sets; expec'):
        read_log(Log(50, lacking=range(11)))


def test_raw_counts_have_no_direction_zero_or_harmonics():
    found = raw_counts(5)
    assert found['encoders.direction'] == (1,) * 5
    assert found['encoders.zero_count'] == (0,) * 5
    assert len(found) > 2
    rest = {name: value for name, value in found.items() if 'harmonic' in name or 'table' in name}
    assert len(rest) == len(found) - 2
    assert all(set(value) == {0.0} for value in rest.values())
    assert found['encoders.harmonic_cos_deg'] == (0.0,) * 5


class Clock:
    """A clock that goes on by a period while the recording waits; sets arrive at some times."""

    def __init__(self, monkeypatch, arrivals):
        self.now = 100.0
        self.samples = []
        self._arrivals = arrivals
        monkeypatch.setattr(recording, 'PATIENCE', PATIENCE)
        monkeypatch.setattr(recording, 'time', SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(recording, 'wait', self._wait)

    def _wait(self, _, period):
        self.now += period
        if self.now - 100.0 in self._arrivals:
            self.samples.append(JointSample(int(1e9 * self.now), (0.1, 0.2, 0.3, 0.4)))

    def follow(self, seconds, evaluate=lambda *_: False):
        """Return why a recording ended, and after how long, s."""
        ended = recording._follow(
            SimpleNamespace(done=lambda: False),
            SimpleNamespace(fault='no answer'),
            self.samples,
            seconds,
            evaluate,
            0.5,
        )
        return ended, self.now - 100.0


@pytest.mark.parametrize(('arrivals', 'after'), [((), 5.5), ((1.0, 2.0), 7.5), ((5.0,), 10.5)])
def test_a_recording_ends_when_no_set_has_come_for_more_than_five_seconds(
    monkeypatch,
    arrivals,
    after,
):
    ended = Clock(monkeypatch, arrivals).follow(seconds=60.0)
    assert ended == ('no more sets of readings arrive: no answer', after)


def test_a_recording_lasts_for_its_seconds_from_the_first_set(monkeypatch):
    arrivals = tuple(np.arange(2.0, 30.0, 1.0))
    assert Clock(monkeypatch, arrivals).follow(seconds=10.0) == ('', 12.5)


def test_a_recording_is_enough_when_its_evaluation_says_so_of_the_first_set(monkeypatch):
    """Without a set there is nothing to evaluate."""
    numbers = []

    def evaluate(found, since):
        numbers.append(len(found[0]))
        return True

    assert Clock(monkeypatch, (2.0, 3.0)).follow(60.0, evaluate) == ('', 2.0)
    assert numbers == [1]
