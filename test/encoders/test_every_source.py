# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The contract of EncoderSource, held by each of its back ends alike."""

from math import pi
import time

import can
from encoder_frames import cycle, values
import pytest
from spm_haptic_master.simulation.source_factory import make_source

# Sets a second of a live bus and of the simulation here.
RATE = 200.0


@pytest.fixture(params=['can', 'replay', 'sim'])
def make(request, tmp_path, channel, encoders):
    """Make a source of each kind, lively or idle (one set at most, then none for long)."""
    kind, made = request.param, []

    def options(lively):
        if kind == 'sim':
            return {'rate': RATE if lively else 1.0}
        if kind == 'can':
            if lively:
                encoders()
            return {'can__interface': 'virtual', 'can__channel': channel,
                    **({'can__sync': 'produce', 'rate': RATE} if lively else {})}
        path = tmp_path / f'{len(made)}.log'
        with can.Logger(str(path)) as logger:
            for number in range(20) if lively else (0, 5000):
                for message in cycle(number):
                    logger(message)
        return {'replay__path': str(path), 'replay__loop': lively}

    def source(lively):
        made.append(make_source(kind, values(kind, **options(lively))))
        return made[-1]

    yield source
    for each in made:
        each.close()
        each.close()


def test_samples_are_whole_and_their_stamps_increase(make):
    source = make(True)
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


def test_a_timeout_is_a_value_and_takes_its_time(make):
    source = make(False)
    source.read(0.3)
    begin = time.monotonic()
    assert source.read(0.1) is None
    assert time.monotonic() - begin > 0.09
    assert source.read(0.0) is None
    assert source.lost == 0.0
