# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drives against sim_bus over udp_multicast; times that a busy machine keeps, too."""

import time

from benchmarks.pipeline.child_process import wait_until
from drive_rig import drive_values
import pytest
from spm_haptic_master.drives.drive_factory import make_unchecked_drives

pytestmark = pytest.mark.process

PATIENCE = 60.0
TORQUES = (0.1, -0.2, 0.05)
# Rated torque (N m): twice of it for a second is too much heat for a simulated drive. Time-outs
# that other programs of this machine do not exhaust (s).
RATED = 0.2
SETTINGS = {
    'drives.rated_torque': [RATED],
    'drives.event_timer': 0.5,
    'drives.status_timeout': 1.0,
    'drives.heartbeat_timeout': 0.5,
}


@pytest.fixture
def sim_bus(start, bus_channel):
    """Start sim_bus with drives alone on their bus; give a function for its arguments."""

    def run(*args):
        program = start(
            'sim_bus',
            '--drives',
            '3',
            *args,
            parameters={
                'can.interface': 'udp_multicast',
                'can.channel': bus_channel,
                **SETTINGS,
            },
        )
        assert wait_until(
            lambda: 'sim_bus: 3 drives on udp_multicast' in program.stdout, PATIENCE
        ), program.stderr
        return program

    return run


@pytest.fixture
def drives(bus_channel):
    """Give drives on that bus."""
    made = make_unchecked_drives(
        drive_values(
            drives__interface='udp_multicast',
            drives__channel=bus_channel,
            **SETTINGS,
        )
    )
    yield made
    made.close()


def step_until(drives, torques, condition):
    """Step at about 1 kHz until a condition on the report holds; return the report."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        report = drives.step(torques, time.monotonic())
        if condition(report):
            return report
        time.sleep(0.001)
    raise AssertionError(str(report))


def started(drives):
    """Step the start-up to its end; return the last report."""
    return step_until(
        drives,
        (0.0, 0.0, 0.0),
        lambda report: report.ready or (report.fault and 'does not answer' not in report.fault),
    )


def test_simulated_drives_are_proven_make_torques_and_report_a_fault(sim_bus, drives):
    sim_bus()
    report = started(drives)
    assert report.fault is None
    report = step_until(
        drives, TORQUES, lambda report: report.fault or report.torques == pytest.approx(TORQUES)
    )
    assert report.fault is None
    assert report.ready
    report = step_until(drives, (0.0, 2.0 * RATED, 0.0), lambda report: report.fault)
    assert not report.ready
    assert 'drive of joint_1b (node 12): EMCY 0x2350 I2t, load level fault' in report.fault
    step_until(drives, TORQUES, lambda report: not any(report.torques))


def test_a_fault_on_the_command_line_begins_and_is_printed(sim_bus, drives):
    program = sim_bus('--fault', 'drive:joint_1a@0.5=0x2310')
    started(drives)
    report = step_until(drives, TORQUES, lambda report: report.fault)
    assert 'drive of joint_1a (node 11)' in report.fault
    assert wait_until(lambda: 'drive:joint_1a@0.5=0x2310 begins' in program.stdout, PATIENCE)
