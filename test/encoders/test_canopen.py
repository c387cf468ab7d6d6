# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen frames, byte by byte, and their words."""

import pytest
from spm_haptic_master.encoders import canopen

# Emergencies (CiA 301, 7.2.7): code (2 bytes, little-endian), register, specific; their words.
EMERGENCIES = [
    ('0050 01 0000000000', 'EMCY 0x5000 device hardware, error register 0x01'),
    ('1081 11 0102000000', 'EMCY 0x8110 CAN overrun (objects lost), error register 0x11, '
     'specific 01 02 00 00 00'),
    # Class 0x42, class 0xFF with the last specific byte, the end of all errors, of no class.
    ('2042 09 0000000000', 'EMCY 0x4220 device temperature, error register 0x09'),
    ('34FF 81 0000000007', 'EMCY 0xFF34 device specific, error register 0x81, '
     'specific 00 00 00 00 07'),
    ('0000 00 0000000000', 'EMCY 0x0000 error reset, error register 0x00'),
    ('FFEE 01 0000000000', 'EMCY 0xEEFF code not in CiA 301, error register 0x01'),
]
# Answers to an SDO upload (CiA 301, 7.2.4.3): command, 0x1000:00, four bytes; the value in them.
SDO_ANSWERS = [
    # Expedited, with a size of four, three, two bytes and one; and without: all four bytes.
    ('43 001000 96010100', 0x00010196), ('47 001000 960102FF', 0x020196),
    ('4B 001000 9601FFFF', 0x0196), ('4F 001000 05FFFFFF', 5), ('42 001000 01020304', 0x04030201),
    # An abort, the answer to a download, a segmented upload.
    ('80 001000 00000206', None), ('60 001000 00000000', None), ('41 001000 10000000', None),
]
# Frames as this package sends them: identifier, data.
SENT = [
    (canopen.nmt(canopen.NMT_START, 3), 0x000, '01 03'),
    (canopen.frame(0x80), 0x080, ''),
    # Code, register, specific.
    (canopen.emcy(4, 0x8130, 0x11, b'\x0A'), 0x084, '3081 11 0A00000000'),
    # Command, index (little-endian), subindex, value (little-endian).
    (canopen.sdo_upload(5, 0x1018, 2), 0x605, '40 1810 02 00000000'),
    (canopen.sdo_answer(5, 0x1018, 2, 0x53504D), 0x585, '43 1810 02 4D505300'),
    (canopen.sdo_abort(5, 0x1018, 2, 0x06020000), 0x585, '80 1810 02 00000206'),
]


@pytest.mark.parametrize(('identifier', 'name'), [
    (0, 'NMT'), (0x80, 'SYNC'), (0x100, 'TIME'), (0x7E4, 'LSS'), (0x7E5, 'LSS'),
    (0x81, 'EMCY of node 1'), (0xFF, 'EMCY of node 127'), (0x181, 'TPDO1 of node 1'),
    (0x2FF, 'TPDO2 of node 127'), (0x381, 'TPDO3 of node 1'), (0x4FF, 'TPDO4 of node 127'),
    (0x581, 'SDO answer of node 1'), (0x605, 'SDO request to node 5'),
    (0x77F, 'heartbeat of node 127'), *((other, None) for other in (0x201, 0x180, 0x1, 0x700))])
def test_identifiers_have_names(identifier, name):
    assert canopen.frame_name(identifier) == name
    free = name is None or name.startswith('TPDO')
    assert canopen.reserved_for(identifier) == (None if free else name)


@pytest.mark.parametrize(('data', 'words'), EMERGENCIES)
def test_emergencies_have_words(data, words):
    assert canopen.emcy_words(bytes.fromhex(data)) == words
    assert canopen.emcy_code(bytes.fromhex(data)) == int(words[7:11], 16)


@pytest.mark.parametrize(('data', 'value'), SDO_ANSWERS)
def test_sdo_answers(data, value):
    assert canopen.sdo_value(bytes.fromhex(data)) == value
    assert canopen.sdo_object(bytes.fromhex(data)) == (0x1000, 0)


@pytest.mark.parametrize(('message', 'identifier', 'data'), SENT)
def test_frames_are_sent_as_cia_301_has_them(message, identifier, data):
    assert message.arbitration_id == identifier
    assert message.data == bytes.fromhex(data)
    assert not message.is_extended_id


@pytest.mark.parametrize(('state', 'word'), [
    (0x00, 'booting'), (0x04, 'stopped'), (0x05, 'operational'), (0x85, 'operational'),
    (0x7F, 'pre-operational'), (0x33, 'in unknown state 0x33')])
def test_nmt_states_have_words(state, word):
    assert canopen.state_word(state) == word
