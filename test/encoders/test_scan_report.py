# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a scan shows: what is there, missing or unexpected, and the lines for rig.yaml."""

from dataclasses import replace

import can
from encoder_frames import answer, cycle, LAYOUTS, T0
import numpy as np
import pytest
from spm_haptic_master.encoders import canopen, scan_report
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.scan_report import Expected, problems
from spm_haptic_master.parameters.resolver import read_parameters

NODES = (1, 2, 3, 4)
DEFAULT = Expected(LAYOUTS, NODES, 1000.0)


def at(message, when=T0):
    message.timestamp = when
    return message


def scanned(messages, sync_id=0x80):
    scan = BusScan(sync_id)
    for message in messages:
        scan.feed(message)
    return scan


def good():
    return [message for number in range(50) for message in cycle(number)]


def without(identifier, messages):
    return [message for message in messages if message.arbitration_id != identifier]


def bus_of(nodes, base=0x180, length=4, rate=200.0, master=True, kinds=None, every=1):
    """Scan half a second of SYNC, of a master or sent here; nodes answer each, or the n-th."""
    scan = BusScan()
    for node, kind in (kinds or {}).items():
        scan.feed(canopen.sdo_answer(node, *canopen.DEVICE_TYPE, kind))
    for number in range(int(0.5 * rate)):
        if not master:
            scan.sent_sync(number / rate)
        for frame in [*[canopen.frame(0x80)][:master], *(
                canopen.frame(base + node, bytes(length)) for node in nodes
                if number % every == 0)]:
            scan.feed(at(frame, T0 + number / rate))
    return scan


HEARTBEAT = at(canopen.frame(0x702, b'\x05'))
MISSING = 'joint_1b: 0x182 missing; '
WORDS = 'EMCY 0x5000 device hardware, error register 0x01'


@pytest.mark.parametrize(('change', 'expected'), [
    (lambda m: [*m, *(at(canopen.frame(0x700 + n, b'\x05')) for n in NODES),
                at(canopen.frame(0, b'\x01\x00'))], []),
    (lambda m: without(0x80, m), ['no SYNC 0x80: let the driver make it (can.sync: produce), or '
                                  'start its master']),
    (lambda m: without(0x182, m), [MISSING + 'its node 2 was not heard either']),
    (lambda m: [*without(0x182, m), at(canopen.frame(0x702, b'\x7f'))],
     [MISSING + 'its node 2 is pre-operational']),
    (lambda m: [*without(0x182, m), HEARTBEAT],
     [MISSING + 'its node 2 is present: does 0x1800:02 answer SYNC?']),
    (lambda m: [*without(0x182, m), HEARTBEAT, *(
        at(canopen.frame(identifier, bytes(8))) for identifier in (0x382, 0x282, 0x281))],
     [MISSING + 'its node sends on 0x282, 0x382', *(
         f'unexpected: 0x{identifier:X} (TPDO{number} of node {identifier & 7})'
         for number, identifier in ((2, 0x281), (2, 0x282), (3, 0x382)))]),
    (lambda m: [*without(0x182, m), answer(1, T0, is_extended_id=True)],
     [MISSING + 'it comes with 29 bits instead', 'unexpected: 0x182 (29-bit frame)']),
    (lambda m: [*m[:-3], answer(1, T0 + 0.049, data=bytes(8)), *m[-2:]],
     ['joint_1b: 0x182 has 4, 8 bytes, configured 4']),
    (lambda m: [*m, at(canopen.frame(0x705, b'\x05'))], ['unexpected: node 5 (operational)']),
    (lambda m: [*m, at(canopen.frame(0x123, b'\x05'))], ['unexpected: 0x123 (foreign)']),
    (lambda m: [*m, at(canopen.emcy(2, 0x5000, 1)), at(canopen.emcy(9, 0x5000, 1))],
     [f'joint_1b: {WORDS}', f'unexpected: node 9 (no heartbeat, {WORDS} (1 x))']),
    (lambda m: [*m, can.Message(arbitration_id=0x40, is_error_frame=True, timestamp=T0)],
     ['error frames: 1 x bus-off']),
    # One that does not answer every SYNC.
    (lambda m: [x for n, x in enumerate(m) if x.arbitration_id != 0x182 or n // 5 % 2 == 0],
     ['joint_1b: 0x182 comes 25 times in 49 cycles of SYNC; expected one answer each']),
    (lambda m: [], ['no frames at all: check bit rate, termination, power, and that the interface '
                    'is up', 'no SYNC 0x80: let the driver make it (can.sync: produce), or start '
                    'its master', *(f'{layout.joint}: 0x18{n} missing; its node {n} was not heard '
                                    'either' for n, layout in enumerate(LAYOUTS, 1))]),
])
def test_what_is_wrong_is_named(change, expected):
    assert problems(scanned(change(good())), DEFAULT) == expected


def test_drives_on_the_bus_are_expected():
    expected = Expected(LAYOUTS, NODES, 1000.0, {9: 'drive of joint_1a', 10: 'drive of joint_1b'},
                        {0x189: 'status of the drive'})
    scan = scanned([*good(), at(canopen.frame(0x189)), at(canopen.emcy(9, 0x5000, 1))])
    assert problems(scan, expected) == [
        f'drive of joint_1a: {WORDS}', 'drive of joint_1b: not heard']
    assert scan_report.listing(scan, expected)[6].endswith('status of the drive')


def test_without_canopen_a_missing_frame_is_missing_and_nodes_are_not_expected():
    scan = scanned(without(0x182, without(0x80, good())) + [at(canopen.frame(0x705, b'\x05'))],
                   None)
    assert problems(scan, Expected(LAYOUTS, None, 1000.0)) == ['joint_1b: 0x182 missing']


@pytest.mark.parametrize(('period', 'fits'), [(0.96e-3, True), (1.04e-3, True), (0.94e-3, False),
                                              (1.06e-3, False)])
def test_a_rate_may_differ_by_the_tolerance(period, fits):
    """Without SYNC the encoders' rate counts, with it the master's."""
    alone = [answer(index, T0 + period * number) for number in range(100) for index in range(4)]
    found = problems(scanned(alone, None), DEFAULT)
    assert found == ([] if fits else [
        f'{layout.joint}: 0x{layout.can_id:X} comes at {1.0 / period:.1f} Hz, configured 1000 Hz'
        for layout in LAYOUTS])
    synced = problems(scanned(good()), Expected(LAYOUTS, NODES, 1e6 * period))
    assert synced == ([] if fits else [
        f"SYNC 0x80 comes at 1000.0 Hz, rate is {1e6 * period:g} Hz: give the bus's rate to all "
        'nodes'])


def test_the_rate_of_a_master_is_what_it_is_set_to_on_a_busy_machine():
    """A third of its SYNCs is lost, and the others are late by up to a fifth of a period."""
    rng = np.random.default_rng(2)
    stamps = [T0 + 0.02 * number + rng.uniform(0.0, 4e-3) for number in range(150)
              if rng.random() > 1.0 / 3.0]
    scan = scanned(at(canopen.frame(0x80), stamp) for stamp in stamps)
    assert scan.master_sync.rate < 40.0
    assert scan.master_rate == pytest.approx(50.0, rel=0.05)
    assert scanned([at(canopen.frame(0x80))]).master_rate == scanned([]).master_rate == 0.0


@pytest.mark.parametrize('late', [
    (0.55, 0.1), (0.52,), (1.0,), (1.6, 0.7, 0.2), (2.6, 1.7, 0.8, 0.3), (-0.1, 0.45)])
def test_syncs_that_are_read_late_are_counted_once(late):
    """A pause of a program: periods, that of the first and those in which it catches up."""
    stamps = [T0 + 0.02 * (number + (late[number - 50] if 0 <= number - 50 < len(late) else 0.0))
              for number in range(100)]
    scan = scanned(at(canopen.frame(0x80), stamp) for stamp in stamps)
    assert scan.master_rate == pytest.approx(50.0, rel=1e-6)


@pytest.mark.parametrize(('identifier', 'data'), [
    (0x700, b'\x05'), (0x702, b'\x05\x00'), (0x702, b''), (0x82, bytes(7)), (0x582, bytes(4)),
    (0x80, bytes(8)), (0x580, bytes(8)), (0x212, bytes(8)), (0x602, bytes(8))])
def test_a_frame_of_another_form_is_not_taken_for_a_node(identifier, data):
    assert scanned([at(canopen.frame(identifier, data))]).nodes == {}


def test_a_sync_that_this_machine_sends_too_slowly_is_not_the_encoders_fault():
    scan = bus_of(NODES, rate=1000.0, master=False)
    assert problems(scan, DEFAULT) == [] and scan_report.busy(scan, 1000.0) is None
    scan.started |= {3, 1}
    assert scan_report.listing(scan, DEFAULT)[4:] == [
        '  sent from here: 500 x SYNC 0x80, 1000.0 Hz', '  sent from here: NMT start to node 1, 3']
    for every in (1, 2):
        scan = bus_of(NODES, rate=612.0, master=False, every=every)
        assert problems(scan, DEFAULT) == []
        assert scan_report.busy(scan, 1000.0).startswith(
            'this machine is too busy: SYNC was sent at 612.0 Hz instead of 1000 Hz; ')
    # At its rate it is theirs.
    assert len(problems(bus_of(NODES, rate=1000.0, master=False, every=2), DEFAULT)) == 4


def test_a_scan_lists_identifiers_nodes_and_errors():
    remote = can.Message(arbitration_id=0x181, is_remote_frame=True, is_extended_id=False,
                         timestamp=T0)
    identity = {canopen.DEVICE_TYPE: 0x00020191, canopen.VENDOR_ID: 0x1F,
                canopen.PRODUCT_CODE: 2, canopen.REVISION: 0x10001, canopen.SERIAL_NUMBER: 77}
    scan = scanned([
        answer(0, T0, is_extended_id=True), at(canopen.emcy(3, 0x5000, 1)),
        at(canopen.emcy(3, 0x5000, 1)), remote,
        *(at(canopen.frame(0x183, bytes(length)), T0 + when)
          for length, when in ((8, 0.0), (2, 0.25), (8, 0.5))),
        at(canopen.frame(0x99)), at(canopen.sdo_upload(9, 0x1000, 0)),
        *(at(canopen.sdo_answer(7, *key, value)) for key, value in identity.items()),
        at(canopen.sdo(0x582, canopen.SDO_ABORT, *canopen.SERIAL_NUMBER, 0x06020000)),
        at(canopen.sdo_answer(2, *canopen.DEVICE_TYPE, 0x00010196)),
        *(at(canopen.frame(0x702, bytes((state,)))) for state in (0, 0x7F, 0, 0x85))], 0x99)
    assert scan_report.listing(scan, DEFAULT) == [
        '  0x083       0.0 Hz    8 bytes        2 frames  EMCY of node 3',
        '  0x099       0.0 Hz    0 bytes        1 frames  SYNC',
        '  0x183       4.0 Hz  2/8 bytes        3 frames  joint_1c',
        '  0x702       0.0 Hz    1 bytes        4 frames  heartbeat of node 2',
        '  0x00000181       0.0 Hz    4 bytes        1 frames  29-bit frame',
        '  node   2: operational, booted 2 x, device type 0x00010196 (CiA 406, encoder)',
        f'  node   3: no heartbeat, {WORDS} (2 x)',
        '  node   7: no heartbeat, device type 0x00020191 (CiA 401), vendor 0x1F, product 0x2, '
        'revision 0x10001, serial 0x4D',
        '  remote frames: 1']


KNOWN = Expected(tuple(replace(layout, can_id=0x180 + node) for layout, node
                       in zip(LAYOUTS, (4, 3, 2, 1), strict=True)), (4, 3, 2, 1), 1000.0)


@pytest.mark.parametrize(('scan', 'options', 'expected'), [
    # Odd nodes and the rate of the bus; a channel that looks like a number stays a text.
    (bus_of((44, 3, 90, 17)), {'channel': '0'}, {
        'source': 'can', 'rate': 200.0, 'can.interface': 'socketcan', 'can.channel': '0',
        'can.sync': 'consume', 'encoders.node_id': [3, 17, 44, 90],
        'encoders.id': [0x183, 0x191, 0x1AC, 0x1DA]}),
    # Without a master the driver makes SYNC, at the configured rate.
    (bus_of((5, 6, 7, 8), rate=250.0, master=False), {}, {'can.sync': 'produce', 'rate': 1000.0}),
    # Another TPDO, length and number of sensors.
    (bus_of((1, 2, 3, 5, 6), base=0x280, length=8), {'bitrate': 500000}, {
        'sensors': 5, 'encoders.id': [0x281, 0x282, 0x283, 0x285, 0x286],
        'encoders.data_length': [8] * 5, 'can.bitrate': 500000}),
    # Joints that are as configured keep their place; defaults are no knowledge of the rig.
    (bus_of((1, 2, 4, 9)), {'expected': KNOWN, 'known': True}, {
        'encoders.node_id': [4, 9, 2, 1]}),
    (bus_of((1, 2, 4, 9)), {'expected': KNOWN}, {'encoders.node_id': [1, 2, 4, 9]}),
    # A drive is no encoder; a silent encoder has its predefined identifier.
    (bus_of((1, 2, 3, 7), kinds={7: 0x00020192, 8: 0x00010196}), {}, {
        'encoders.id': [0x181, 0x182, 0x183, 0x188]})])
def test_the_lines_for_a_rig_are_what_the_bus_has(tmp_path, scan, options, expected):
    given = {'expected': DEFAULT, 'known': False, 'interface': 'socketcan', 'channel': 'can0',
             'bitrate': None, **options}
    path = tmp_path / 'rig.yaml'
    path.write_text('\n'.join(scan_report.rig_lines(scan, **given)) + '\n')
    found = read_parameters(path)
    assert found | expected == found


@pytest.mark.parametrize(('nodes', 'started', 'words'), [
    ((), False, '# none: 0 encoders heard, expected 4 to 6; can_scan --start starts'),
    ((1, 2, 3), True, '# none: 3 encoders heard, expected 4 to 6'),
    (range(1, 8), True, '# none: 7 encoders heard, expected 4 to 6')])
def test_too_few_or_too_many_encoders_give_no_lines(nodes, started, words):
    scan = bus_of(nodes)
    scan.started |= {1} if started else set()
    (line,) = scan_report.rig_lines(scan, DEFAULT, False, 'socketcan', 'can0', None)
    assert line.startswith(words)
    assert ('--start' in line) != started


@pytest.mark.parametrize(('measured', 'expected'), [
    (1003.2, 1000.0), (333.1, 333.3), (25.02, 25.0), (888.9, 888.9)])
def test_a_measured_rate_is_that_of_a_round_period(measured, expected):
    assert scan_report.round_rate(measured) == expected
