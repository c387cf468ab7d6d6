# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a scan shows: what is there, missing or unexpected, and the lines for rig.yaml."""

from dataclasses import replace

import can
from encoder_frames import answer, cycle, LAYOUTS, T0
import pytest
from recorded_text import assert_recorded
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
        can.Message(arbitration_id=0x181, is_remote_frame=True, is_extended_id=False),
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


# Scans by the name of their record, and what those are compared with that are not as by default.
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


@pytest.mark.parametrize('name', SCANS)
def test_the_report_of_a_scan_is_as_recorded(tmp_path, name):
    scan = SCANS[name]
    expected = EXPECTED.get(name, DEFAULT)
    lines = [
        *scan_report.listing(scan, expected),
        *problems(scan, expected),
        scan_report.busy(scan, expected.rate) or 'not busy',
    ]
    # Defaults are no knowledge of the rig; a channel that looks like a number stays a text.
    for given in (
        ((name == 'calibrated', 'socketcan', 'can0', None), (False, 'socketcan', '0', 500000))
        if expected.node_ids
        else ()
    ):
        chosen, interface, channel, bitrate = given
        bus = rig_lines.GivenBus(interface, channel, bitrate, chosen)
        found = rig_lines.rig_lines(scan, expected, bus)
        lines += found
        path = tmp_path / 'rig.yaml'
        path.write_text('\n'.join(found))
        assert len(found) == 1 or read_parameters(path)['can.channel'] == given[2]
    assert_recorded(f'encoders/scan/{name}.txt', '\n'.join(lines) + '\n')
