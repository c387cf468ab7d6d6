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


def test_names_stand_for_the_standards_numbers():
    assert (canopen.NMT_START, canopen.NMT_STOP, canopen.NMT_PRE_OPERATIONAL,
            canopen.NMT_RESET_NODE, canopen.NMT_RESET_COMMUNICATION) \
        == (0x01, 0x02, 0x80, 0x81, 0x82)
    assert (canopen.DEVICE_TYPE, canopen.VENDOR_ID, canopen.PRODUCT_CODE, canopen.REVISION,
            canopen.SERIAL_NUMBER) \
        == ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4))
    assert (canopen.SDO_ABORT, canopen.SDO_NO_SUCH_OBJECT, canopen.SDO_UNKNOWN_COMMAND) \
        == (0x80, 0x06020000, 0x05040001)
    assert (canopen.NMT_ID, canopen.SYNC_ID, canopen.HEARTBEAT_BASE, canopen.ENCODER_PROFILE) \
        == (0x000, 0x080, 0x700, 406)


@pytest.mark.parametrize(('data', 'words'), EMERGENCIES)
def test_emergencies_have_words(data, words):
    assert canopen.emcy_words(data) == words
    assert canopen.emcy_code(data) == int(words[7:11], 16)


# CiA 301, table 26: error codes, and what they mean; XX is any byte.
ERROR_CODES = """
    00XX error reset
    10XX generic error
    20XX current
    21XX current, input side
    22XX current inside the device
    23XX current, output side
    30XX voltage
    31XX mains voltage
    32XX voltage inside the device
    33XX output voltage
    40XX temperature
    41XX ambient temperature
    42XX device temperature
    50XX device hardware
    60XX device software
    61XX internal software
    62XX user software
    63XX data set
    70XX additional modules
    80XX monitoring
    81XX communication
    82XX protocol error
    90XX external error
    F0XX additional functions
    FFXX device specific
    8110 CAN overrun (objects lost)
    8120 CAN in error passive mode
    8130 life guard or heartbeat error
    8140 recovered from bus-off
    8150 identifier collision
    8210 PDO not processed due to length error
    8220 PDO length exceeded
    8240 unexpected SYNC length
    8250 RPDO timeout
"""


@pytest.mark.parametrize('line', ERROR_CODES.strip().splitlines())
def test_every_error_code_of_the_standard_has_words(line):
    code, _, words = line.strip().partition(' ')
    for byte in ('00', '77', 'FF') if 'X' in code else ('',):
        number = int(code.replace('XX', byte), 16)
        data = number.to_bytes(2, 'little') + bytes(6)
        assert canopen.emcy_words(data) == f'EMCY 0x{number:04X} {words}, error register 0x00'


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
    (0x001, '', 'transmit timeout'), (0x002, '', 'lost arbitration'),
    (0x004, '', 'controller problem'), (0x008, '', 'protocol violation'),
    (0x010, '', 'transceiver'), (0x020, '', 'no acknowledge (is any other node on the bus?)'),
    (0x040, '', 'bus-off'), (0x080, '', 'bus error'), (0x100, '', 'controller restarted'),
    (0x004, '0001', 'controller problem, receive overflow'),
    (0x004, '0002', 'controller problem, transmit overflow'),
    (0x004, '0004', 'controller problem, receive warning level'),
    (0x004, '0008', 'controller problem, transmit warning level'),
    (0x004, '0010', 'controller problem, receive error passive'),
    (0x004, '0020', 'controller problem, transmit error passive'),
    (0x004, '0040', 'controller problem, error active again'),
    (0x004, '0030000000000000',
     'controller problem, receive error passive, transmit error passive'),
    # Too short for details, and details of another class.
    (0x004, '01', 'controller problem'), (0x008, '0030000000000000', 'protocol violation'),
    (0x088, '', 'protocol violation, bus error'), (0x200, '', 'unknown error 0x200'),
]


@pytest.mark.parametrize(('identifier', 'data', 'words'), ERROR_CLASSES)
def test_error_frames_have_words(identifier, data, words):
    assert error_words(can.Message(
        arbitration_id=identifier, is_error_frame=True, data=bytes.fromhex(data))) == words
