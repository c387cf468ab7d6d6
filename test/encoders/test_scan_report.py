# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a scan shows: what is there, missing or unexpected, and the lines for rig.yaml."""

from dataclasses import replace

import can
from encoder_frames import answer, cycle, LAYOUTS, T0
import pytest
from spm_haptic_master.encoders import canopen, rig_lines, scan_report
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.scan_report import Expected, problems
from spm_haptic_master.parameters.resolver import read_parameters

NODES = (1, 2, 3, 4)
DEFAULT = Expected(LAYOUTS, NODES, 1000.0)
ANY_IDENTIFIER = replace(DEFAULT, layouts=(replace(LAYOUTS[0], can_id=0x2F0), *LAYOUTS[1:]))


def heard(identifier, data=b'', when=0.0):
    return canopen.frame(identifier, data, T0 + when)


def scanned(messages, sync_id=0x80, started=(), unsent=()):
    scan = BusScan(sync_id)
    for message in messages:
        message.timestamp = message.timestamp or T0
        scan.feed(message)
    scan.started.update(started)
    scan.unsent.update(unsent)
    return scan


def good(*more, without=()):
    """Scan fifty cycles, and more frames."""
    return scanned(
        [
            *(
                message
                for number in range(50)
                for message in cycle(number)
                if message.arbitration_id not in without
            ),
            *more,
        ]
    )


def bus_of(nodes, base=0x180, length=4, rate=200.0, master=True, kinds=None, every=1):
    """Scan half a second of SYNC, of a master or sent here; nodes answer each, or the n-th."""
    scan = scanned(
        canopen.sdo_answer(node, *canopen.DEVICE_TYPE, kind)
        for node, kind in (kinds or {}).items()
    )
    for number in range(int(0.5 * rate)):
        if master:
            scan.feed(heard(0x80, when=number / rate))
        else:
            scan.sent_sync(number / rate)
        for node in nodes if number % every == 0 else ():
            scan.feed(heard(base + node, bytes(length), number / rate))
    return scan


def everything():
    """Return frames of all kinds."""
    identity = {
        canopen.DEVICE_TYPE: 0x00020191,
        canopen.VENDOR_ID: 0x1F,
        canopen.PRODUCT_CODE: 2,
        canopen.REVISION: 0x10001,
        canopen.SERIAL_NUMBER: 77,
    }
    return [
        answer(0, T0, is_extended_id=True),
        canopen.emcy(3, 0x5000, 1),
        canopen.emcy(3, 0x5000, 1),
        can.Message(
            arbitration_id=0x181,
            is_remote_frame=True,
            is_extended_id=False,
        ),
        *(heard(0x183, bytes(length), when) for length, when in ((8, 0.0), (2, 0.25), (8, 0.5))),
        heard(0x99),
        canopen.sdo_upload(9, 0x1000, 0),
        *(canopen.sdo_answer(7, *key, value) for key, value in identity.items()),
        canopen.sdo(0x582, canopen.SDO_ABORT, *canopen.SERIAL_NUMBER, 0x06020000),
        canopen.sdo_answer(2, *canopen.DEVICE_TYPE, 0x00010196),
        *(heard(0x702, bytes((state,))) for state in (0, 0x7F, 0, 0x85)),
        # Of another form than a node sends.
        *(
            heard(identifier, data)
            for identifier, data in (
                (0x700, b'\x05'),
                (0x703, b'\x05\x00'),
                (0x704, b''),
                (0x82, bytes(7)),
                (0x584, bytes(4)),
                (0x580, bytes(8)),
                (0x212, bytes(8)),
                (0x602, bytes(8)),
            )
        ),
    ]


# Scans by name, and what those are compared with that are not as by default.
SCANS = {
    'as_configured': good(
        *(heard(0x700 + node, b'\x05') for node in NODES), heard(0, b'\x01\x00')
    ),
    'no_frames': scanned([]),
    'no_sync': good(without=(0x80,)),
    'no_node': good(without=(0x182,)),
    'pre_operational': good(heard(0x702, b'\x7f'), without=(0x182,)),
    'no_answers': good(heard(0x702, b'\x05'), without=(0x182,)),
    'other_tpdos': good(
        heard(0x702, b'\x05'),
        *(heard(identifier, bytes(8)) for identifier in (0x382, 0x282, 0x281)),
        without=(0x182,),
    ),
    'other_width': good(answer(1, T0, is_extended_id=True), without=(0x182,)),
    'other_length': good(heard(0x182, bytes(8), 0.049)),
    'more_nodes': good(
        heard(0x705, b'\x05'),
        heard(0x123, b'\x05'),
        canopen.emcy(2, 0x5000, 1),
        canopen.emcy(9, 0x5000, 1),
    ),
    'error_frame': good(can.Message(arbitration_id=0x40, is_error_frame=True)),
    'drives': good(heard(0x189), canopen.emcy(9, 0x5000, 1)),
    'without_canopen': scanned([*cycle(0)[2:], heard(0x705, b'\x05')], None),
    'every_kind': scanned(everything(), 0x99),
    # Odd nodes and rate; another TPDO, length and number of sensors; a drive, a silent encoder.
    'odd_nodes': bus_of((44, 3, 90, 17), rate=333.1),
    'five_sensors': bus_of((1, 2, 3, 5, 6), 0x280, 8, 888.9),
    'silent_encoder': bus_of((1, 2, 3, 7), kinds={7: 0x00020192, 8: 0x00010196}),
    # Joints that are as configured keep their place.
    'calibrated': bus_of((1, 2, 4, 9)),
    'any_identifier': scanned(
        message
        for number in range(50)
        for message in cycle(number, layouts=ANY_IDENTIFIER.layouts)
    ),
    'few': scanned([heard(0x181, bytes(4))], started=(3, 1), unsent={'Buffer full': 2}),
    'many': bus_of(range(1, 8)),
    'two_bytes': bus_of(NODES, length=2),
    'half_the_rate': bus_of(NODES, rate=1000.0, every=2),
    # The encoders are compared with the SYNC sent here, and only where that is in time.
    'own_sync': bus_of(NODES, rate=1000.0, master=False),
    'own_sync_half': bus_of(NODES, rate=1000.0, master=False, every=2),
    'busy': bus_of(NODES, rate=612.0, master=False, every=2),
    # Rates within and beyond the tolerance: the encoders' without SYNC, with it the master's.
    **{
        f'alone_{period}_us': scanned(
            (
                answer(index, T0 + 1e-6 * period * number)
                for number in range(100)
                for index in range(4)
            ),
            None,
        )
        for period in (940, 960, 1040, 1060)
    },
    **dict.fromkeys(('rate_940_hz', 'rate_960_hz', 'rate_1040_hz', 'rate_1060_hz'), good()),
}
EXPECTED = {
    'drives': Expected(
        LAYOUTS,
        NODES,
        1000.0,
        others={9: 'drive of joint_1a', 10: 'drive of joint_1b'},
        frames={0x189: 'status of the drive'},
    ),
    'without_canopen': replace(DEFAULT, node_ids=None),
    'any_identifier': ANY_IDENTIFIER,
    'calibrated': Expected(
        tuple(
            replace(layout, can_id=0x180 + node)
            for layout, node in zip(LAYOUTS, (4, 3, 2, 1), strict=True)
        ),
        (4, 3, 2, 1),
        1000.0,
    ),
    **{name: replace(DEFAULT, rate=float(name[5:-3])) for name in SCANS if name[:4] == 'rate'},
}


def of_all(words):
    """Return words on each encoder's frame, with its joint and identifier."""
    return [f'{layout.joint}: 0x{layout.can_id:X} {words}' for layout in LAYOUTS]


def of_missing(*joints, why='its node {} was not heard either'):
    """Return that the frames of joints are missing, and why."""
    return [
        f'{LAYOUTS[joint].joint}: 0x{LAYOUTS[joint].can_id:X} missing; {why.format(joint + 1)}'
        for joint in joints
    ]


def of_sync(rate, expected=1000):
    """Return that SYNC comes at another rate, Hz."""
    return (
        f'SYNC 0x80 comes at {rate:.1f} Hz, rate is {expected} Hz: '
        "give the bus's rate to all nodes"
    )


NO_SYNC = 'no SYNC 0x80: let the driver make it (can.sync: produce), or start its master'
DEVICE = 'EMCY 0x5000 device hardware, error register 0x01'
PROBLEMS = {
    'as_configured': [],
    'no_frames': [
        'no frames at all: check bit rate, termination, power, and that the interface is up',
        NO_SYNC,
        *of_missing(0, 1, 2, 3),
    ],
    'no_sync': [NO_SYNC],
    'no_node': of_missing(1),
    'pre_operational': of_missing(1, why='its node {} is pre-operational'),
    'no_answers': of_missing(
        1, why='its node {} is present: does it answer SYNC (0x1800:02, 0x1005)? can_setup'
    ),
    'other_tpdos': [
        *of_missing(1, why='its node sends on 0x282, 0x382'),
        'unexpected: 0x281 (TPDO2 of node 1)',
        'unexpected: 0x282 (TPDO2 of node 2)',
        'unexpected: 0x382 (TPDO3 of node 2)',
    ],
    'other_width': [
        *of_missing(1, why='it comes with 29 bits instead'),
        'unexpected: 0x182 (29-bit frame)',
    ],
    'other_length': ['joint_1b: 0x182 has 4, 8 bytes, configured 4'],
    'more_nodes': [
        f'joint_1b: {DEVICE}',
        'unexpected: 0x123 (foreign)',
        'unexpected: node 5 (operational)',
        f'unexpected: node 9 (no heartbeat, {DEVICE} (1 x))',
    ],
    'error_frame': ['error frames: 1 x bus-off'],
    'drives': [f'drive of joint_1a: {DEVICE}', 'drive of joint_1b: not heard'],
    'without_canopen': [
        'joint_1a: 0x181 missing',
        *of_all('comes at 0.0 Hz, configured 1000 Hz')[1:],
    ],
    'every_kind': [
        "SYNC 0x99 comes at 0.0 Hz, rate is 1000 Hz: give the bus's rate to all nodes",
        *of_missing(0, why='it comes with 29 bits instead'),
        *of_missing(
            1, why='its node {} is present: does it answer SYNC (0x1800:02, 0x1005)? can_setup'
        ),
        'joint_1c: 0x183 has 2, 8 bytes, configured 4',
        'joint_1c: 0x183 comes 3 times in 1 cycle of SYNC; expected one answer to each',
        f'joint_1c: {DEVICE}',
        *of_missing(3),
        'unexpected: 0x212 (foreign)',
        'unexpected: 0x700 (foreign)',
        'unexpected: 0x704 (heartbeat of node 4)',
        'unexpected: 0x181 (29-bit frame)',
        'unexpected: node 7 (no heartbeat, device type 0x00020191 (CiA 401), vendor 0x1F, '
        'product 0x2, revision 0x10001, serial 0x4D)',
    ],
    'odd_nodes': [
        of_sync(333.1),
        *of_missing(0, 1, 3),
        'unexpected: 0x191 (TPDO1 of node 17)',
        'unexpected: 0x1AC (TPDO1 of node 44)',
        'unexpected: 0x1DA (TPDO1 of node 90)',
    ],
    'five_sensors': [
        of_sync(888.9),
        *of_missing(0, 1, 2, 3),
        *[f'unexpected: 0x{0x280 + node:X} (TPDO2 of node {node})' for node in (1, 2, 3, 5, 6)],
    ],
    'silent_encoder': [
        of_sync(200.0),
        *of_missing(3),
        'unexpected: 0x187 (TPDO1 of node 7)',
        'unexpected: node 7 (no heartbeat, device type 0x00020192 (CiA 402, drive))',
        'unexpected: node 8 (no heartbeat, device type 0x00010196 (CiA 406, encoder))',
    ],
    'calibrated': [
        of_sync(200.0),
        'joint_1b: 0x183 missing; its node 3 was not heard either',
        'unexpected: 0x189 (TPDO1 of node 9)',
    ],
    'any_identifier': [],
    'few': [
        NO_SYNC,
        'joint_1a: 0x181 comes at 0.0 Hz, configured 1000 Hz',
        *of_missing(1, 2, 3),
        '2 frames not sent: Buffer full (does any other node acknowledge?)',
    ],
    'many': [
        of_sync(200.0),
        *[f'unexpected: 0x{0x180 + node:X} (TPDO1 of node {node})' for node in (5, 6, 7)],
    ],
    'two_bytes': [
        of_sync(200.0),
        *of_all('has 2 bytes, configured 4'),
    ],
    'half_the_rate': of_all('answers 250 of 500 SYNC'),
    'own_sync': [],
    'own_sync_half': of_all('answers 250 of 500 SYNC'),
    'busy': [],
    'alone_940_us': of_all('comes at 1063.8 Hz, configured 1000 Hz'),
    'alone_960_us': [],
    'alone_1040_us': [],
    'alone_1060_us': of_all('comes at 943.4 Hz, configured 1000 Hz'),
    'rate_940_hz': [of_sync(1000.0, 940)],
    'rate_960_hz': [],
    'rate_1040_hz': [],
    'rate_1060_hz': [of_sync(1000.0, 1060)],
}


@pytest.mark.parametrize('name', SCANS)
def test_what_is_missing_wrong_or_unexpected_is_named(name):
    expected = EXPECTED.get(name, DEFAULT)
    assert problems(SCANS[name], expected) == PROBLEMS[name]


@pytest.mark.parametrize('name', SCANS)
def test_a_machine_that_sends_sync_below_its_rate_gets_a_lower_one(name):
    words = scan_report.busy(SCANS[name], EXPECTED.get(name, DEFAULT).rate)
    assert words == (
        "this machine is too busy: SYNC was sent at 612.0 Hz instead of 1000 Hz; the encoders' "
        'rates are not compared. Give a lower rate: -p rate:=500.0'
        if name == 'busy'
        else None
    )


@pytest.mark.parametrize(
    ('name', 'lines'),
    [
        (
            'every_kind',
            [
                '  0x082       0.0 Hz    7 bytes        1 frames  EMCY of node 2',
                '  0x083       0.0 Hz    8 bytes        2 frames  EMCY of node 3',
                '  0x099       0.0 Hz    0 bytes        1 frames  SYNC',
                '  0x183       4.0 Hz  2/8 bytes        3 frames  joint_1c',
                '  0x212       0.0 Hz    8 bytes        1 frames  foreign',
                '  0x700       0.0 Hz    1 bytes        1 frames  foreign',
                '  0x702       0.0 Hz    1 bytes        4 frames  heartbeat of node 2',
                '  0x703       0.0 Hz    2 bytes        1 frames  heartbeat of node 3',
                '  0x704       0.0 Hz    0 bytes        1 frames  heartbeat of node 4',
                '  0x00000181       0.0 Hz    4 bytes        1 frames  29-bit frame',
                '  node   2: operational, booted 2 x, device type 0x00010196 (CiA 406, encoder)',
                '  node   3: no heartbeat, EMCY 0x5000 device hardware, error register 0x01 (2 x)',
                '  node   7: no heartbeat, device type 0x00020191 (CiA 401), vendor 0x1F, '
                'product 0x2, revision 0x10001, serial 0x4D',
                '  remote frames: 1',
            ],
        ),
        (
            'own_sync',
            [
                *(
                    f'  0x{layout.can_id:X}    1000.0 Hz    4 bytes      500 frames  '
                    f'{layout.joint}'
                    for layout in LAYOUTS
                ),
                '  sent from here: 500 x SYNC 0x80, 1000.0 Hz',
            ],
        ),
        (
            'few',
            [
                '  0x181       0.0 Hz    4 bytes        1 frames  joint_1a',
                '  sent from here: NMT start to node 1, 3',
            ],
        ),
    ],
)
def test_the_listing_has_every_frame_and_node(name, lines):
    assert scan_report.listing(SCANS[name], EXPECTED.get(name, DEFAULT)) == lines


def test_the_listing_names_the_frames_of_the_drives():
    listing = scan_report.listing(SCANS['drives'], EXPECTED['drives'])
    assert any(line.endswith('status of the drive') for line in listing)


# Lines for rig.yaml of scans: what differs from those of encoders that are as by default.
RIGS = {
    'no_sync': {'can.sync': 'produce'},
    'own_sync': {'can.sync': 'produce'},
    'alone_1060_us': {'can.sync': 'produce'},
    'busy': {'can.sync': 'produce'},
    'as_configured': {},
    'other_length': {},
    'more_nodes': {},
    'drives': {},
    'half_the_rate': {},
    'any_identifier': {'encoders.id': [0x2F0, 0x182, 0x183, 0x184]},
    'rate_940_hz': {},
    'odd_nodes': {
        'rate': 333.3,
        'encoders.node_id': [3, 17, 44, 90],
        'encoders.id': [0x183, 0x191, 0x1AC, 0x1DA],
    },
    'five_sensors': {
        'sensors': 5,
        'rate': 888.9,
        'encoders.node_id': [1, 2, 3, 5, 6],
        'encoders.id': [0x281, 0x282, 0x283, 0x285, 0x286],
        'encoders.data_length': [8] * 5,
    },
    # A frame that is too short for a word of four bytes is one word.
    'two_bytes': {
        'rate': 200.0,
        'encoders.data_length': [2] * 4,
        'encoders.bit_length': [16] * 4,
    },
    'other_tpdos': {
        'encoders.id': [0x181, 0x282, 0x183, 0x184],
        'encoders.data_length': [4, 8, 4, 4],
    },
    # A drive is no encoder; an encoder without frames has those of its node id.
    'silent_encoder': {
        'rate': 200.0,
        'encoders.node_id': [1, 2, 3, 8],
        'encoders.id': [0x181, 0x182, 0x183, 0x188],
    },
    'calibrated': {
        'rate': 200.0,
        'encoders.node_id': [1, 2, 4, 9],
        'encoders.id': [0x181, 0x182, 0x184, 0x189],
    },
}
AS_BY_DEFAULT = {
    'source': 'can',
    'rate': 1000.0,
    'can.interface': 'socketcan',
    'can.channel': '0',
    'can.bitrate': 500000,
    'can.sync': 'consume',
    'encoders.node_id': [1, 2, 3, 4],
    'encoders.id': [0x181, 0x182, 0x183, 0x184],
}
# Defaults are no knowledge of the rig; a channel that looks like a number stays a text.
ON_BUS = rig_lines.GivenBus('socketcan', '0', 500000, chosen=False)


@pytest.mark.parametrize('name', RIGS)
def test_the_lines_for_a_rig_are_of_what_was_heard(tmp_path, name):
    path = tmp_path / 'rig.yaml'
    lines = rig_lines.rig_lines(SCANS[name], EXPECTED.get(name, DEFAULT), ON_BUS)
    path.write_text('\n'.join(lines))
    assert read_parameters(path) == AS_BY_DEFAULT | RIGS[name]


def test_joints_that_are_as_configured_keep_their_place(tmp_path):
    chosen = replace(
        ON_BUS,
        channel='can0',
        bitrate=None,
        chosen=True,
    )
    lines = rig_lines.rig_lines(SCANS['calibrated'], EXPECTED['calibrated'], chosen)
    assert lines == [
        '/**:',
        '  ros__parameters:',
        '    source: can',
        '    rate: 200.0',
        '    can: {interface: "socketcan", channel: "can0", sync: consume}',
        '    encoders:',
        '      # joint_1a, joint_1b, joint_1c, joint_3a',
        '      node_id: [4, 9, 2, 1]',
        '      id: [0x184, 0x189, 0x182, 0x181]',
    ]


START = '; can_scan --start starts the nodes, and SYNC where no master makes it'


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('no_frames', f'0 encoders were heard, expected 4 to 6{START}'),
        ('no_node', f'3 encoders were heard, expected 4 to 6{START}'),
        ('other_width', f'3 encoders were heard, expected 4 to 6{START}'),
        ('every_kind', f'2 encoders were heard, expected 4 to 6{START}'),
        ('many', f'7 encoders were heard, expected 4 to 6{START}'),
        ('few', 'one encoder was heard, expected 4 to 6'),
    ],
)
def test_too_few_or_many_encoders_have_no_lines(name, words):
    assert rig_lines.rig_lines(SCANS[name], DEFAULT, ON_BUS) == [f'# none: {words}']


def of_each(cycles, answered):
    """Scan cycles of SYNC, `answered` of which each encoder answers; 10 ms apart."""
    scan = BusScan(0x80)
    for number in range(cycles):
        scan.feed(heard(0x80, when=0.01 * number))
        for layout in LAYOUTS if number < answered else ():
            scan.feed(heard(layout.can_id, bytes(4), 0.01 * number + 0.001))
    for number in range(answered - cycles):
        for layout in LAYOUTS:
            scan.feed(heard(layout.can_id, bytes(4), 0.01 * cycles - 0.005 + 0.001 * number))
    return scan


HUNDRED = replace(DEFAULT, rate=100.0)


@pytest.mark.parametrize(
    ('cycles', 'answered', 'words'),
    [
        # One answer may be under way, or come from before the scan.
        (100, 99, None),
        (100, 101, None),
        (100, 102, 'comes 102 times in 100 cycles of SYNC; expected one answer to each'),
        (100, 98, 'answers 98 of 100 SYNC'),
        # And half a per cent of them may be lost.
        (600, 597, None),
        (600, 596, 'answers 596 of 600 SYNC'),
        # An encoder that ended before the last tenth of the scan.
        (100, 92, 'answers 92 of 100 SYNC'),
        (100, 85, 'answers 85 of 100 SYNC, the last one 0.15 s before the end'),
        (100, 2, 'answers 2 of 100 SYNC, the last one 0.98 s before the end'),
        (100, 1, 'answers 1 of 100 SYNC'),
    ],
)
def test_answers_to_sync_are_counted(cycles, answered, words):
    expected = of_all(words) if words else []
    assert problems(of_each(cycles, answered), HUNDRED) == expected


def test_the_answers_of_an_encoder_are_counted_from_its_first_one():
    scan = of_each(100, 0)
    for number in range(100, 150):
        scan.feed(heard(0x80, when=0.01 * number))
        for layout in LAYOUTS:
            scan.feed(heard(layout.can_id, bytes(4), 0.01 * number + 0.001))
    assert problems(scan, HUNDRED) == []


@pytest.mark.parametrize(
    ('beats', 'end', 'timeout', 'words'),
    [
        # Three periods after the latest one a node has ended.
        ((0.1, 0.2), 0.49, None, None),
        (
            (0.1, 0.2),
            0.51,
            None,
            'its last heartbeat came 0.31 s before the end, after one each 0.10 s',
        ),
        # The period is that of the latest two.
        ((0.0, 0.5, 0.6), 0.89, None, None),
        ((0.2,), 9.0, None, None),
        ((), 9.0, 0.1, None),
        # The driver waits for as long as it is configured.
        ((0.1, 0.25), 0.3, 0.16, None),
        (
            (0.1, 0.25),
            0.3,
            0.14,
            'its heartbeats come 0.15 s apart, can.heartbeat_timeout is 0.14 s: '
            'set 0x1017 (can_setup)',
        ),
    ],
)
def test_heartbeats_that_end_or_come_too_seldom_are_named(beats, end, timeout, words):
    scan = BusScan(0x80)
    for at in beats:
        scan.feed(heard(0x702, b'\x05', at))
    scan.feed(heard(0x182, bytes(4), end))
    expected = replace(DEFAULT, heartbeat_timeout=timeout)
    found = [line for line in problems(scan, expected) if 'heartbeat' in line]
    assert found == ([f'joint_1b: {words}'] if words else [])


@pytest.mark.parametrize(
    ('objects', 'words'),
    [
        ({canopen.ERROR_REGISTER: 0, canopen.UNITS_PER_TURN: 65536}, []),
        ({canopen.ERROR_REGISTER: 0x11}, ['error register 0x11 (generic, communication)']),
        (
            {canopen.UNITS_PER_TURN: 16384},
            ['it has 16384 counts per turn, encoders.counts_per_turn is 65536'],
        ),
    ],
)
def test_the_objects_of_an_encoder_are_compared(objects, words):
    scan = good(*(canopen.sdo_answer(2, *key, value) for key, value in objects.items()))
    layouts = tuple(replace(layout, counts_per_turn=65536) for layout in LAYOUTS)
    found = problems(scan, replace(DEFAULT, layouts=layouts))
    assert found == [f'joint_1b: {each}' for each in words]


@pytest.mark.parametrize(
    ('rate', 'expected', 'lower'),
    [
        (951.0, 1000.0, None),
        (949.0, 1000.0, '. Give a lower rate: -p rate:=500.0'),
        (500.0, 1000.0, '. Give a lower rate: -p rate:=250.0'),
        (125.0, 1000.0, '. Give a lower rate: -p rate:=100.0'),
        (15.0, 20.0, '. Give a lower rate: -p rate:=10.0'),
        (9.0, 20.0, ''),
    ],
)
def test_a_machine_that_is_too_busy_gets_the_next_lower_rate(rate, expected, lower):
    scan = BusScan(0x80)
    scan.sent_sync(T0)
    assert scan_report.busy(scan, expected) is None
    scan.sent_sync(T0 + 1.0 / rate)
    words = scan_report.busy(scan, expected)
    if lower is None:
        assert words is None
    else:
        assert words.endswith(f"the encoders' rates are not compared{lower}")


def without_sync(*phases):
    """Scan encoders that send by themselves at phases (us) of a period of 1 ms."""
    scan = BusScan(None)
    for number in range(100):
        for layout, phase in zip(LAYOUTS, phases, strict=False):
            at = 1e-3 * number + 1e-6 * phase
            scan.feed(heard(layout.can_id, bytes(4), at))
    return scan


@pytest.mark.parametrize(
    ('phases', 'after_the_first', 'complete'),
    [
        ((0, 100, 200, 300), (0, 100, 200, 300), True),
        # In another order, and over the end of a period: the third is the first.
        ((700, 100, 600, 900), (100, 500, 0, 300), True),
        ((0, 0, 0, 490), (0, 0, 0, 490), True),
        ((0, 250, 510, 0), (0, 250, 510, 0), False),
    ],
)
def test_phases_of_encoders_without_sync_are_from_the_first_one(phases, after_the_first, complete):
    scan = without_sync(*phases)
    found = scan_report.phases(scan, DEFAULT)
    assert tuple(found.values()) == pytest.approx(after_the_first, abs=1)
    remark = scan_report.remark_on_phases(scan, DEFAULT)
    assert (remark is not None) is complete
    wrong = [line for line in problems(scan, DEFAULT) if 'no set is complete' in line]
    assert len(wrong) == (0 if complete else 1)


def test_phases_are_reported_in_ms_where_there_is_no_sync():
    scan = without_sync(0, 100, 200, 300)
    assert scan_report.remark_on_phases(scan, DEFAULT).startswith(
        'without SYNC the frames come at phases of joint_1a 0.0, joint_1b 0.1, joint_1c 0.2, '
        'joint_3a 0.3 ms in 1 ms at present. Encoders without SYNC have phases that change'
    )
    assert scan_report.remark_on_phases(BusScan(None), DEFAULT) is None
    assert scan_report.remark_on_phases(good(), DEFAULT) is None


SHARED = (
    'devices have node id {}: give each its own, one at a time on the bus (switches, LSS or '
    'a tool of the maker)'
)


def test_devices_with_one_node_id_are_named_instead_of_their_frames():
    scan = good(without=(0x182,))
    for serial in (7, 8):
        scan.asked(2, canopen.SERIAL_NUMBER)
        scan.feed(canopen.sdo_answer(2, *canopen.SERIAL_NUMBER, serial))
    assert problems(scan, DEFAULT) == [f'two {SHARED.format(2)}']


@pytest.mark.parametrize(
    ('nodes', 'started', 'words'),
    [
        (
            (2, 1),
            (),
            'no frames, but answers to SDO of node 1, 2: they do not send yet. Start them '
            '(can_scan --start), and set them up (can_setup --write)',
        ),
        (
            (2,),
            (2,),
            'no frames, but answers to SDO of node 2: started, they send nothing. Set them up '
            '(can_setup --write)',
        ),
        ((2, 2), (), f'two {SHARED.format(2)}'),
    ],
)
def test_nodes_that_only_answer_requests_are_not_started_or_set_up(nodes, started, words):
    answers = [canopen.sdo_answer(node, *canopen.DEVICE_TYPE, 0x00010196) for node in nodes]
    scan = scanned(answers, started=started)
    assert problems(scan, DEFAULT)[0] == words
    assert not any('no frames at all' in line for line in problems(scan, DEFAULT))


def test_a_node_with_an_emergency_explains_its_missing_frames():
    scan = good(canopen.emcy(2, 0x5000, 1), heard(0x382, bytes(8)), without=(0x182,))
    assert problems(scan, DEFAULT)[0] == f'joint_1b: 0x182 missing; its node 2 reports {DEVICE}'
