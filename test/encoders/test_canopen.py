# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen frames, byte by byte, and their words."""

import can
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_errors import error_words

# Emergencies (CiA 301, 7.2.7) and their words.
EMERGENCIES = [
    (bytes((
        0x00, 0x50,                    # error code 0x5000, little-endian: device hardware
        0x01,                          # error register: generic error
        0x00, 0x00, 0x00, 0x00, 0x00,  # manufacturer-specific: nothing
    )), 'EMCY 0x5000 device hardware, error register 0x01'),
    (bytes((
        0x10, 0x81,                    # error code 0x8110: CAN overrun
        0x11,                          # error register: generic error, communication
        0x01, 0x02, 0x00, 0x00, 0x00,  # manufacturer-specific: two bytes
    )), 'EMCY 0x8110 CAN overrun (objects lost), error register 0x11, specific 01 02 00 00 00'),
    (bytes((
        0x20, 0x42,                    # error code 0x4220: class 0x42, device temperature
        0x09,                          # error register: generic error, temperature
        0x00, 0x00, 0x00, 0x00, 0x00,
    )), 'EMCY 0x4220 device temperature, error register 0x09'),
    (bytes((
        0x34, 0xFF,                    # error code 0xFF34: class 0xFF, device specific
        0x81,                          # error register: generic error, manufacturer-specific
        0x00, 0x00, 0x00, 0x00, 0x07,  # manufacturer-specific: the last byte
    )), 'EMCY 0xFF34 device specific, error register 0x81, specific 00 00 00 00 07'),
    (bytes((
        0x00, 0x00,                    # error code 0x0000: error reset
        0x00,                          # error register: no error
        0x00, 0x00, 0x00, 0x00, 0x00,
    )), 'EMCY 0x0000 error reset, error register 0x00'),
    (bytes((
        0xFF, 0xEE,                    # error code 0xEEFF: of no class
        0x01,                          # error register: generic error
        0x00, 0x00, 0x00, 0x00, 0x00,
    )), 'EMCY 0xEEFF code not in CiA 301, error register 0x01'),
]
# Answers to an SDO upload of object 0x1000:00 (CiA 301, 7.2.4.3), and the value in them.
SDO_ANSWERS = [
    (bytes((
        0x43,                    # expedited, size given, no byte unused
        0x00, 0x10,              # index 0x1000, little-endian
        0x00,                    # subindex 0
        0x96, 0x01, 0x01, 0x00,  # UNSIGNED32, little-endian
    )), 0x00010196),
    (bytes((
        0x47,                    # expedited, size given, one byte unused
        0x00, 0x10, 0x00,        # 0x1000:00
        0x96, 0x01, 0x02, 0xFF,  # three bytes, and one without meaning
    )), 0x020196),
    (bytes((
        0x4B,                    # expedited, size given, two bytes unused
        0x00, 0x10, 0x00,        # 0x1000:00
        0x96, 0x01, 0xFF, 0xFF,  # UNSIGNED16, and two bytes without meaning
    )), 0x0196),
    (bytes((
        0x4F,                    # expedited, size given, three bytes unused
        0x00, 0x10, 0x00,        # 0x1000:00
        0x05, 0xFF, 0xFF, 0xFF,  # UNSIGNED8, and three bytes without meaning
    )), 5),
    (bytes((
        0x42,                    # expedited, size not given: all four bytes
        0x00, 0x10, 0x00,        # 0x1000:00
        0x01, 0x02, 0x03, 0x04,
    )), 0x04030201),
    (bytes((
        0x80,                    # abort
        0x00, 0x10, 0x00,        # 0x1000:00
        0x00, 0x00, 0x02, 0x06,  # abort code 0x06020000: no such object
    )), None),
    (bytes((
        0x60,                    # answer to a download
        0x00, 0x10, 0x00,        # 0x1000:00
        0x00, 0x00, 0x00, 0x00,
    )), None),
    (bytes((
        0x41,                    # size given, but not expedited: a segmented upload
        0x00, 0x10, 0x00,        # 0x1000:00
        0x10, 0x00, 0x00, 0x00,  # its length, 16 bytes
    )), None),
]
# Frames as this package sends them: identifier, data.
SENT = [
    (canopen.nmt(canopen.NMT_START, 3), 0x000, (
        0x01,                    # start
        0x03,                    # node 3
    )),
    (canopen.frame(0x80), 0x080, ()),
    (canopen.emcy(4, 0x8130, 0x11, b'\x0A'), 0x084, (
        0x30, 0x81,              # error code 0x8130, little-endian
        0x11,                    # error register
        0x0A, 0x00, 0x00, 0x00, 0x00,  # manufacturer-specific
    )),
    (canopen.sdo_upload(5, 0x1018, 2), 0x605, (
        0x40,                    # upload
        0x18, 0x10,              # index 0x1018, little-endian
        0x02,                    # subindex 2
        0x00, 0x00, 0x00, 0x00,  # reserved
    )),
    (canopen.sdo_answer(5, 0x1018, 2, 0x53504D), 0x585, (
        0x43,                    # expedited, size given, no byte unused
        0x18, 0x10, 0x02,        # 0x1018:02
        0x4D, 0x50, 0x53, 0x00,  # value, little-endian
    )),
    (canopen.sdo_abort(5, 0x1018, 2, 0x06020000), 0x585, (
        0x80,                    # abort
        0x18, 0x10, 0x02,        # 0x1018:02
        0x00, 0x00, 0x02, 0x06,  # abort code, little-endian
    )),
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
    assert canopen.emcy_words(data) == words
    assert canopen.emcy_code(data) == int(words[7:11], 16)


@pytest.mark.parametrize(('data', 'value'), SDO_ANSWERS)
def test_sdo_answers(data, value):
    assert canopen.sdo_value(data) == value
    assert canopen.sdo_object(data) == (0x1000, 0)


@pytest.mark.parametrize(('message', 'identifier', 'data'), SENT)
def test_frames_are_sent_as_cia_301_has_them(message, identifier, data):
    assert message.arbitration_id == identifier
    assert tuple(message.data) == data
    assert not message.is_extended_id


@pytest.mark.parametrize(('state', 'word'), [
    (0x00, 'booting'), (0x04, 'stopped'), (0x05, 'operational'), (0x85, 'operational'),
    (0x7F, 'pre-operational'), (0x33, 'in unknown state 0x33')])
def test_nmt_states_have_words(state, word):
    assert canopen.state_word(state) == word


# Linux, include/uapi/linux/can/error.h: classes in the identifier, and byte 1 of a controller's.
ERROR_CLASSES = [
    (0x001, '', 'transmit timeout'), (0x020, '', 'no acknowledge (is any other node on the bus?)'),
    (0x040, '', 'bus-off'), (0x100, '', 'controller restarted'),
    (0x088, '', 'protocol violation, bus error'), (0x200, '', 'unknown error 0x200'),
    (0x004, '0030000000000000',
     'controller problem, receive error passive, transmit error passive'),
    (0x004, '0001', 'controller problem, receive overflow'),
    # Too short for details, and details of another class.
    (0x004, '01', 'controller problem'), (0x008, '0030000000000000', 'protocol violation'),
]


@pytest.mark.parametrize(('identifier', 'data', 'words'), ERROR_CLASSES)
def test_error_frames_have_words(identifier, data, words):
    assert error_words(can.Message(
        arbitration_id=identifier, is_error_frame=True, data=bytes.fromhex(data))) == words
