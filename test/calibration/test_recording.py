# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recording of raw counts: its length, its progress, and the errors of a source."""

from math import nan, radians

import pytest
from spm_haptic_master.calibration import recording
from spm_haptic_master.calibration.recording import record_counts
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.exceptions import CalibrationError, SourceEnded

PER_TURN = (360, 360, 3600, 360)


class Rig(EncoderSource):
    """A source with a clock of its own: a set every 0.1 s after `silent` s, `sets` in all."""

    def __init__(self, monkeypatch, silent=0.0, sets=1000):
        self.now, self._silent, self._sets = 100.0, 100.0 + silent, sets
        monkeypatch.setattr(recording.time, 'monotonic', lambda: self.now)

    def read(self, timeout):
        self.now += 0.1
        if self.now < self._silent:
            return None
        if not self._sets:
            raise SourceEnded
        self._sets -= 1
        return JointSample(0, (radians(10.0), radians(-10.0), radians(-0.1), 0.0))

    @property
    def fault(self):
        return 'bus is off'

    def statistics(self):
        return {}


def test_counts_are_those_of_the_encoders_for_the_given_time(monkeypatch):
    shown = []
    counts = record_counts(Rig(monkeypatch), PER_TURN, 2.0, lambda *what: shown.append(what))
    assert 20 <= len(counts) <= 22
    assert counts[0] == [10, 350, 3599, 0]
    assert [sets for _, sets in shown] == [*range(1, len(counts) + 1)]
    assert [done for done, _ in shown] == pytest.approx([0.1 * i for i in range(len(counts))])


def test_the_time_runs_from_the_first_set(monkeypatch):
    shown = []
    counts = record_counts(Rig(monkeypatch, silent=4.0), PER_TURN, 1.0,
                           lambda *what: shown.append(what))
    assert 10 <= len(counts) <= 12
    assert shown[0] == (0.0, 0)


def test_a_recorded_source_may_end_earlier(monkeypatch):
    assert len(record_counts(Rig(monkeypatch, sets=7), PER_TURN, 2.0, lambda *_: None)) == 7


@pytest.mark.parametrize('how', [{'silent': recording.PATIENCE + 1.0}, {'sets': 0}])
def test_without_any_set_the_fault_of_the_source_is_the_reason(monkeypatch, how):
    with pytest.raises(CalibrationError, match='no set of four encoders came: bus is off'):
        record_counts(Rig(monkeypatch, **how), PER_TURN, 2.0, lambda *_: None)


class Lacking(Rig):
    """The same with six encoders, of which one has no reading in each `nth` set."""

    def __init__(self, monkeypatch, nth, **more):
        super().__init__(monkeypatch, **more)
        self._nth = nth

    def read(self, timeout):
        sample = super().read(timeout)
        last = nan if sample is not None and self._sets % self._nth == 0 else 0.0
        return sample and JointSample(0, (*sample.angles, 0.0, last))


def test_sets_with_a_joint_missing_are_left_out(monkeypatch):
    counts = record_counts(
        Lacking(monkeypatch, 10, sets=100), (*PER_TURN, 360, 360), 60.0, lambda *_: None)
    assert len(counts) == 90 and all(row == [10, 350, 3599, 0, 0, 0] for row in counts)


@pytest.mark.parametrize('nth', [1, 2])
def test_a_joint_that_is_not_there_is_named(monkeypatch, nth):
    with pytest.raises(CalibrationError, match=f'joint_3c has no reading in {100 // nth} of 100 '
                                               'sets; expected readings of all joints'):
        record_counts(
            Lacking(monkeypatch, nth, sets=100), (*PER_TURN, 360, 360), 60.0, lambda *_: None)
