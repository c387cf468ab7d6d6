# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen words and the simulated nodes that speak them."""

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


@pytest.mark.parametrize(('data', 'words'), [
    ('0050010000000000', 'EMCY 0x5000 device hardware, error register 0x01'),
    ('1081110102000000', 'EMCY 0x8110 CAN overrun (objects lost), error register 0x11, '
                         'specific 01 02 00 00 00'),
    ('2042090000000000', 'EMCY 0x4220 device temperature, error register 0x09'),
    ('34FF810000000000', 'EMCY 0xFF34 device specific, error register 0x81'),
    ('0000000000000000', 'EMCY 0x0000 error reset, error register 0x00'),
    ('FFEE010000000000', 'EMCY 0xEEFF code not in CiA 301, error register 0x01'),
])
def test_emergencies_have_words(data, words):
    assert canopen.emcy_words(bytes.fromhex(data)) == words


@pytest.mark.parametrize(('identifier', 'data', 'words'), [
    (0x40, '', 'bus-off'), (0x100, '', 'controller restarted'),
    (0x04, '0030000000000000',
     'controller problem, receive error passive, transmit error passive'),
    (0x88, '', 'protocol violation, bus error'),
    (0x20, '', 'no acknowledge (is any other node on the bus?)'),
    (0x200, '', 'unknown error 0x200')])
def test_error_frames_have_words(identifier, data, words):
    assert error_words(can.Message(
        arbitration_id=identifier, is_error_frame=True, data=bytes.fromhex(data))) == words


@pytest.mark.parametrize(('answer', 'value'), [
    ('43 00 10 00 96 01 01 00', 0x00010196), ('4B 00 10 00 96 01 FF FF', 0x0196),
    ('4F 00 10 00 05 FF FF FF', 5), ('42 00 10 00 01 02 03 04', 0x04030201),
    ('80 00 10 00 00 00 02 06', None), ('60 00 10 00 00 00 00 00', None)])
def test_sdo_answers(answer, value):
    data = bytes.fromhex(answer)
    assert canopen.sdo_value(data) == value
    assert canopen.sdo_object(data) == (0x1000, 0)


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


def test_a_boot_up_calls_for_a_start_at_once_and_silence_not_too_often():
    taker = decoder()

    def started(at, *silent):
        return [node.node_id for node in taker.network.to_start(T0 + at, silent)]

    assert started(0.0, 0, 2) == [1, 3]
    assert started(0.1, 0, 2) == []
    boot = canopen.frame(0x703, b'\x00')
    boot.timestamp = T0 + 0.15
    taker.feed(boot)
    assert taker.network.booted
    assert started(0.15) == [3]
    assert not taker.network.booted
    assert started(0.55, 0, 2) == [1]


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
