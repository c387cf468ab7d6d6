# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""can_setup --drives and can_scan against simulated drives on a virtual bus."""

from contextlib import contextmanager

import can
import pytest
from spm_haptic_master.drives.plan import make_plan
from spm_haptic_master.encoders import canopen
from spm_haptic_master.parameters.nodes import DRIVE_SETTINGS
from spm_haptic_master.parameters.setting import complete, RATE_SETTING
from spm_haptic_master.simulation.bus_runner import DriveLoop
from spm_haptic_master.simulation.simulated_drive import SimulatedDrives
from spm_haptic_master.tools import can_scan, can_setup

RATED = ('-p', 'drives.rated_torque:=[0.5]')


@pytest.fixture
def setup(capsys, channel):
    """Run can_setup --drives on the bus; return its exit code, stdout and stderr."""
    pytest.importorskip('canopen')

    def run(*args):
        capsys.readouterr()
        code = can_setup.main(
            [
                'can_setup',
                '--drives',
                '-p',
                'drives.interface:=virtual',
                '-p',
                f'drives.channel:={channel}',
                *args,
            ]
        )
        return code, *capsys.readouterr()

    return run


@contextmanager
def simulated(
    channel,
    factory=False,
    node_ids=(11, 12, 13),
):
    """Run simulated drives in a thread; give them."""
    drives = SimulatedDrives(
        make_plan(
            complete(
                (*DRIVE_SETTINGS, RATE_SETTING),
                {
                    'drives.channel': 'x',
                    'drives.rated_torque': [0.5],
                    'drives.node_id': [*node_ids],
                },
            )
        ),
        factory=factory,
    )
    with can.Bus(interface='virtual', channel=channel) as bus:
        loop = DriveLoop(bus, drives)
        try:
            yield drives.drives
        finally:
            loop.close()
            assert loop.error is None


def test_drives_of_the_maker_are_set_up_stored_and_read_back(channel, setup):
    with simulated(channel, factory=True) as drives:
        code, out, err = setup(*RATED)
        assert (code, err) == (1, '')
        assert 'joint_1b, node 12: drive 0x00020192, vendor 0x0' in out
        for line in (
            '0x6007:00 abort connection option: 1, wanted 2',
            '0x1400:05 RPDO1 event timer, ms: 0, wanted 10',
            "0x1016:01 master's heartbeat: 0x0, wanted 0x7E003C",
            '0x6072:00 maximum torque, per mille: 0, wanted 1000',
        ):
            assert out.count(line) == 3, out
        assert out.endswith('3 of 3 drives not as configured; nothing was written (--write)\n')
        code, out, err = setup(*RATED, '--write')
        assert (code, err) == (0, ''), out
        assert out.endswith('3 of 3 drives as configured, stored and read back after a reset\n')
        code, out, _ = setup(*RATED)
        assert code == 0
        assert out.endswith('3 of 3 drives as configured\n')
        assert [drive.objects.value(0x6007, 0) for drive in drives] == [2, 2, 2]
        assert drives[1].objects.mapped(0x1600) == [0x60400010, 0x60710010]


def test_another_rated_torque_is_named_and_never_written(channel, setup):
    with simulated(channel) as drives:
        code, out, _ = setup(
            '-p',
            'drives.rated_torque:=[0.4]',
            '-p',
            'drives.torque_limit:=0.4',
            '--write',
        )
    assert code == 1
    assert out.count('0x6076:00 rated torque: 500, wanted 400') == 6
    assert all(drive.objects.value(0x6076, 0) == 500 for drive in drives)


def test_nothing_is_written_while_a_master_runs(channel, setup):
    with simulated(channel, factory=True), can.Bus(interface='virtual', channel=channel) as master:
        task = master.send_periodic(canopen.frame(0x700 + 126, b'\x05'), 0.01)
        code, _, err = setup(*RATED, '--write')
        task.stop()
    assert code == 1
    assert err == (
        'can_setup: heartbeat 0x77E on the bus: a master is running; stop it before '
        'anything is written\n'
    )


def test_a_joint_without_a_drive_is_refused(setup):
    code, _, err = setup(*RATED, '--joint', 'joint_3b')
    assert code == 1
    assert '--joint joint_3b with --drives; expected one of joint_1a' in err


def test_a_scan_names_the_drives_and_the_one_that_is_missing(
    channel,
    capsys,
    monkeypatch,
):
    monkeypatch.setattr('spm_haptic_master.encoders.bus_scan.SYNC_LISTEN', 0.0)
    with simulated(channel, node_ids=(11, 12)):
        code = can_scan.main(
            [
                'can_scan',
                '--seconds',
                '0.5',
                '--start',
                '-p',
                'can.interface:=virtual',
                '-p',
                f'can.channel:={channel}',
                '-p',
                'rate:=100.0',
                '-p',
                'drives.interface:=virtual',
                '-p',
                f"drives.channel:='{channel}'",
                *RATED,
                '-p',
                'drives.event_timer:=0.1',
            ]
        )
    out = capsys.readouterr().out
    assert 'status of the drive of joint_1b (node 12)' in out
    assert 'device type 0x00020192 (CiA 402, drive)' in out
    assert 'unexpected' not in out
    assert 'node 12): not heard' not in out
    assert code == 1
    assert 'drive of joint_1c (node 13): not heard' in out
