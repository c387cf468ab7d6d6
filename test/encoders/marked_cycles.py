# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cycles of encoders whose angles show which cycle they were sampled in."""

from math import isnan

from encoder_frames import answer, decoder, PERIOD, sync, T0

COUNT = 2.0 * 3.14159265 / 16384
COUNTER = {
    'encoders__data_length': 5,
    'encoders__counter_byte': 4,
    'encoders__counter_mask': 0x0F,
}
STATUS = {
    'encoders__data_length': 5,
    'encoders__status_byte': 4,
    'encoders__status_mask': 0x03,
    'encoders__status_good': 0x01,
}


def rig(sensors, layout=None, **overrides):
    """Return a decoder of N encoders, and their layouts."""
    of_each = {}
    for name, value in (layout or {}).items():
        of_each[name] = (value,) * sensors
    taker = decoder(sensors=sensors, **overrides, **of_each)
    return taker, taker.layouts


def angle(index, number):
    """Return the angle of a joint in a cycle, rad."""
    return 0.01 * (index + 1) + 4 * COUNT * (number % 1000)


def frame(layouts, index, number, sampled=None):
    """Return an answer that comes in a cycle, of the angle sampled in that one or another."""
    sampled = number if sampled is None else sampled
    data = layouts[index].data(angle(index, sampled), sampled)
    stamp = T0 + PERIOD * number + 8e-5 * (index + 1)
    return answer(index, stamp, layouts=layouts, data=data)


def cycle(layouts, number, without=()):
    """Return SYNC and the answers of a cycle."""
    frames = [sync(T0 + PERIOD * number)]
    for index in range(len(layouts)):
        if index not in without:
            frames.append(frame(layouts, index, number))
    return frames


def stream_of(layouts, numbers, gone=(), when=()):
    """Return the frames of cycles; in those of `when` the joints of `gone` do not answer."""
    frames = []
    for number in numbers:
        frames += cycle(layouts, number, gone if number in when else ())
    return frames


def sets_of(numbers, gone=(), when=()):
    """Return what `by_cycle` finds of cycles: in those of `when` without the joints of `gone`."""
    return {number: set(gone) if number in when else set() for number in numbers}


def by_cycle(samples, mixed=-1):
    """Return the joints without a reading by cycle; fail if sets mix cycles after that number."""
    found = {}
    for sample in samples:
        number = round((sample.stamp * 1e-9 - T0) / PERIOD - 0.05)
        assert number not in found
        assert number >= max(found, default=0)
        found[number] = set()
        for index, reading in enumerate(sample.angles):
            if isnan(reading):
                found[number].add(index)
            elif number > mixed:
                assert abs(reading - angle(index, number)) < COUNT, (number, index)
    return found
