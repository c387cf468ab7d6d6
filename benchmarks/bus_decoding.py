# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Measures what insertion and gripper cost in reading the bus, as a ratio to the four encoders.

`FrameDecoder.feed` decodes frames; `CanSource.read` also receives them, from python-can's virtual
bus; `encoder_driver` is the whole process, which publishes them as well, on a bus by UDP. Four and
six frames are measured one after the other, so that a busy machine slows both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import closing, ExitStack
import os
from statistics import median
import time
import uuid

from benchmarks.pipeline.child_process import (
    bus_channel,
    executable,
    private_environment,
    Program,
)
from benchmarks.pipeline.run import all_processes, TICK
import can
import rclpy
from sensor_msgs.msg import JointState
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.encoders.frame_decoder import FrameDecoder
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.qos import SAMPLES
from spm_haptic_master.simulation.source_factory import make_source
from spm_haptic_master.tools import command_line

# Cycles of one measurement of decoding and of reading, and pairs of measurements of which the
# median counts.
CYCLES, READ_CYCLES, PAIRS = 2000, 500, 15
# Time for the frames to be in the queue of the bus, and longest wait for the next one (s).
SETTLE, TIMEOUT = 3e-4, 0.01
PERIOD = 1e-3  # s
# Of the whole driver: rate of the sets, Hz; times of its start and of its measurement, s; pairs.
DRIVER_RATE = 250.0
DRIVER_START, DRIVER_MEASURED = 4.0, 8.0
DRIVER_PAIRS = 5
BEGIN = 1_760_000_000.0  # s since the Unix epoch
# Insertion and gripper, each a node of its own as the encoders are.
AXES = {
    'insertion.id': 0x185,
    'insertion.node_id': 5,
    'gripper.id': 0x186,
    'gripper.node_id': 6,
}


def settings(with_axes: bool, **bus: object) -> Values:
    """Return the settings of config/can.yaml, with insertion and gripper or without."""
    of_bus = {f'can.{name}': value for name, value in bus.items()}
    return command_line.bus_values(simulated_rig() | of_bus | (AXES if with_axes else {}))


def cycles(taker: FrameDecoder, count: int) -> list[can.Message]:
    """Return SYNC and the answer of each encoder at rest, cycle after cycle."""
    layouts = (*taker.layouts, *(axis.layout for axis in taker.axes))
    frames = []
    for number in range(count):
        begin = BEGIN + number * PERIOD
        frames.append(canopen.frame(taker.sync_id or 0, stamp=begin))
        for place, layout in enumerate(layouts, 1):
            frames.append(canopen.frame(layout.can_id, layout.data(1e-5), begin + 1e-4 * place))
    return frames


def seconds_to_decode(with_axes: bool) -> float:
    """Return the CPU time in which a new decoder takes a cycle and its readings are taken, s."""
    taker = make_decoder(settings(with_axes))
    frames = cycles(taker, CYCLES)
    begin = time.thread_time_ns()
    _feed(taker, frames)
    return (time.thread_time_ns() - begin) * 1e-9 / CYCLES


def _feed(taker: FrameDecoder, frames: Iterable[can.Message]) -> None:
    for frame in frames:
        if taker.feed(frame) is not None:
            taker.readings.clear()


def seconds_to_read(with_axes: bool) -> float:
    """Return the CPU time in which a source receives and decodes a cycle, s."""
    channel = uuid.uuid4().hex
    values = settings(with_axes, interface='virtual', channel=channel)
    frames = cycles(make_decoder(values), 1)
    # `read` returns with the set, and with each reading of an axis.
    reads = 1 + (2 if with_axes else 0)
    spent = 0
    with (
        closing(make_source('can', values)) as source,
        can.Bus(interface='virtual', channel=channel) as bus,
    ):
        source.read(TIMEOUT)  # opens the bus
        for _ in range(READ_CYCLES):
            for frame in frames:
                bus.send(frame)
            time.sleep(SETTLE)
            begin = time.thread_time_ns()
            for _ in range(reads):
                source.read(TIMEOUT)
                source.take_readings()
            spent += time.thread_time_ns() - begin
    return spent * 1e-9 / READ_CYCLES


def seconds_of_driver(with_axes: bool) -> float:
    """Return the CPU time of the process `encoder_driver` for a set, s, with a subscriber."""
    bus = {'can.interface': 'udp_multicast', 'can.channel': bus_channel(), 'rate': DRIVER_RATE}
    if with_axes:
        bus |= AXES
    sets = 0

    def count(_: JointState) -> None:
        nonlocal sets
        sets += 1

    with ExitStack() as stack:
        rclpy.init()
        stack.callback(rclpy.shutdown)
        node = rclpy.create_node('observer')
        node.create_subscription(JointState, 'measured_js', count, SAMPLES)
        stack.enter_context(Program(executable('sim_bus', '--sync', parameters=bus)))
        settings = {'source': 'can', **simulated_rig(), **bus}
        driver = stack.enter_context(Program(executable('encoder_driver', parameters=settings)))
        spent = 0.0
        for seconds in (DRIVER_START, DRIVER_MEASURED):
            _, before = all_processes()[driver.pid]
            sets = 0
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                rclpy.spin_once(node, timeout_sec=0.1)
            _, after = all_processes()[driver.pid]
            spent = TICK * (after - before)
        if not sets:
            raise SystemExit(f'bus_decoding: the driver published no set: {driver.stderr}')
    return spent / sets


def report(name: str, measure: Callable[[bool], float], pairs: int = PAIRS) -> str:
    """Return the times of a cycle of four and of six frames, and the ratio, in a line."""
    four, six = [], []
    for _ in range(pairs):
        four.append(measure(False))
        six.append(measure(True))
    ratio = median(long / short for long, short in zip(six, four, strict=True))
    return (
        f'{name}, a cycle: four encoders {1e6 * median(four):.1f} us, with insertion and gripper '
        f'{1e6 * median(six):.1f} us, ratio {ratio:.2f}'
    )


def main() -> None:
    """Print what decoding and reading a cycle costs."""
    print(report('FrameDecoder.feed', seconds_to_decode))
    print(report('CanSource.read', seconds_to_read))
    os.environ.update(private_environment())
    print(report('encoder_driver', seconds_of_driver, DRIVER_PAIRS))


if __name__ == '__main__':
    main()
