# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a loss to zero torque at the motors, by the frames on the bus: master, encoders, drives."""

from bisect import bisect_left
from collections import defaultdict
from contextlib import closing
import os
import signal
import subprocess
import sys
import threading
import time

from benchmarks.pipeline.child_process import private_environment, wait_until
import can
from disturbance import Disturbance, SKIPPED
import force_client
from force_client import PATIENCE, TORQUE
from geometry_msgs.msg import QuaternionStamped
from harness import Observer, SIMULATED, SIMULATED_CHECK
import numpy as np
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.ros.runner import PROFILE_VARIABLES, RANGE
from std_msgs.msg import String

pytestmark = [pytest.mark.process, pytest.mark.alone]

# Nodes of the drives, and the identifiers of their commands, status frames and emergencies.
NODES = (11, 12, 13)
COMMANDS = tuple(0x200 + node for node in NODES)
STATUS = tuple(0x180 + node for node in NODES)
EMERGENCIES = tuple(0x080 + node for node in NODES)
ENCODERS = (0x181, 0x182, 0x183, 0x184)
# Beyond a drive's time-out (s): its grid of time, and the way of a frame.
GRID = 0.002
# Between two samples (s).
SYNC_PERIOD = 0.002
# Error codes of the drives.
PDO_LOST = 0x8250
HEARTBEAT_LOST = 0x8130
MASTER = {
    'source': 'can',
    'can.timeout': 0.5,
    'max_age': 2.0,
    'alert_limit_deg': 5.0,
    'crtk_rate': 0.0,
}
POSE = {'sim.trajectory': 'fixed', 'sim.pose_deg': [130.0, 50.0, 20.0]}
# Time-outs that other programs of this machine do not exhaust (s); and such of a rig.
PATIENT = {
    'drives.event_timer': 0.5,
    'drives.status_timeout': 1.0,
    'drives.heartbeat_timeout': 0.5,
}
EVENT_TIMER = PATIENT | {'drives.event_timer': 0.01}
LONGER_EVENT_TIMER = PATIENT | {'drives.event_timer': 0.03}
HEARTBEAT = PATIENT | {'drives.event_timer': 0.0, 'drives.heartbeat_timeout': 0.06}


class Ear:
    """
    All frames on the bus: by identifier, their times and data.

    A time is that at which the kernel received the frame, s since the Unix epoch.
    """

    def __init__(self, channel):
        self._frames = defaultdict(lambda: ([], []))
        self._bus = can.Bus(interface='udp_multicast', channel=channel)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        while not self._stop.is_set():
            message = self._bus.recv(0.1)
            if message is not None:
                times, data = self._frames[message.arbitration_id]
                data.append(bytes(message.data))
                times.append(message.timestamp)

    def close(self):
        self._stop.set()
        self._thread.join()
        self._bus.shutdown()

    def of(self, identifiers, since=0.0):
        """Return time and data of the frames with some identifiers from a time on."""
        found = []
        for identifier in identifiers:
            times, data = self._frames[identifier]
            # Not all of them: some thousands come each second.
            first = bisect_left(times, since)
            end = len(times)
            found += zip(times[first:end], data[first:end], strict=True)
        return sorted(found)

    def emergencies(self, code, since=0.0):
        """Return the times of the emergencies with a code from a time on."""
        return [
            at
            for at, data in self.of(EMERGENCIES, since)
            if int.from_bytes(data[:2], 'little') == code
        ]

    def reset(self, node_id):
        """Reset a node."""
        self._bus.send(canopen.nmt(canopen.NMT_RESET_NODE, node_id))

    def boot_ups(self, since):
        """Return the times of the boot-up messages of drives from a time on."""
        identifiers = tuple(canopen.HEARTBEAT_BASE + node for node in NODES)
        return [at for at, data in self.of(identifiers, since) if data == b'\0']

    def torque_ends(self, since):
        """Return the time of the last frame from a time on that commands a torque."""
        return max((at for at, data in self.of(COMMANDS, since) if any(data[2:4])), default=since)


def has_torque(data):
    """Return whether a status frame reports a torque."""
    return abs(int.from_bytes(data[2:4], 'little', signed=True)) > 5


class Rig:
    """Simulated encoders and drives, a master, and a client of its force feedback."""

    def __init__(self, start, channel, values):
        bus = {
            'can.interface': 'udp_multicast',
            'can.channel': channel,
            'rate': 500.0,
        }
        drives = {'drives.rated_torque': [0.5], **values}
        force = {**force_client.FORCE, 'force.without_drives': False}
        force |= {name: drives.pop(name) for name in list(drives) if name.startswith('force.')}
        self.ear = Ear(channel)
        self.encoders = start('sim_bus', '--sync', *SIMULATED, parameters={**bus, **POSE})
        # Its encoders are never started: nobody has their node ids.
        self.drives = start(
            'sim_bus',
            '--drives',
            '3',
            parameters={
                **bus,
                **drives,
                'encoders.node_id': [41, 42, 43, 44],
                'encoders.id': [0x1A9, 0x1AA, 0x1AB, 0x1AC],
            },
        )
        assert wait_until(
            lambda: (
                'four encoders' in self.encoders.stdout and '3 drives on' in self.drives.stdout
            ),
            PATIENCE,
        ), self.encoders.stderr + self.drives.stderr
        self.master = start(
            'master',
            *SIMULATED,
            '-r',
            '__ns:=/lost',
            parameters={
                **MASTER,
                **bus,
                **force,
                **drives,
                'drives.check_file': str(SIMULATED_CHECK),
                'drives.interface': 'udp_multicast',
                'drives.channel': channel,
            },
        )
        self.observer = Observer()
        self.client = force_client.Client(self.observer, '/lost')

    def feel(self):
        """Have all drives make a torque; skip the test where other programs prevent it."""

        def made():
            now = time.time()
            latest = [self.ear.of((each,), now - 0.2)[-1:] for each in STATUS]
            return all(frames and has_torque(frames[0][1]) for frames in latest)

        with Disturbance() as self.machine:
            try:
                is_felt = self.client.feels(TORQUE, made)
            except pytest.fail.Exception:
                is_felt = False  # not engaged within PATIENCE
        self.machine.expect(is_felt, self.client.entry())

    def was_on(self, machine, at):
        """Check that there was torque right before a time; skip where the machine ended it."""
        machine.expect(self.ear.torque_ends(at - 0.05) > at - 0.05, self.client.entry())

    def close(self):
        self.observer.close()
        self.ear.close()


@pytest.fixture
def rig(start, bus_channel, stack):
    """Start a rig with some values of its parameters, and have its drives make a torque."""
    # On a busy machine such time-outs end all torque again and again, and it takes minutes to see.
    with Disturbance() as machine:
        time.sleep(0.4)
    if machine.disturbed:
        pytest.skip(f'{SKIPPED}{machine}')

    def make(values):
        made = stack.enter_context(closing(Rig(start, bus_channel, values)))
        made.feel()
        return made

    return make


def fallen(rig, code, began):
    """Return the time from `began` until the last of the drives has fallen out."""
    ear = rig.ear
    assert wait_until(lambda: len(ear.emergencies(code, began)) >= len(NODES), PATIENCE), (
        rig.drives.stdout
    )
    # And without torque: status frames that come later.
    last = max(ear.emergencies(code, began)[: len(NODES)])
    assert wait_until(lambda: all(ear.of((each,), last + 0.01) for each in STATUS), PATIENCE)
    assert not any(has_torque(data) for _, data in ear.of(STATUS, last + 0.01))
    return last - began


@pytest.mark.parametrize('ending', [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize(
    ('values', 'code', 'limit'),
    [
        (LONGER_EVENT_TIMER, PDO_LOST, LONGER_EVENT_TIMER['drives.event_timer']),
        (HEARTBEAT, HEARTBEAT_LOST, HEARTBEAT['drives.heartbeat_timeout']),
    ],
)
def test_a_master_that_ends_or_hangs(rig, ending, values, code, limit):
    running = rig(values)
    with Disturbance() as machine:
        began = time.time()
        os.kill(running.master.pid, ending)
        took = fallen(running, code, began)
    if ending == signal.SIGSTOP:
        os.kill(running.master.pid, signal.SIGCONT)
    running.was_on(machine, began)
    machine.expect(took <= limit + GRID, took)


def test_encoders_that_end(rig):
    """The master has no samples then, and sends no torques: the drives fall out."""
    running = rig(EVENT_TIMER)
    with Disturbance() as machine:
        running.encoders.kill()
        assert wait_until(lambda: time.time() - running.ear.of(ENCODERS)[-1][0] > 0.5, PATIENCE)
        began = running.ear.of(ENCODERS)[-1][0]
        ended = running.ear.torque_ends(began)
        lost = running.ear.emergencies(PDO_LOST, began)
        took = min([ended, *lost[len(NODES) - 1 : len(NODES)]]) - began
    running.was_on(machine, began)
    machine.expect(took <= 0.025, took)


def test_one_drive_that_restarts(rig):
    running = rig(PATIENT)
    ear = running.ear
    with Disturbance() as machine:
        asked = time.time()
        ear.reset(NODES[1])
        assert wait_until(lambda: ear.boot_ups(asked), PATIENCE)
        began = ear.boot_ups(asked)[0]
        running.observer.spin_until(lambda: False, 0.3)
        took = ear.torque_ends(began) - began
    running.was_on(machine, asked)
    machine.expect(took <= 0.005, took)
    # And it stays so, and says why.
    assert ear.torque_ends(began + 0.2) == began + 0.2
    assert running.observer.spin_until(
        lambda: '(node 12): booted' in running.client.entry()[1].get('drives', ''), PATIENCE
    )


# A reader of `orientation`, as any other program: with shared memory.
READER = """
import sys, rclpy
from geometry_msgs.msg import QuaternionStamped
rclpy.init()
node = rclpy.create_node('reader')
node.create_subscription(QuaternionStamped, sys.argv[1], lambda message: None, 10)
rclpy.spin(node)
"""
# Stops of the reader, the time of one and between two (s), and the time after which frames and
# orientations have to come (s): 25 of them are due in the rest of a stop.
STOPS = 100
STOPPED = 0.15
BETWEEN = 0.03
SOON = 0.1


def foreign_environment():
    """Return the environment of a program on this host that knows nothing of the package."""
    foreign = private_environment() | {RANGE: 'LOCALHOST'}
    for name in PROFILE_VARIABLES:
        del foreign[name]
    return foreign


def test_a_reader_that_stands_still_stops_neither_torque_frames_nor_orientation(rig):
    """A9: it may hold a mutex in shared memory that sending `orientation` would need."""
    # With a torque: the bring-up of the drives has pauses of its own.
    running = rig(PATIENT)
    observer = running.observer
    # Their times alone: to search ten thousand messages for garbage stops this process at times.
    heard = []
    observer.node.create_subscription(
        QuaternionStamped, '/lost/orientation', lambda _: heard.append(time.time()), 10
    )
    # This bus of 4,000 frames a second may lose some, which is a reason to be silent.
    states = observer.collect(String, '/lost/state', STATE)
    reader = subprocess.Popen(
        [sys.executable, '-c', READER, '/lost/orientation'], env=foreign_environment()
    )
    try:
        assert observer.spin_until(
            lambda: observer.node.count_subscribers('/lost/orientation') == 2 and heard and states,
            PATIENCE,
        )
        without_frames = []
        without_orientation = []
        with Disturbance() as machine:
            for number in range(STOPS):
                os.kill(reader.pid, signal.SIGSTOP)
                due = time.time() + SOON
                observer.spin(STOPPED)
                if not running.ear.of(COMMANDS[:1], due):
                    without_frames.append(number)
                if heard[-1] < due and states[-1][1].data.startswith('healthy'):
                    without_orientation.append(number)
                os.kill(reader.pid, signal.SIGCONT)
                observer.spin(BETWEEN)
    finally:
        reader.kill()
        reader.wait()
    machine.expect(
        not without_frames and not without_orientation,
        f'stops without frames {without_frames}, without orientation {without_orientation}',
    )


@pytest.mark.evidence
def test_a_wrench_that_ends_is_no_torque_after_50_ms(rig):
    """In the median of the losses in which no torque frame came two periods late."""
    running = rig(PATIENT | {'force.wrench_timeout': 0.03})
    took = []
    client = running.client
    for _ in range(10):
        client.torque = None
        began = 1e-9 * client.sent
        running.observer.spin_until(lambda: False, 0.3)
        times = [at for at, _ in running.ear.of(COMMANDS[:1], began - 0.01) if at < began + 0.06]
        if np.diff(times).max() <= 3.0 * SYNC_PERIOD:
            took.append(running.ear.torque_ends(began) - began)
        running.feel()
    if len(took) < 3:
        pytest.skip(f'{SKIPPED}{len(took)} of 10 losses without a pause')
    assert 0.03 < np.median(took) <= 0.05 + GRID, took
