# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a scan says of a bus: what is there, what is missing, what nobody expects."""

import can
from encoder_frames import answer, cycle, LAYOUTS, T0
import pytest

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan, frame_name
from spm_haptic_master.joints import JOINT_NAMES

NODES = (1, 2, 3, 4)


def scanned(messages):
    scan = BusScan()
    for message in messages:
        scan.feed(message)
    return scan


def good(cycles=50):
    return [message for number in range(cycles) for message in cycle(number)]


def problems(scan, rate=1000.0, **how):
    return scan.problems(LAYOUTS, 0x80, NODES, rate, how.get('sync_made', False))


def at(message, when=T0):
    message.timestamp = when
    return message


def test_a_bus_as_configured_has_no_problem():
    heartbeats = [at(canopen.frame(0x700 + n, b'\x05')) for n in NODES]
    scan = scanned(good() + heartbeats)
    assert problems(scan) == []
    lines = '\n'.join(scan.lines(LAYOUTS, 0x80))
    assert 'joint_3a' in lines
    assert '1000.0 Hz' in lines
    assert 'node   4: operational' in lines


@pytest.mark.parametrize(('change', 'expected'), [
    (lambda m: [x for x in m if x.arbitration_id != 0x80], 'no SYNC 0x80'),
    (lambda m: [x for x in m if x.arbitration_id != 0x183],
     'joint_1c: 0x183 missing; its node 3 was not heard either'),
    (lambda m: [x for x in m if x.arbitration_id != 0x183] + [at(canopen.frame(0x703, b'\x7f'))],
     'joint_1c: 0x183 missing; its node 3 is pre-operational'),
    (lambda m: [x for x in m if x.arbitration_id != 0x183]
     + [at(canopen.frame(0x703, b'\x05')), at(canopen.frame(0x283, bytes(4)))],
     'its node sends on 0x283'),
    (lambda m: [x for x in m if x.arbitration_id != 0x183] + [answer(2, T0, is_extended_id=True)],
     'joint_1c: 0x183 missing; it comes with 29 bits instead'),
    (lambda m: [*m, answer(1, T0 + 0.049, data=bytes(8))],
     'joint_1b: 0x182 has 4, 8 bytes, configured 4'),
    (lambda m: [*m, at(canopen.frame(0x705, b'\x05'))], 'unexpected: node 5 (operational)'),
    (lambda m: [*m, at(canopen.frame(0x123, b'\x05'))], 'unexpected: 0x123'),
    (lambda m: [*m, at(canopen.emcy(2, 0x5000, 1))], 'joint_1b: EMCY 0x5000 device hardware'),
    (lambda m: [*m, can.Message(arbitration_id=0x40, is_error_frame=True, timestamp=T0)],
     'error frames: bus-off'),
    (lambda m: [], 'nothing heard at all'),
])
def test_what_is_wrong_is_named(change, expected):
    assert any(expected in line for line in problems(scanned(change(good()))))


def test_a_rate_that_differs_is_named():
    assert problems(scanned(good()), rate=500.0) == [
        f'{joint}: 0x{0x181 + n:X} comes at 1000.0 Hz, configured 500 Hz'
        for n, joint in enumerate(JOINT_NAMES)]


def test_who_scans_with_sync_needs_no_other():
    messages = [m for m in good() if m.arbitration_id != 0x80]
    assert problems(scanned(messages), sync_made=True) == []


def test_identity_is_told():
    scan = scanned([
        at(canopen.sdo_answer(2, *canopen.DEVICE_TYPE, 0x00010196)),
        at(canopen.sdo_answer(2, *canopen.VENDOR_ID, 0x42)),
        at(canopen.sdo_abort(2, *canopen.SERIAL_NUMBER, 0x06020000)),
        at(canopen.frame(0x702, b'\x00'))])
    (line,) = [line for line in scan.lines(LAYOUTS, 0x80) if 'node   2' in line]
    assert line.endswith(
        'booting, booted 1 x, device type 0x00010196 (CiA 406, encoder), vendor 0x42')


@pytest.mark.parametrize(('extended', 'identifier', 'name'), [
    (False, 0, 'NMT'), (False, 0x80, 'SYNC'), (False, 0x81, 'EMCY of node 1'),
    (False, 0x2FF, 'TPDO2 of node 127'), (False, 0x700, 'foreign'), (True, 0x181, '29-bit frame'),
    (False, 0x605, 'SDO request to node 5')])
def test_identifiers_have_names(extended, identifier, name):
    assert frame_name(extended, identifier) == name
