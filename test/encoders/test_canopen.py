# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen frames, byte by byte, the names of their identifiers, and nodes as they report."""

from encoder_frames import decoder, T0
import pytest
from recorded_text import assert_recorded
from spm_haptic_master.encoders import canopen


def test_identifiers_and_emergencies_have_the_words_of_the_standard():
    """Identifiers of no node, nodes 1 and 127, and LSS; classes and codes of emergencies."""
    lines = [
        f'0x{each:03X}: {canopen.frame_name(each)}; not for a PDO: {canopen.reserved_for(each)}'
        for each in range(0x800)
        if each & 0x7F in (0, 1, 0x64, 0x65, 0x7F)
    ]
    for code in (*range(0, 0x10000, 0x100), *range(0x8110, 0x8270, 0x10)):
        words = canopen.emcy_words(canopen.emcy(1, code, 0).data)
        lines += [] if 'not in CiA 301' in words else [words]
    # Code (2 bytes, little-endian), register, specific bytes (CiA 301, 7.2.7).
    lines += [
        f'{data}: {canopen.emcy_words(bytes.fromhex(data))}'
        for data in ('1081 11 0102000000', '34FF 81 0000000007', 'FFEE 01 0000000000')
    ]
    assert_recorded('encoders/canopen.txt', '\n'.join(lines) + '\n')


# Answers to an SDO upload (CiA 301, 7.2.4.3): command, 0x1000:00, four bytes; the value in them.
@pytest.mark.parametrize(
    ('data', 'value'),
    [
        # Expedited, with a size of four, three, two bytes and one; and without: all four bytes.
        ('43 001000 96010100', 0x00010196),
        ('47 001000 960102FF', 0x020196),
        ('4B 001000 9601FFFF', 0x0196),
        ('4F 001000 05FFFFFF', 5),
        ('42 001000 01020304', 0x04030201),
        # An abort, the answer to a download, a segmented upload.
        ('80 001000 00000206', None),
        ('60 001000 00000000', None),
        ('41 001000 10000000', None),
    ],
)
def test_sdo_answers(data, value):
    assert canopen.sdo_value(bytes.fromhex(data)) == value
    assert canopen.sdo_object(bytes.fromhex(data)) == (0x1000, 0)


WORDS = 'EMCY 0x5000 device hardware, error register 0x01'
EMERGENCY = bytes((0x00, 0x50, 0x01, 0, 0, 0, 0, 0))


def test_a_boot_up_calls_for_a_start_at_once_and_silence_not_too_often():
    taker = decoder()

    def started(at, *silent):
        return [node.node_id for node in taker.network.to_start(T0 + at, silent)]

    assert started(0.0, 0, 2) == [1, 3]
    assert started(0.0, 0, 2) == started(0.1, 0, 2) == []
    # A node that boots again and again, as in a recording in a loop, is started once.
    for _ in range(3):
        taker.feed(canopen.frame(0x703, b'\x00', T0 + 0.15))
    assert started(0.15, 2) == [3]
    assert started(0.499, 0, 2) == []
    assert started(0.5, 0, 2) == [1]
    # A clock set back does not delay the next start.
    assert started(-3.0, 0, 2) == [1, 3]


def test_nodes_are_followed_by_heartbeat_boot_up_and_emergency():
    taker = decoder(can__heartbeat_timeout=0.25)
    node = taker.network.nodes[1]
    beats = 'operational, heartbeat '
    for at, identifier, data, now, trouble, state, emergency in (
        (0.0, 0x701, b'\x05', 0.0, None, 'unknown, no heartbeat yet', 'none (0'),
        # Boot-up, then operational: bit 7 is not the state's.
        (0.1, 0x702, b'\x00', 0.2, 'booting', 'booting, no heartbeat yet', 'none (0'),
        # A heartbeat is lost after its timeout, not at it.
        (0.25, 0x702, b'\x85', 0.5, None, beats + '250 ms ago', 'none (0'),
        (0.25, 0x702, b'\x85', 0.51, 'heartbeat lost', beats + '260 ms ago (lost)', 'none (0'),
        # An emergency comes first, until it is reset or the node boots.
        (0.6, 0x82, EMERGENCY, 0.6, WORDS, beats + '350 ms ago (lost)', WORDS + ' (1'),
        (0.7, 0x82, bytes(8), 0.7, 'heartbeat lost', beats + '450 ms ago (lost)', 'none (2'),
        (0.8, 0x82, EMERGENCY, 0.8, WORDS, beats + '550 ms ago (lost)', WORDS + ' (3'),
        (0.9, 0x702, b'\x00', 9.0, 'booting', 'booting, no heartbeat yet', 'none (3'),
    ):
        taker.feed(canopen.frame(identifier, data, T0 + at))
        assert node.trouble(T0 + now) == trouble
        # A state alone is no caution: the encoder may answer.
        assert node.caution(T0 + now) == (None if trouble == 'booting' else trouble)
        assert node.statistics(T0 + now) == {
            'joint_1b node 2': state,
            'joint_1b boot-ups': (at >= 0.1) + (at >= 0.9),
            'joint_1b EMCY': emergency + ' messages)',
            'joint_1b error register': '0x00' if at == 0.7 or at == 0.8 else 'not read',
        }
