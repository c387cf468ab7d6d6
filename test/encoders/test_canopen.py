# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen frames, byte by byte, the names of their identifiers, and nodes as they report."""

from encoder_frames import decoder, T0
import pytest
from spm_haptic_master.encoders import canopen


# The first and the last identifier of each kind, those of no node, and those between the kinds.
@pytest.mark.parametrize(
    ('identifier', 'name'),
    [
        (0x000, 'NMT'),
        (0x001, None),
        (0x07F, None),
        (0x080, 'SYNC'),
        (0x081, 'EMCY of node 1'),
        (0x0FF, 'EMCY of node 127'),
        (0x100, 'TIME'),
        (0x101, None),
        (0x180, None),
        (0x181, 'TPDO1 of node 1'),
        (0x1FF, 'TPDO1 of node 127'),
        (0x200, None),
        (0x201, None),
        (0x280, None),
        (0x281, 'TPDO2 of node 1'),
        (0x381, 'TPDO3 of node 1'),
        (0x481, 'TPDO4 of node 1'),
        (0x4FF, 'TPDO4 of node 127'),
        (0x500, None),
        (0x501, None),
        (0x580, None),
        (0x581, 'SDO answer of node 1'),
        (0x5FF, 'SDO answer of node 127'),
        (0x600, None),
        (0x601, 'SDO request to node 1'),
        (0x67F, 'SDO request to node 127'),
        (0x680, None),
        (0x6FF, None),
        (0x700, None),
        (0x701, 'heartbeat of node 1'),
        (0x764, 'heartbeat of node 100'),
        (0x77F, 'heartbeat of node 127'),
        (0x780, None),
        (0x7E3, None),
        (0x7E4, 'LSS'),
        (0x7E5, 'LSS'),
        (0x7E6, None),
        (0x7FF, None),
    ],
)
def test_an_identifier_has_the_name_of_the_predefined_connection_set(identifier, name):
    assert canopen.frame_name(identifier) == name
    is_pdo = name is not None and name.startswith('TPDO')
    assert canopen.reserved_for(identifier) == (None if is_pdo else name)


# Error codes of CiA 301 (table 26): classes, and codes that are more than their class.
EMERGENCIES = {
    0x0000: 'error reset',
    0x1000: 'generic error',
    0x2000: 'current',
    0x2100: 'current, input side',
    0x2200: 'current inside the device',
    0x2300: 'current, output side',
    0x3000: 'voltage',
    0x3100: 'mains voltage',
    0x3200: 'voltage inside the device',
    0x3300: 'output voltage',
    0x4000: 'temperature',
    0x4100: 'ambient temperature',
    0x4200: 'device temperature',
    0x5000: 'device hardware',
    0x6000: 'device software',
    0x6100: 'internal software',
    0x6200: 'user software',
    0x6300: 'data set',
    0x7000: 'additional modules',
    0x8000: 'monitoring',
    0x8100: 'communication',
    0x8110: 'CAN overrun (objects lost)',
    0x8120: 'CAN in error passive mode',
    0x8130: 'life guard or heartbeat error',
    0x8140: 'recovered from bus-off',
    0x8150: 'identifier collision',
    0x8160: 'communication',
    0x81F0: 'communication',
    0x8200: 'protocol error',
    0x8210: 'PDO not processed due to length error',
    0x8220: 'PDO length exceeded',
    0x8230: 'protocol error',
    0x8240: 'unexpected SYNC length',
    0x8250: 'RPDO timeout',
    0x8260: 'protocol error',
    0x9000: 'external error',
    0xF000: 'additional functions',
    0xFF00: 'device specific',
    0xFF34: 'device specific',
    0xEEFF: 'code not in CiA 301',
    0xA000: 'code not in CiA 301',
}


@pytest.mark.parametrize(('code', 'words'), EMERGENCIES.items())
def test_an_emergency_has_the_words_of_the_standard(code, words):
    data = canopen.emcy(1, code, 0).data
    assert canopen.emcy_words(data) == f'EMCY 0x{code:04X} {words}, error register 0x00'


def test_an_emergency_has_its_register_and_specific_bytes():
    """Code (2 bytes, little-endian), register, specific bytes (CiA 301, 7.2.7)."""
    data = bytes.fromhex('1081 11 0102000000')
    assert canopen.emcy_words(data) == (
        'EMCY 0x8110 CAN overrun (objects lost), error register 0x11, specific 01 02 00 00 00'
    )


@pytest.mark.parametrize(
    ('code', 'register', 'remains'),
    [(0x0000, 0x00, False), (0x0000, 0x10, True), (0x00FF, 0x10, True), (0x0100, 0x10, False)],
)
def test_a_reset_with_a_register_says_that_another_error_remains(code, register, remains):
    """A reset has the codes 00xxh (CiA 301, table 26); its register has what is left."""
    data = bytes([code & 0xFF, code >> 8, register, 0, 0, 0, 0, 0])
    assert canopen.emcy_words(data).endswith(': another error remains') is remains


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
            'joint_1b serial number': 'not read',
        }


@pytest.mark.parametrize(
    ('frame', 'identifier', 'data'),
    [
        # Commands of NMT (CiA 301, 7.2.8.3.1): command and node id.
        (canopen.nmt(canopen.NMT_START, 5), 0x000, '01 05'),
        (canopen.nmt(canopen.NMT_STOP, 5), 0x000, '02 05'),
        (canopen.nmt(canopen.NMT_PRE_OPERATIONAL, 5), 0x000, '80 05'),
        (canopen.nmt(canopen.NMT_RESET_NODE, 0), 0x000, '81 00'),
        (canopen.nmt(canopen.NMT_RESET_COMMUNICATION, 0), 0x000, '82 00'),
        (canopen.frame(canopen.SYNC_ID), 0x080, ''),
        (canopen.emcy(5, 0x8110, 0x11), 0x085, '10 81 11 00 00 00 00 00'),
        # SDO: command, index, subindex, value (7.2.4.3); the command has the unused bytes.
        (canopen.sdo_upload(5, *canopen.SERIAL_NUMBER), 0x605, '40 18 10 04 00 00 00 00'),
        (canopen.sdo_write(5, 0x1017, 0, 100, 2), 0x605, '2B 17 10 00 64 00 00 00'),
        (canopen.sdo_write(5, 0x1800, 2, 1, 1), 0x605, '2F 00 18 02 01 00 00 00'),
        (
            canopen.sdo_write(5, *canopen.STORE, canopen.SAVE, 4),
            0x605,
            '23 10 10 01 73 61 76 65',
        ),
        (canopen.sdo_answer(5, *canopen.POSITION, 0x01020304), 0x585, '43 04 60 00 04 03 02 01'),
        (
            canopen.sdo_answer(5, *canopen.ERROR_REGISTER, 0x81, 1),
            0x585,
            '4F 01 10 00 81 00 00 00',
        ),
        (
            canopen.sdo(0x585, canopen.SDO_ABORT, 0x1010, 1, canopen.SDO_NOT_STORED),
            0x585,
            '80 10 10 01 20 00 00 08',
        ),
        (
            canopen.sdo(0x585, canopen.SDO_DOWNLOAD_ANSWER, 0x1017, 0),
            0x585,
            '60 17 10 00 00 00 00 00',
        ),
    ],
)
def test_frames_are_those_of_the_standard(frame, identifier, data):
    assert frame.arbitration_id == identifier
    assert not frame.is_extended_id
    assert bytes(frame.data) == bytes.fromhex(data)


# Objects of CiA 301 (7.5) and CiA 406, as their data sheets name them.
OBJECTS = {
    'DEVICE_TYPE': '0x1000:00',
    'ERROR_REGISTER': '0x1001:00',
    'SYNC_IDENTIFIER': '0x1005:00',
    'SYNC_PERIOD': '0x1006:00',
    'STORE': '0x1010:01',
    'HEARTBEAT_TIME': '0x1017:00',
    'VENDOR_ID': '0x1018:01',
    'PRODUCT_CODE': '0x1018:02',
    'REVISION': '0x1018:03',
    'SERIAL_NUMBER': '0x1018:04',
    'SYNC_COUNTER': '0x1019:00',
    'OPERATING_PARAMETERS': '0x6000:00',
    'UNITS_PER_TURN': '0x6001:00',
    'TOTAL_RANGE': '0x6002:00',
    'POSITION': '0x6004:00',
    'CYCLIC_TIMER': '0x6200:00',
    'DISC_UNITS_PER_TURN': '0x6501:00',
}


@pytest.mark.parametrize(('name', 'words'), OBJECTS.items())
def test_objects_have_the_index_of_the_standard(name, words):
    assert canopen.object_name(*getattr(canopen, name)) == words


# Numbers of CiA 301: parameters and mapping of PDOs, bits of their identifiers, abort codes.
NUMBERS = {
    'RPDO_PARAMETERS': 0x1400,
    'RPDO_MAPPING': 0x1600,
    'TPDO_PARAMETERS': 0x1800,
    'TPDO_MAPPING': 0x1A00,
    'TPDO_IDENTIFIER': 1,
    'TPDO_TYPE': 2,
    'TPDO_INHIBIT_TIME': 3,
    'TPDO_EVENT_TIMER': 5,
    'TPDO_OFF': 0x80000000,
    'TPDO_NO_REQUEST': 0x40000000,
    'TPDO_EXTENDED': 0x20000000,
    'TPDO_ID_MASK': 0x1FFFFFFF,
    'SYNC_PRODUCED': 0x40000000,
    'EVERY_SYNC': 1,
    'EVENT_DRIVEN': 254,
    'STORES': 3,
    'SCALING_ON': 4,
    'NODE_ID_MAXIMUM': 127,
    'SYNC_MAXIMUM_LENGTH': 1,
    'EMCY_LENGTH': 8,
    'HEARTBEAT_LENGTH': 1,
    'SDO_LENGTH': 8,
    'SDO_UNKNOWN_COMMAND': 0x05040001,
    'SDO_READ_ONLY': 0x06010002,
    'SDO_NO_SUCH_OBJECT': 0x06020000,
    'SDO_WRONG_LENGTH': 0x06070010,
    'SDO_NO_SUCH_SUBINDEX': 0x06090011,
    'SDO_WRONG_VALUE': 0x06090030,
    'SDO_WRONG_STATE': 0x08000022,
    'RPDO_BASES': (0x200, 0x300, 0x400, 0x500),
    'TPDO_BASES': (0x180, 0x280, 0x380, 0x480),
}


@pytest.mark.parametrize(('name', 'number'), NUMBERS.items())
def test_numbers_are_those_of_the_standard(name, number):
    assert getattr(canopen, name) == number


@pytest.mark.parametrize(
    ('state', 'word'),
    [
        (0x00, 'booting'),
        (0x04, 'stopped'),
        (0x05, 'operational'),
        (0x7F, 'pre-operational'),
        # With the toggle bit of node guarding.
        (0x85, 'operational'),
        (0x06, 'in unknown state 0x06'),
    ],
)
def test_a_state_has_the_word_of_the_standard(state, word):
    assert canopen.state_word(state) == word


@pytest.mark.parametrize(
    ('register', 'words'),
    [
        (0x01, '0x01 (generic)'),
        (0x02, '0x02 (current)'),
        (0x04, '0x04 (voltage)'),
        (0x08, '0x08 (temperature)'),
        (0x10, '0x10 (communication)'),
        (0x20, '0x20 (device profile)'),
        (0x40, '0x40 (reserved bits)'),
        (0x81, '0x81 (generic, manufacturer)'),
    ],
)
def test_an_error_register_has_the_words_of_the_standard(register, words):
    assert canopen.register_words(register) == f'error register {words}'


@pytest.mark.parametrize(
    ('code', 'register', 'is_over'),
    [(0x0000, 0, True), (0x00FF, 0, True), (0x0000, 0x10, False), (0x0100, 0, False)],
)
def test_an_emergency_is_over_if_the_register_has_no_error(code, register, is_over):
    assert canopen.emcy_is_over(canopen.emcy(1, code, register).data) is is_over


@pytest.mark.parametrize(
    ('data', 'value'),
    [
        ('23 171000 01020304', '01020304'),
        ('27 171000 01020304', '010203'),
        ('2B 171000 01020304', '0102'),
        ('2F 171000 01020304', '01'),
        # Without the size, segmented, an upload.
        ('22 171000 01020304', None),
        ('21 171000 01020304', None),
        ('40 171000 00000000', None),
        ('33 171000 01020304', None),
    ],
)
def test_the_value_of_a_download_has_its_size(data, value):
    found = canopen.sdo_download(bytes.fromhex(data))
    assert found == (None if value is None else bytes.fromhex(value))


@pytest.mark.parametrize(
    ('devices', 'word'),
    [(2, 'two'), (3, 'three'), (4, 'four'), (5, 'five'), (6, 'six'), (7, '7')],
)
def test_devices_with_one_node_id_are_counted_in_words(devices, word):
    assert canopen.shared_node_id(9, devices).startswith(f'{word} devices have node id 9: ')


def test_device_types_name_encoders_and_drives():
    assert canopen.PROFILES == {406: 'encoder', 402: 'drive'}
