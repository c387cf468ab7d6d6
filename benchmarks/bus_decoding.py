# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Measures what insertion and gripper cost in decoding the bus, as a ratio to the four encoders.

Both decoders take the same cycles, one after the other, so that a busy machine slows both.
"""

from __future__ import annotations

from collections.abc import Iterable
from statistics import median
import time

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.encoders.frame_decoder import FrameDecoder
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.tools import command_line

# Cycles of one measurement, and pairs of measurements of which the median counts.
CYCLES, PAIRS = 2000, 15
PERIOD = 1e-3  # s
BEGIN = 1_760_000_000.0  # s since the Unix epoch
# Insertion and gripper, each a node of its own as the encoders are.
AXES = {
    'insertion.id': 0x185,
    'insertion.node_id': 5,
    'gripper.id': 0x186,
    'gripper.node_id': 6,
}


def decoder(with_axes: bool) -> FrameDecoder:
    """Return the decoder of config/can.yaml, with insertion and gripper or without."""
    return make_decoder(command_line.bus_values(simulated_rig() | (AXES if with_axes else {})))


def cycles(taker: FrameDecoder) -> list[can.Message]:
    """Return SYNC and the answer of each encoder at rest, cycle after cycle."""
    layouts = (*taker.layouts, *(axis.layout for axis in taker.axes))
    frames = []
    for number in range(CYCLES):
        begin = BEGIN + number * PERIOD
        frames.append(canopen.frame(taker.sync_id or 0, stamp=begin))
        for place, layout in enumerate(layouts, 1):
            frames.append(canopen.frame(layout.can_id, layout.data(1e-5), begin + 1e-4 * place))
    return frames


def seconds_per_cycle(with_axes: bool) -> float:
    """Return the CPU time in which a new decoder takes a cycle and its readings are taken, s."""
    taker = decoder(with_axes)
    frames = cycles(taker)
    begin = time.process_time_ns()
    _feed(taker, frames)
    return (time.process_time_ns() - begin) * 1e-9 / CYCLES


def _feed(taker: FrameDecoder, frames: Iterable[can.Message]) -> None:
    for frame in frames:
        if taker.feed(frame) is not None:
            taker.readings.clear()


def main() -> None:
    """Print the time of a cycle of four and of six frames, and their ratio."""
    four, six = [], []
    for _ in range(PAIRS):
        four.append(seconds_per_cycle(with_axes=False))
        six.append(seconds_per_cycle(with_axes=True))
    ratio = median(long / short for long, short in zip(six, four, strict=True))
    print(f'FrameDecoder.feed, a cycle: four encoders {1e6 * min(four):.1f} us, with insertion')
    print(f'and gripper {1e6 * min(six):.1f} us; ratio {ratio:.2f} (median of {PAIRS} pairs)')


if __name__ == '__main__':
    main()
