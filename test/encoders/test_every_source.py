# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The contract of EncoderSource, held by each of its back ends alike."""

from contextlib import suppress
from math import pi
import time

import can
from encoder_frames import cycle, values
import pytest
from spm_haptic_master.exceptions import SourceEnded
from spm_haptic_master.simulation.source_factory import make_source

# Sets a second of a live bus and of the simulation here.
RATE = 200.0


class BackEnd:
    """Makes sources of one kind: one with samples, one that has none for long."""

    def __init__(self, tmp_path, channel, encoders):
        self.path, self.channel, self.encoders = tmp_path, channel, encoders
        self.made = []

    def make(self, **overrides):
        self.made.append(make_source(self.name, values(self.name, **overrides)))
        return self.made[-1]


class Can(BackEnd):
    name = 'can'

    def lively(self):
        self.encoders()
        return self.make(can__interface='virtual', can__channel=self.channel,
                         can__sync='produce', rate=RATE)

    def idle(self):
        return self.make(can__interface='virtual', can__channel=self.channel)


class Replay(BackEnd):
    name = 'replay'

    def _record(self, numbers):
        path = self.path / 'recorded.log'
        with can.Logger(str(path)) as logger:
            for number in numbers:
                for message in cycle(number):
                    logger(message)
        return str(path)

    def lively(self):
        return self.make(replay__path=self._record(range(20)), replay__loop=True)

    def idle(self):
        source = self.make(replay__path=self._record((0, 5000)))
        assert source.read(1.0) is not None
        return source


class Sim(BackEnd):
    name = 'sim'

    def lively(self):
        return self.make(rate=RATE)

    def idle(self):
        source = self.make(rate=1.0)
        assert source.read(1.0) is not None
        return source


@pytest.fixture(params=[Can, Replay, Sim], ids=lambda kind: kind.name)
def back_end(request, tmp_path, channel, encoders):
    """Give each back end; its sources are closed at the test's end."""
    made = request.param(tmp_path, channel, encoders)
    yield made
    for source in made.made:
        source.close()


class TestEverySource:
    """What a caller of EncoderSource may rely on, whichever source it is."""

    def test_samples_are_whole_and_their_stamps_increase(self, back_end):
        source = back_end.lively()
        begin = time.time_ns()
        deadline = time.monotonic() + 20.0
        samples = []
        while len(samples) < 50 and time.monotonic() < deadline:
            sample = source.read(0.1)
            if sample is not None:
                assert sample.stamp <= time.time_ns()
                samples.append(sample)
        assert len(samples) == 50
        for sample in samples:
            assert type(sample.stamp) is int
            assert [type(angle) for angle in sample.angles] == [float] * 4
            assert all(-pi < angle <= pi for angle in sample.angles)
        stamps = [sample.stamp for sample in samples]
        assert all(after > before for before, after in zip(stamps, stamps[1:], strict=False))
        assert stamps[0] >= begin - 5_000_000
        assert source.fault is None
        figures = source.statistics()
        assert figures['sets'] >= 50 and all(isinstance(name, str) for name in figures)
        # On a stalled machine the simulated encoders answer two SYNCs at once.
        assert source.caution is None or 'two answers' in source.caution

    def test_a_timeout_is_a_value_and_takes_its_time(self, back_end):
        source = back_end.idle()
        begin = time.monotonic()
        assert source.read(0.1) is None
        assert time.monotonic() - begin > 0.09
        assert source.read(0.0) is None

    def test_close_is_harmless_twice_and_before_the_first_read(self, back_end):
        unread = back_end.idle() if back_end.name == 'can' else back_end.lively()
        unread.close()
        unread.close()
        source = back_end.lively()
        with suppress(SourceEnded):
            source.read(0.2)
        source.close()
        source.close()
