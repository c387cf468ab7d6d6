# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The contract of EncoderSource, held by each of its back ends alike."""

from math import pi
import time

from encoder_frames import record, stream, values
import pytest
from spm_haptic_master.simulation.source_factory import make_source

# Sets a second.
RATE = 200.0


@pytest.mark.parametrize('kind', ['can', 'replay', 'sim'])
def test_samples_are_whole_and_their_stamps_increase(kind, tmp_path, channel, encoders, stack):
    options = {'rate': RATE}
    if kind == 'can':
        stack.enter_context(encoders())
        options |= {
            'can__interface': 'virtual',
            'can__channel': channel,
            'can__sync': 'produce',
        }
    elif kind == 'replay':
        path = record(tmp_path / 'recorded.log', stream(*range(20)))
        options = {'replay__path': str(path), 'replay__loop': True}
    source = make_source(kind, values(kind, **options))
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
    assert figures['sets'] >= 50
    assert all(isinstance(name, str) for name in figures)
    source.close()
    source.close()
