# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drives as their makers' EDS describe them: what is said, verified by hand, and then accepted."""

import time
import uuid

import can
from drive_rig import make_test_plan
from foreign_drives import epos2, epos4, faulhaber, FIRST_SERIAL, foreign_drives, ipos
from foreign_nodes import canopen, Held
import pytest
from spm_haptic_master.drives.drives import Drives
from spm_haptic_master.drives.passed_check import Identity
from spm_haptic_master.tools import can_setup

# What makes an EPOS4 a drive that can be used: verified by hand, and its status on SYNC.
BY_HAND = '0x6072:00 0x1400:05'
EPOS4 = {'drives.verified_by_hand': BY_HAND, 'drives.status_by': 'sync'}
PATIENCE = 60.0


@pytest.fixture
def channel():
    return uuid.uuid4().hex


@pytest.fixture
def setup(capsys):
    """Return what runs can_setup on the drives of a channel: exit code and output."""

    def run(channel, *args, **settings):
        given = {
            'drives.interface': 'virtual',
            'drives.channel': channel,
            'drives.rated_torque': '[0.5]',
            **settings,
        }
        words = [word for name, value in given.items() for word in ('-p', f'{name}:={value}')]
        code = can_setup.main(['can_setup', '--drives', *args, *words])
        return code, capsys.readouterr().out

    return run


def quoted(settings):
    """Return settings as arguments that are texts."""
    return {name: f"'{value}'" for name, value in settings.items()}


def test_what_epos4_lacks_is_said_with_what_to_verify_by_hand(channel, setup):
    with foreign_drives(channel, epos4):
        code, text = setup(channel)
    assert code == 1
    first = text.split('joint_1b')[0]
    lacks = [line.strip() for line in first.splitlines() if 'missing' in line]
    assert len(lacks) == 3
    timer, status, cap = lacks
    assert timer.startswith('0x1400:05 RPDO1 event timer, ms: missing, wanted 10; torque frames')
    assert timer.endswith('give drives.verified_by_hand: 0x1400:05')
    assert status == (
        '0x1800:05 TPDO1 event timer, ms: missing, wanted 4; its status needs SYNC: give '
        "drives.status_by: 'sync'"
    )
    assert 'allows at most 1000 per mille of the rated torque' in cap
    assert cap.endswith('give drives.verified_by_hand: 0x6072:00')


def test_epos4_is_set_up_once_its_limits_were_verified_by_hand(channel, setup):
    """Status on SYNC is transmission type 1; nothing of a timer is wanted."""
    with foreign_drives(channel, epos4) as nodes:
        code, text = setup(channel, **quoted(EPOS4))
        assert code == 1
        assert 'TPDO1 transmission type: 255, wanted 1' in text
        for node in nodes:
            node.sdo[0x1800][2].raw = 1
        code, text = setup(channel, **quoted(EPOS4))
    assert code == 0, text
    assert '0x6072:00 was verified by hand (drives.verified_by_hand)' in text
    assert '3 of 3 drives as configured' in text


def test_one_optional_object_that_is_refused_does_not_end_the_comparison(channel, setup):
    """An abort for another reason than that it does not exist (here: 0x08000000)."""

    def refuse(index, subindex, **_):
        if (index, subindex) == (0x60C2, 1):
            raise canopen.SdoAbortedError(0x08000000)

    with foreign_drives(channel, epos4, refuse) as nodes:
        for node in nodes:
            node.sdo[0x1800][2].raw = 1
        code, text = setup(channel, **quoted(EPOS4))
    assert code == 0, text
    assert '0x60C2:01' in text
    assert 'need not have' in text


def test_ipos_cannot_be_used_as_it_does_not_notice_a_master_that_hangs(channel, setup):
    with foreign_drives(channel, ipos):
        code, text = setup(channel)
    assert code == 1
    assert 'does not notice a master that hangs: it cannot be used here' in text
    assert 'drives.torque_unit: 0.0' in text
    assert 'verified_by_hand: 0x6072:00' in text


@pytest.mark.parametrize('objects', [faulhaber, epos2])
def test_a_drive_without_a_target_torque_is_refused_and_not_written(channel, setup, objects):
    with foreign_drives(channel, objects):
        code, text = setup(channel, '--write', **quoted(EPOS4))
    assert code == 1
    refusals = [line for line in text.splitlines() if line.endswith('nothing was written')]
    assert len(refusals) == 3
    for line in refusals:
        assert (
            '0x6071:00 target torque: missing, wanted any value; the drive has no torque to '
            'command or to compare: it cannot be used here' in line
        )


def started(channel, plan, until):
    """Step drives on a channel until a condition on report and drives holds; return both."""
    drives = Drives(
        plan=plan,
        open_bus=lambda: can.Bus(interface='virtual', channel=channel),
        name='virtual',
        check=None,
    )
    end = time.monotonic() + PATIENCE
    try:
        while time.monotonic() < end:
            report = drives.step((0.0, 0.0, 0.0), time.monotonic())
            if until(report):
                return drives, report
            time.sleep(0.001)
    finally:
        drives.close()
    raise AssertionError(str(report))


def is_answered(report):
    """Return whether all answers of the drives are read: a fault that is none of their silence."""
    return report.fault is not None and 'does not answer' not in report.fault


def test_the_start_says_the_same_and_sends_no_torque(channel):
    with foreign_drives(channel, epos4):
        _, report = started(channel, make_test_plan(), is_answered)
    assert report.fault.startswith('drive of joint_1a (node 11): 0x1400:05 RPDO1 event timer')
    assert 'verify by hand that its limit of the current (EPOS4: 0x3001:02)' in report.fault


def test_drives_as_configured_are_read_to_their_identity_and_asked_for_a_status(channel):
    """The LocalNode has no states of CiA 402: it ends where the first status frame is due."""

    def turned_around(node_id):
        return {**epos4(node_id), (0x607E, 0): Held(0x20, 1)}

    plan = make_test_plan(drives__verified_by_hand=BY_HAND, drives__status_by='sync')
    with foreign_drives(channel, turned_around) as nodes:
        for node in nodes:
            node.sdo[0x1800][2].raw = 1
        drives, report = started(channel, plan, is_answered)
    assert 'no status frame 2 s after its start' in report.fault
    check = drives.passed_check('today')
    assert [drive.identity for drive in check.drives] == [
        Identity(vendor=0xFB, product=0x6550, serial=FIRST_SERIAL + number, polarity=0x20)
        for number in range(3)
    ]
