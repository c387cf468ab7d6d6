# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drives of the package and simulated ones on a virtual bus, in simulated time."""

import uuid

import can
from harness import SIMULATED_CHECK
from spm_haptic_master.drives.drives import Drives
from spm_haptic_master.drives.plan import make_plan
from spm_haptic_master.parameters.nodes import DRIVE_SETTINGS
from spm_haptic_master.parameters.setting import complete, RATE_SETTING
from spm_haptic_master.simulation.simulated_drive import SimulatedDrives

MS = 1e-3


def drive_values(**overrides):
    """Return the checked settings of three drives; in names, __ stands for a dot."""
    given = {
        'drives.channel': 'test',
        'drives.interface': 'virtual',
        'drives.rated_torque': [0.5],
        'drives.check_file': str(SIMULATED_CHECK),
    }
    given |= {name.replace('__', '.'): value for name, value in overrides.items()}
    return complete((*DRIVE_SETTINGS, RATE_SETTING), given)


def make_test_plan(**overrides):
    """Return a plan of such settings."""
    return make_plan(drive_values(**overrides))


class Rig:
    """
    One master and simulated drives, `drive`, both in steps of a millisecond.

    `sent` has time (s) and message of each frame of the master; `report` is its last one.
    """

    def __init__(self, faults=(), plan=None, factory=False, check=None):
        self.channel = uuid.uuid4().hex
        self.plan = plan or make_test_plan()
        self.bus = self.open_bus()
        self.other = self.open_bus()
        self.drives = Drives(self.plan, lambda: self.bus, 'virtual test', check)
        self.simulation = SimulatedDrives(self.plan, faults, factory)
        self.drive = self.simulation.drives
        self.now = 100.0
        self.sent = []
        self.report = None
        self.paused = False
        self._put(self.simulation.boot())

    def open_bus(self):
        """Return a further end of the bus."""
        return can.Bus(interface='virtual', channel=self.channel)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.drives.close()
        self.bus.shutdown()
        self.other.shutdown()

    def run(self, torques, seconds):
        """Let time go on; return the last report."""
        for _ in range(round(seconds / MS)):
            self.step(torques)
        return self.report

    def run_until(self, torques, condition, seconds=10.0):
        """Let time go on until a condition on the report holds; return the time that it took."""
        began = self.now
        while self.now - began < seconds:
            self.step(torques)
            if condition(self.report):
                return self.now - began
        raise AssertionError(f'not within {seconds} s: {self.report}')

    def ready(self, torques=(0.0, 0.0, 0.0)):
        """Let time go on until the drives are ready."""
        self.run_until(torques, lambda report: report.ready)

    def step(self, torques):
        """Let a millisecond go by: the master's step, unless it is paused, then the drives'."""
        if not self.paused:
            self.report = self.drives.step(torques, self.now)
        while (message := self.other.recv(0.0)) is not None:
            self.sent.append((self.now, message))
            self._put(self.simulation.receive(message, self.now))
        self._put(self.simulation.tend(self.now))
        self.now += MS

    def commands(self, since=0.0):
        """Return controlword and torque, per mille, of all frames of the master since a time."""
        ids = {drive.control_id for drive in self.plan.drives}
        return [
            (
                int.from_bytes(message.data[:2], 'little'),
                int.from_bytes(message.data[2:4], 'little', signed=True),
            )
            for at, message in self.sent
            if at >= since and message.arbitration_id in ids
        ]

    def _put(self, messages):
        for message in messages:
            self.other.send(message)
