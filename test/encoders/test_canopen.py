# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen frames, byte by byte, their words, and the nodes that send them."""

import can
from encoder_frames import decoder, LAYOUTS, T0, values
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.error_frames import error_words
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.simulation.fault_injection import KINDS, parse_fault
from spm_haptic_master.simulation.settings import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.simulation.simulated_nodes import SimulatedNode

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


def test_a_node_walks_through_its_states():
    node = SimulatedNode(LAYOUTS[2], 3)
    (boot,) = node.boot()
    assert (boot.arbitration_id, bytes(boot.data)) == (0x703, b'\x00')
    assert node.answer(0.1) == []
    assert bytes(node.heartbeat()[0].data) == b'\x7f'
    for command, node_id, state in [
            (canopen.NMT_START, 2, 0x7F), (canopen.NMT_START, 3, 5), (canopen.NMT_STOP, 0, 4),
            (canopen.NMT_START, 0, 5), (canopen.NMT_PRE_OPERATIONAL, 3, 0x7F)]:
        node.receive(canopen.nmt(command, node_id))
        assert node.state == state
    node.receive(canopen.nmt(canopen.NMT_START, 3))
    (frame,) = node.answer(0.25)
    assert frame.arbitration_id == 0x183
    assert LAYOUTS[2].angle(LAYOUTS[2].counts(frame.data)) == pytest.approx(0.25, abs=2e-4)
    assert node.receive(canopen.nmt(canopen.NMT_RESET_NODE, 3))[0].arbitration_id == 0x703
    assert node.state == canopen.PRE_OPERATIONAL


def test_a_node_answers_who_it_is():
    node = SimulatedNode(LAYOUTS[0], 1)
    (answer,) = node.receive(canopen.sdo_upload(1, *canopen.DEVICE_TYPE))
    assert answer.arbitration_id == 0x581
    assert canopen.sdo_value(answer.data) & 0xFFFF == 406
    (abort,) = node.receive(canopen.sdo_upload(1, 0x2000, 0))
    assert abort.data[0] == canopen.SDO_ABORT
    assert node.receive(canopen.sdo_upload(2, *canopen.DEVICE_TYPE)) == []


def heard(identifier, data, at):
    """Return a node's frame, `at` seconds into the test."""
    message = canopen.frame(identifier, data)
    message.timestamp = T0 + at
    return message


def test_a_boot_up_calls_for_a_start_at_once_and_silence_not_too_often():
    taker = decoder()

    def started(at, *silent):
        return [node.node_id for node in taker.network.to_start(T0 + at, silent)]

    assert started(0.0, 0, 2) == [1, 3]
    assert started(0.0, 0, 2) == []
    assert started(0.1, 0, 2) == []
    taker.feed(heard(0x703, b'\x00', 0.15))
    assert taker.network.booted
    assert started(0.15, 2) == [3]
    assert not taker.network.booted
    assert started(0.499, 0, 2) == []
    assert started(0.5, 0, 2) == [1]
    # A clock set back does not delay the next start.
    assert started(-3.0, 0, 2) == [1, 3]


def test_nodes_are_followed_by_heartbeat_boot_up_and_emergency():
    taker = decoder(can__heartbeat_timeout=0.2)
    nodes = taker.network
    node = nodes.nodes[1]

    def figures(now):
        return {name.removeprefix('joint_1b '): value
                for name, value in nodes.statistics(T0 + now).items()
                if name.startswith('joint_1b')}

    assert figures(0.0) == {'node 2': 'unknown, no heartbeat yet', 'boot-ups': 0,
                            'EMCY': 'none (0 messages)'}
    assert nodes.trouble(1, T0) is None
    assert nodes.caution(T0) is None
    # Boot-up, in pre-operational, then operational: bit 7 is not the state's.
    taker.feed(heard(0x702, b'\x00', 0.1))
    assert figures(0.2) == {'node 2': 'booting, no heartbeat yet', 'boot-ups': 1,
                            'EMCY': 'none (0 messages)'}
    assert nodes.trouble(1, T0 + 0.2) == 'booting'
    taker.feed(heard(0x702, b'\x7F', 0.2))
    assert nodes.trouble(1, T0 + 0.2) == 'pre-operational'
    assert figures(0.25)['node 2'] == 'pre-operational, heartbeat 50 ms ago'
    taker.feed(heard(0x702, b'\x85', 0.3))
    assert node.state == canopen.OPERATIONAL
    assert nodes.trouble(1, T0 + 0.4) is None
    # A heartbeat is lost after its timeout, not at it.
    assert nodes.caution(T0 + 0.49) is None
    assert nodes.caution(T0 + 0.51) == 'joint_1b: heartbeat lost'
    assert nodes.trouble(1, T0 + 0.51) == 'heartbeat lost'
    assert figures(0.55)['node 2'] == 'operational, heartbeat 250 ms ago (lost)'
    # An emergency comes first, until it is reset.
    taker.feed(heard(0x82, bytes((0x00, 0x50, 0x01, 0, 0, 0, 0, 0)), 0.6))
    words = 'EMCY 0x5000 device hardware, error register 0x01'
    assert nodes.trouble(1, T0 + 0.6) == words
    assert nodes.emergencies() == [('joint_1b', words)]
    assert nodes.caution(T0 + 0.6) == f'joint_1b: {words}'
    assert figures(0.6)['EMCY'] == f'{words} (1 messages)'
    taker.feed(heard(0x82, bytes(8), 0.7))
    assert nodes.emergencies() == []
    assert figures(0.7)['EMCY'] == 'none (2 messages)'
    # A reboot ends emergency and supervision.
    taker.feed(heard(0x82, bytes((0x00, 0x50, 0x01, 0, 0, 0, 0, 0)), 0.8))
    taker.feed(heard(0x702, b'\x00', 0.9))
    assert nodes.emergencies() == []
    assert nodes.caution(T0 + 9.0) is None
    assert node.boot_ups == 2
    assert [other.boot_ups for other in nodes.nodes] == [0, 2, 0, 0]


def test_a_heartbeat_at_its_timeout_is_not_lost():
    taker = decoder(can__heartbeat_timeout=0.25)
    message = canopen.frame(0x702, b'\x05')
    message.timestamp = 64.0
    taker.feed(message)
    assert taker.network.caution(64.25) is None
    assert taker.network.caution(64.26) == 'joint_1b: heartbeat lost'


def test_two_nodes_in_trouble_are_both_named():
    taker = decoder()
    for node_id in (1, 4):
        taker.feed(heard(0x80 + node_id, bytes((0x00, 0x50, 0x01, 0, 0, 0, 0, 0)), 0.0))
    words = 'EMCY 0x5000 device hardware, error register 0x01'
    assert taker.network.caution(T0) == f'joint_1a: {words}; joint_3a: {words}'


def rig(*faults):
    """Return simulated encoders, started, and a function for the angles at a time."""
    motion = make_motion(values('sim', sim__noise_deg=0.0, sim__trajectory='fixed'))
    bus = SimulatedBus(LAYOUTS, (1, 2, 3, 4), motion, tuple(map(parse_fault, faults)), 10.0, 1)
    bus.boot()
    for node_id in (1, 2, 3, 4):
        bus.receive(canopen.nmt(canopen.NMT_START, node_id))

    def at(t):
        others = bus.tend(t)
        angles = {}
        for message in bus.cycle(t):
            index = message.arbitration_id - 0x181
            angles[index] = LAYOUTS[index].angle(LAYOUTS[index].counts(message.data))
        return angles, others

    at(0.0)
    return at


TRUE = rig()(0.0)[0]


@pytest.mark.parametrize(('fault', 'during'), [
    ('dropout:joint_1b@1+1', {1: None}), ('silence@1+1', dict.fromkeys(range(4))),
    ('busoff@1+1', dict.fromkeys(range(4))), ('offset:joint_3a@1+1=2', {3: 0.034907}),
    ('jump:joint_1a@1+1=-5', {0: -0.087266}), ('reboot:joint_1c@1+1', {2: None})])
def test_faults_do_what_they_say_and_end(fault, during):
    at = rig(fault)
    for t, expected in ((0.5, {}), (1.5, during), (2.5, {})):
        angles, _ = at(t)
        if t == 2.5 and fault.startswith('reboot'):
            expected = {2: None}  # booted, and not started again
        for index in range(4):
            if expected.get(index, 0.0) is None:
                assert index not in angles
            else:
                assert angles[index] == pytest.approx(
                    TRUE[index] + expected.get(index, 0.0), abs=4e-4)


def test_a_jump_is_one_answer():
    at = rig('jump:joint_1a@1=5')
    assert at(1.0)[0][0] != pytest.approx(TRUE[0], abs=0.01)
    assert at(1.001)[0][0] == pytest.approx(TRUE[0], abs=1e-3)


def test_emergency_and_its_reset_and_boot_up_are_sent():
    at = rig('emcy:joint_1b@1+1=0x8130', 'reboot:joint_3a@3+1')
    assert [bytes(m.data[:2]) for m in at(1.5)[1]] == [b'\x30\x81']
    assert [bytes(m.data[:2]) for m in at(2.5)[1]] == [b'\x00\x00']
    at(3.5)
    assert [m.arbitration_id for m in at(4.5)[1]] == [0x704]


@pytest.mark.parametrize(('text', 'wrong'), [
    ('', 'expected KIND'), ('dropout', 'expected KIND'), ('dropout@1', "joint 'None'"),
    ('dropout:joint_9@1', 'joint_1a'), ('melt:joint_1a@1', "kind 'melt'"),
    ('silence:joint_1a@1', 'no joint'), ('offset:joint_1a@1', '=VALUE \\(deg\\)'),
    ('dropout:joint_1a@1=3', 'no value with dropout'), ('offset:joint_1a@1=x', 'not a number'),
    ('emcy:joint_1a@1=1.5', 'not a number'), ('dropout:joint_1a@1.2.3', 'not a number')])
def test_a_fault_that_cannot_be_is_told(text, wrong):
    with pytest.raises(InputError, match=wrong):
        parse_fault(text)


def test_every_kind_can_be_written():
    for kind, (_, unit) in KINDS.items():
        joint = '' if kind in ('silence', 'busoff') else ':joint_1a'
        fault = parse_fault(f'{kind}{joint}@1.5+2{"=3" if unit else ""}')
        assert (fault.kind, fault.start, fault.end) == (kind, 1.5, 3.5)
        assert fault.active(1.5) and not fault.active(3.5)
