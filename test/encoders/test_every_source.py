# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The contract of EncoderSource, held by each of its back ends alike."""

from math import pi
import time

from encoder_frames import record, stream, values
import numpy as np
import pytest
from spm_haptic_master.simulation.source_factory import make_source

# Sets a second.
RATE = 200.0


@pytest.fixture(params=['can', 'replay', 'sim'])
def source(request, tmp_path, channel, encoders, stack):
    """Return a source of each kind."""
    options = {'rate': RATE}
    if request.param == 'can':
        stack.enter_context(encoders())
        options |= {
            'can__interface': 'virtual',
            'can__channel': channel,
            'can__sync': 'produce',
        }
    elif request.param == 'replay':
        path = record(tmp_path / 'recorded.log', stream(*range(20)))
        options = {'replay__path': str(path), 'replay__loop': True}
    return make_source(request.param, values(request.param, **options))


def read(source, count):
    """Return samples of a source, none of which is of the future."""
    deadline = time.monotonic() + 20.0
    samples = []
    while len(samples) < count and time.monotonic() < deadline:
        sample = source.read(0.1)
        if sample is not None:
            assert sample.stamp <= time.time_ns()
            samples.append(sample)
    return samples


def check_whole(sample):
    """Check that a sample is of plain numbers, and has the angle of each encoder."""
    assert type(sample.stamp) is int
    assert len(sample.angles) == 4
    for angle in sample.angles:
        assert type(angle) is float
        assert -pi < angle <= pi


def test_samples_are_whole_and_their_stamps_increase(source):
    begin = time.time_ns()
    samples = read(source, 50)
    assert len(samples) == 50
    for sample in samples:
        check_whole(sample)
    stamps = [sample.stamp for sample in samples]
    assert stamps[0] >= begin - 5_000_000
    assert np.diff(stamps).min() > 0
    assert source.fault is None
    figures = source.statistics()
    assert figures['sets'] >= 50
    assert all(isinstance(name, str) for name in figures)
    source.close()
    source.close()
