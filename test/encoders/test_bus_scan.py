# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a scan says of a bus: what is there, what is missing, what nobody expects."""

import can
from encoder_frames import answer, cycle, LAYOUTS, T0
import numpy as np
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan, frame_name
from spm_haptic_master.encoders.scan_problems import busy, Expected
from spm_haptic_master.encoders.scan_problems import problems as found_problems

NODES = (1, 2, 3, 4)


def scanned(messages, sync_id=0x80):
    scan = BusScan(sync_id)
    for message in messages:
        scan.feed(message)
    return scan


def good(cycles=50):
    return [message for number in range(cycles) for message in cycle(number)]


def problems(scan, rate=1000.0, nodes=NODES):
    return found_problems(scan, Expected(LAYOUTS, nodes, rate))


def scanned_with_own_sync(answers, sent, rate=1000.0):
    """Scan `sent` cycles of SYNC sent here, of which the encoders answer those in `answers`."""
    scan = BusScan()
    for number in range(sent):
        scan.sent_sync(number / rate)
        if number in answers:
            for index in range(4):
                scan.feed(answer(index, T0 + number / rate))
    return scan


def at(message, when=T0):
    message.timestamp = when
    return message


def test_a_bus_as_configured_has_no_problem():
    heartbeats = [at(canopen.frame(0x700 + n, b'\x05')) for n in NODES]
    scan = scanned(good() + heartbeats)
    assert problems(scan) == []
    assert set(scan.nodes) == set(NODES)
    lines = '\n'.join(scan.lines(LAYOUTS))
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
    (lambda m: [], 'no frames at all'),
])
def test_what_is_wrong_is_named(change, expected):
    assert any(expected in line for line in problems(scanned(change(good()))))


def test_a_rate_other_than_that_of_sync_on_the_bus_is_one_problem():
    """The encoders answer every SYNC: none of them is to blame."""
    assert problems(scanned(good()), rate=500.0) == [
        "SYNC 0x80 comes at 1000.0 Hz, rate is 500 Hz: give the bus's rate to all nodes"]


def test_the_rate_of_a_master_is_what_it_is_set_to_on_a_busy_machine():
    """A third of its SYNCs is lost, and the others are late by up to a fifth of a period."""
    rng = np.random.default_rng(2)
    stamps = [T0 + 0.02 * number + rng.uniform(0.0, 4e-3) for number in range(150)
              if rng.random() > 1.0 / 3.0]
    scan = scanned([at(canopen.frame(0x80), stamp) for stamp in stamps])
    assert scan.master_sync.rate < 40.0
    assert scan.master_rate == pytest.approx(50.0, rel=0.05)
    assert scanned([at(canopen.frame(0x80))]).master_rate == scanned([]).master_rate == 0.0


def test_an_encoder_that_does_not_answer_every_sync_is_named():
    messages = [m for number in range(50) for m in cycle(number)
                if m.arbitration_id != 0x182 or number % 2 == 0]
    assert problems(scanned(messages)) == [
        'joint_1b: 0x182 comes 25 times in 49 cycles of SYNC; expected one answer each']


def test_a_scan_that_sends_sync_needs_no_master():
    assert problems(scanned_with_own_sync(range(50), 50)) == []
    assert busy(scanned_with_own_sync(range(50), 50), 1000.0) is None


def test_a_sync_that_this_machine_sends_too_slowly_is_not_the_encoders_fault():
    for answers in (range(50), range(0, 50, 2)):
        scan = scanned_with_own_sync(answers, 50, rate=612.0)
        assert problems(scan) == []
        assert busy(scan, 1000.0).startswith(
            'this machine is too busy: SYNC was sent at 612.0 Hz instead of 1000 Hz; ')
    # At its rate it is theirs.
    assert len(problems(scanned_with_own_sync(range(0, 50, 2), 50))) == 4


def test_what_was_sent_here_is_listed_as_such():
    scan = scanned_with_own_sync(range(50), 50)
    scan.started |= {3, 1}
    assert scan.lines(LAYOUTS)[4:] == [
        '  sent from here: 50 x SYNC 0x80, 1000.0 Hz', '  sent from here: NMT start to node 1, 3']


def test_identity_is_told():
    scan = scanned([
        at(canopen.sdo_answer(2, *canopen.DEVICE_TYPE, 0x00010196)),
        at(canopen.sdo_answer(2, *canopen.VENDOR_ID, 0x42)),
        at(canopen.sdo_abort(2, *canopen.SERIAL_NUMBER, 0x06020000)),
        at(canopen.frame(0x702, b'\x00'))])
    (line,) = [line for line in scan.lines(LAYOUTS) if 'node   2' in line]
    assert line.endswith(
        'booting, booted 1 x, device type 0x00010196 (CiA 406, encoder), vendor 0x42')


@pytest.mark.parametrize(('extended', 'identifier', 'name'), [
    (False, 0, 'NMT'), (False, 0x80, 'SYNC'), (False, 0x81, 'EMCY of node 1'),
    (False, 0xFF, 'EMCY of node 127'), (False, 0x181, 'TPDO1 of node 1'),
    (False, 0x2FF, 'TPDO2 of node 127'), (False, 0x381, 'TPDO3 of node 1'),
    (False, 0x4FF, 'TPDO4 of node 127'), (False, 0x581, 'SDO answer of node 1'),
    (False, 0x77F, 'heartbeat of node 127'), (False, 0x201, 'foreign'),
    (False, 0x180, 'foreign'), (False, 0x1, 'foreign'), (False, 0x700, 'foreign'),
    (True, 0x181, '29-bit frame'),
    (False, 0x605, 'SDO request to node 5')])
def test_identifiers_have_names(extended, identifier, name):
    assert frame_name(extended, identifier) == name


def without(identifier, messages):
    return [message for message in messages if message.arbitration_id != identifier]


def test_a_scan_counts_lengths_rates_and_times():
    scan = scanned([at(canopen.frame(0x123, bytes(length)), T0 + when)
                    for length, when in ((8, 0.0), (2, 0.25), (8, 0.5))])
    heard = scan.frames[False, 0x123]
    assert (heard.count, heard.first, heard.last) == (3, T0, T0 + 0.5)
    assert heard.lengths == {8: 2, 2: 1}
    assert heard.rate == pytest.approx(4.0)
    assert scan.lines(LAYOUTS) == [
        '  0x123       4.0 Hz  2/8 bytes        3 frames  foreign']


def test_one_frame_has_no_rate():
    scan = scanned([at(canopen.frame(0x123))])
    assert scan.frames[False, 0x123].rate == 0.0


def test_a_scan_lists_identifiers_nodes_and_errors():
    error = can.Message(arbitration_id=0x40, is_error_frame=True, timestamp=T0)
    remote = can.Message(arbitration_id=0x181, is_remote_frame=True, is_extended_id=False,
                         timestamp=T0)
    scan = scanned([
        *cycle(0), *cycle(1), answer(0, T0, is_extended_id=True), at(canopen.emcy(3, 0x5000, 1)),
        at(canopen.emcy(3, 0x5000, 1)), error, error, remote,
        at(canopen.sdo_upload(9, 0x1000, 0))])
    assert (scan.errors['bus-off'], scan.remote) == (2, 1)
    lines = scan.lines(LAYOUTS)
    assert [line.split()[0] for line in lines[:5]] == ['0x080', '0x083', '0x181', '0x182', '0x183']
    assert lines[0].endswith('  0 bytes        2 frames  SYNC')
    assert lines[1].endswith('EMCY of node 3')
    assert lines[2].endswith('joint_1a')
    assert lines[6].startswith('  0x00000181 ')
    assert lines[6].endswith('29-bit frame')
    assert lines[7:] == [
        '  node   3: no heartbeat, EMCY 0x5000 device hardware, error register 0x01 (2 x)',
        '  error frames: 2 x bus-off', '  remote frames: 1']


def test_a_bus_without_errors_lists_none():
    assert len(scanned(good(2)).lines(LAYOUTS)) == 5


def test_an_identity_is_listed_in_full():
    entries = {canopen.DEVICE_TYPE: 0x00020191, canopen.VENDOR_ID: 0x1F,
               canopen.PRODUCT_CODE: 2, canopen.REVISION: 0x10001, canopen.SERIAL_NUMBER: 77}
    scan = scanned([at(canopen.sdo_answer(7, *key, value)) for key, value in entries.items()])
    assert scan.lines(LAYOUTS) == [
        '  node   7: no heartbeat, device type 0x00020191 (CiA 401), vendor 0x1F, product 0x2, '
        'revision 0x10001, serial 0x4D']
    assert scan.nodes[7].objects == entries


@pytest.mark.parametrize(('identifier', 'data'), [
    (0x700, b'\x05'), (0x702, b'\x05\x00'), (0x702, b''), (0x82, bytes(7)), (0x582, bytes(4)),
    (0x80, bytes(8)), (0x580, bytes(8)), (0x212, bytes(8)), (0x602, bytes(8))])
def test_a_frame_of_another_form_is_no_nodes(identifier, data):
    assert scanned([at(canopen.frame(identifier, data))]).nodes == {}


def test_states_and_boot_ups_are_counted():
    scan = scanned([at(canopen.frame(0x703, bytes((state,)))) for state in (0, 0x7F, 0, 0x85)])
    assert scan.nodes[3].state == canopen.OPERATIONAL
    assert scan.nodes[3].boot_ups == 2
    assert scan.nodes[3].words() == 'operational, booted 2 x'


@pytest.mark.parametrize(('period', 'fits'), [(0.96e-3, True), (1.04e-3, True), (0.94e-3, False),
                                              (1.06e-3, False)])
def test_a_rate_may_differ_by_the_tolerance(period, fits):
    messages = [answer(index, T0 + period * number) for number in range(100)
                for index in range(4)]
    found = problems(scanned(messages, None))
    assert (found == []) == fits
    if not fits:
        assert found[0] == f'joint_1a: 0x181 comes at {1.0 / period:.1f} Hz, configured 1000 Hz'


def test_missing_frames_are_explained_by_their_node():
    def line(*messages):
        (found,) = problems(scanned(without(0x182, good()) + list(messages)))
        return found

    missing = 'joint_1b: 0x182 missing; its node '
    assert line() == missing + '2 was not heard either'
    assert line(at(canopen.frame(0x702, b'\x05'))) \
        == missing + '2 is present: does 0x1800:02 answer SYNC?'
    assert line(at(canopen.sdo_answer(2, *canopen.VENDOR_ID, 1))) \
        == missing + '2 is present: does 0x1800:02 answer SYNC?'
    found = problems(scanned(without(0x182, good()) + [
        at(canopen.frame(0x702, b'\x05')), at(canopen.frame(0x382, bytes(8))),
        at(canopen.frame(0x282, bytes(8))), at(canopen.frame(0x281, bytes(8)))]))
    assert found[0] == missing + 'sends on 0x282, 0x382'
    assert found[1:] == ['unexpected: 0x281 (TPDO2 of node 1)',
                         'unexpected: 0x282 (TPDO2 of node 2)',
                         'unexpected: 0x382 (TPDO3 of node 2)']


def test_without_canopen_a_missing_frame_is_missing_and_nodes_are_not_expected():
    messages = without(0x182, without(0x80, good())) + [at(canopen.frame(0x705, b'\x05'))]
    scan = scanned(messages, None)
    assert problems(scan, nodes=None) == ['joint_1b: 0x182 missing']


def test_an_emergency_is_a_problem_of_its_joint_only():
    scan = scanned([*good(), at(canopen.emcy(2, 0x5000, 1)), at(canopen.emcy(9, 0x5000, 1)),
                    at(canopen.frame(0, b'\x01\x00'))])
    words = 'EMCY 0x5000 device hardware, error register 0x01'
    assert problems(scan) == [
        f'joint_1b: {words}', f'unexpected: node 9 (no heartbeat, {words} (1 x))']
