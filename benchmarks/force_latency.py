# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How soon a wrench is in the torque frames of the motors, beside a bare subscription of the wrench.

Encoders and drives are simulated, each in a process of its own, on a bus of udp_multicast.
`master` renders the wrench of this process, which changes at random moments. A change counts from
its publication to the first torque frame that follows it, by the time at which the kernel received
the frame. The machine is undisturbed where a thread that only wakes up was in time.

    python -m benchmarks.force_latency [--rate HZ] [--changes N]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
import multiprocessing
from multiprocessing.connection import Connection
import os
from pathlib import Path
import sys
import time
from typing import Any

from benchmarks.pipeline.child_process import (
    bus_channel,
    executable,
    private_environment,
    Program,
)
import can
from geometry_msgs.msg import WrenchStamped
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String
from std_srvs.srv import Trigger

# A simulated rig, and the passed force_check of its drives.
CONFIG = Path(__file__).resolve().parents[1] / 'config'
RIG = str(CONFIG / 'simulated_rig.yaml')
CHECK = str(CONFIG / 'simulated_check.json')
# Node ids of the drives; the identifier of the torque frames of the first one.
NODES = (11, 12, 13)
TORQUES = 0x200 + NODES[0]
# Torques about the base's z axis between which the wrench changes, N m.
STEPS = (0.06, 0.1)
# Change of a torque, per mille of the rated one, from which a frame follows a change.
FOLLOWS = 3
# Time between two wrenches, and between two changes: the least, and that much more by chance, s.
PERIOD, LEAST, BY_CHANCE = 0.005, 0.05, 0.02
# Lateness of a thread that only wakes up from which the machine was disturbed, s.
DISTURBED = 0.001
# Time to wait for programs and states, s.
PATIENCE = 60.0
FORCE = {
    'force.enabled': True,
    'force.engaged_by': 'operating_state',
    'force.damping': 0.0,
    'force.wrench_timeout': 0.1,
    'force.protection_limit_deg': 5.0,
    'force.noise_limit': 100.0,
}
POSE = {'sim.trajectory': 'fixed', 'sim.pose_deg': [130.0, 50.0, 20.0]}


def listen(channel: str, ends: Connection) -> None:
    """
    Record the torque frames of one drive, and the arrival of wrenches, until something is sent.

    Answers with two lists: time (s since the Unix epoch) and torque (per mille) of each frame, and
    arrival (s) and torque (N m) of each wrench.
    """
    frames: list[tuple[float, int]] = []
    wrenches: list[tuple[float, float]] = []
    bus = can.Bus(interface='udp_multicast', channel=channel)
    reader = can.Notifier(
        bus,
        [
            lambda message: (
                frames.append(
                    (message.timestamp, int.from_bytes(message.data[2:4], 'little', signed=True))
                )
                if message.arbitration_id == TORQUES
                else None
            )
        ],
    )
    rclpy.init()
    node = rclpy.create_node('bare_subscription')
    node.create_subscription(
        WrenchStamped,
        'servo_cf',
        lambda message: wrenches.append((time.time(), message.wrench.torque.z)),
        10,
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not ends.poll():
        executor.spin_once(0.05)
    reader.stop()
    bus.shutdown()
    with suppress(BrokenPipeError):  # who asked has ended
        ends.send((frames, wrenches))


class Client:
    """A client of force feedback: engages, and sends a wrench at 200 Hz."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('client')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.state = ''
        self.node.create_subscription(String, 'force_state', self._take, STATE)
        self.publisher = self.node.create_publisher(WrenchStamped, 'servo_cf', 10)
        self.services = [
            self.node.create_client(Trigger, name) for name in ('fkm/acknowledge', 'enable')
        ]

    def _take(self, message: String) -> None:
        self.state = message.data

    def send(self, torque: float, seconds: float) -> int:
        """Publish a torque about z, N m, for a time, s; return the time of the first, ns."""
        message = WrenchStamped()
        message.wrench.torque.z = torque
        end, first = time.monotonic() + seconds, time.time_ns()
        while time.monotonic() < end:
            self.publisher.publish(message)
            self.executor.spin_once(0.0)
            time.sleep(PERIOD)
        return first

    def engage(self) -> None:
        """Engage with no torque; TimeoutError if that does not succeed."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            for service in self.services:
                if service.service_is_ready():
                    service.call_async(Trigger.Request())
                self.send(0.0, 0.5)
            if self.state == 'engaged':
                self.send(STEPS[0], 1.0)
                return
        raise TimeoutError(f'force_state is "{self.state}", not engaged, after {PATIENCE:g} s')


def wake(ends: Connection) -> None:
    """Only wake up, until something is sent; answer with the times of the late ones, s."""
    late, began = [], time.monotonic()
    while not ends.poll():
        time.sleep(0.001)
        if time.monotonic() - began > 0.001 + DISTURBED:
            late.append(time.time())
        began = time.monotonic()
    with suppress(BrokenPipeError):  # who asked has ended
        ends.send(late)


class Beside:
    """A function in a process of its own, which answers when it is asked."""

    def __init__(self, function: Callable[..., None], *args: object):
        # A forked process would have the threads' locks of this one.
        context = multiprocessing.get_context('spawn')
        self._ends, theirs = context.Pipe()
        context.Process(target=function, args=(*args, theirs), daemon=True).start()

    def answer(self) -> Any:
        """Ask, and return the answer."""
        self._ends.send(None)
        return self._ends.recv()


def delays(
    changes: Sequence[int], arrivals: Sequence[tuple[float, float]], least: float
) -> np.ndarray:
    """
    Return the time from each change to the first arrival that follows it, s; inf: none.

    `changes` are times (ns); `arrivals` times (s) and values, which follow a change if they differ
    from the value before it by more than `least`.
    """
    times, values = np.array(arrivals).T
    found = []
    for change in 1e-9 * np.array(changes):
        since, end = np.searchsorted(times, (change, change + LEAST))
        follows = np.abs(values[since:end] - values[since - 1]) > least
        found.append(times[since + np.argmax(follows)] - change if follows.any() else np.inf)
    return np.array(found)


def undisturbed(changes: Sequence[int], late: Sequence[float]) -> np.ndarray:
    """Return which changes, ns, have no moment near them in which this machine was late, s."""
    moments = np.array(late)
    return np.array([not np.any(np.abs(moments - 1e-9 * at) < LEAST) for at in changes])


def measure(changes: int, channel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Change the wrench a number of times.

    Returns
    -------
    bare, motor : ndarray
        Delay of each change to a bare subscription and to the torque frame, s.
    is_quiet : ndarray of bool
        Whether the machine was undisturbed then.

    """
    listener = Beside(listen, channel)
    client = Client()
    client.engage()
    control, chance, sent = Beside(wake), np.random.default_rng(1), []
    while len(sent) < changes:
        at = client.send(STEPS[len(sent) % 2 - 1], LEAST + BY_CHANCE * chance.random())
        if client.state == 'engaged':
            sent.append(at)
        else:  # A pause of the machine has ended it.
            client.engage()
    late = control.answer()
    frames, wrenches = listener.answer()
    return delays(sent, wrenches, 0.01), delays(sent, frames, FOLLOWS), undisturbed(sent, late)


def row(name: str, seconds: np.ndarray) -> str:
    """Return a row of the table."""
    if not len(seconds):
        return f'| {name} | 0 | | |'
    p50, p99 = 1e3 * np.percentile(seconds, [50, 99], method='lower')
    return f'| {name} | {len(seconds)} | {p50:.2f} | {p99:.2f} |'


def report(bare: np.ndarray, motor: np.ndarray, is_quiet: np.ndarray, rate: float) -> str:
    """Return the table and the reach: a period and 3 ms."""
    reach = 1.0 / rate + 0.003
    p99 = np.percentile(motor[is_quiet], 99, method='lower') if is_quiet.any() else np.inf
    return '\n'.join(
        [
            f'{rate:g} samples/s\n',
            '| from the publication of a wrench to | changes | p50 ms | p99 ms |',
            '|---|---|---|---|',
            row('a bare subscription', bare),
            row('the torque frame on the bus', motor),
            row('a bare subscription, machine undisturbed', bare[is_quiet]),
            row('the torque frame on the bus, machine undisturbed', motor[is_quiet]),
            '',
            f'p99, machine undisturbed, reach a period and 3 ms, {1e3 * reach:g} ms: '
            f'{"met" if p99 <= reach else "not met"}',
        ]
    )


def main(args: list[str] | None = None) -> int:
    """Measure as the command line says, and print a table; return the exit code."""
    parser = argparse.ArgumentParser('force_latency', description=str(__doc__).split('\n')[1])
    parser.add_argument('--rate', type=float, default=1000.0, help='of the samples, Hz (1000)')
    parser.add_argument('--changes', type=int, default=200, help='of the wrench (200)')
    given = parser.parse_args(args)
    os.environ.update(private_environment())
    rclpy.init()
    channel = bus_channel()
    bus = {'can.interface': 'udp_multicast', 'can.channel': channel, 'rate': given.rate}
    # At 1 kHz one bus would be too busy for encoders and drives.
    second = channel.replace('239.74.0.', '239.74.1.')
    drives = {
        **bus,
        'can.channel': second,
        'drives.rated_torque': [0.5],
        'drives.event_timer': 0.5,
        'drives.status_timeout': 1.0,
        'drives.heartbeat_timeout': 0.5,
    }
    others = {'encoders.node_id': [41, 42, 43, 44], 'encoders.id': [0x1A9, 0x1AA, 0x1AB, 0x1AC]}
    master = {
        'source': 'can',
        'can.timeout': 0.5,
        'max_age': 2.0,
        'alert_limit_deg': 5.0,
        'drives.interface': 'udp_multicast',
        'drives.channel': second,
        'drives.check_file': CHECK,
    }
    with ExitStack() as stack:
        for name, arguments, parameters in (
            ('sim_bus', ('--sync',), {**bus, **POSE}),
            ('sim_bus', ('--drives', '3'), {**drives, **others}),
            ('master', (), {**drives, **FORCE, **master, **bus}),
        ):
            program = stack.enter_context(
                Program(executable(name, *arguments, '--params-file', RIG, parameters=parameters))
            )
        try:
            measured = measure(given.changes, second)
        except TimeoutError as error:
            print(f'{error}\n{program.stderr}', file=sys.stderr)
            return 1
    print(report(*measured, given.rate))
    return 0


if __name__ == '__main__':
    sys.exit(main())
