# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated encoders on a bus: their states, and each injected fault while it lasts."""

from encoder_frames import LAYOUTS, values
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.simulation.fault_injection import KINDS, parse_fault
from spm_haptic_master.simulation.settings import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.simulation.simulated_nodes import SimulatedNode


def test_a_node_walks_through_its_states_and_says_what_it_is():
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
    (answer,) = node.receive(canopen.sdo_upload(3, *canopen.DEVICE_TYPE))
    assert answer.arbitration_id == 0x583
    assert canopen.sdo_value(answer.data) & 0xFFFF == 406
    assert node.receive(canopen.sdo_upload(3, 0x2000, 0))[0].data[0] == canopen.SDO_ABORT
    assert node.receive(canopen.sdo_upload(2, *canopen.DEVICE_TYPE)) == []


def played(*faults):
    """Return simulated encoders, started, and a function for the angles at a time."""
    settings = values('sim', sim__noise_deg=0.0, sim__trajectory='fixed')
    bus = SimulatedBus(LAYOUTS, (1, 2, 3, 4), make_motion(settings),
                       tuple(map(parse_fault, faults)), 10.0, 1)
    bus.boot()
    for node_id in (1, 2, 3, 4):
        bus.receive(canopen.nmt(canopen.NMT_START, node_id))

    def at(t):
        others = bus.tend(t)
        answers = {message.arbitration_id - 0x181: message.data for message in bus.cycle(t)}
        return {index: LAYOUTS[index].angle(LAYOUTS[index].counts(data))
                for index, data in answers.items()}, others

    at(0.0)
    return at


TRUE = played()(0.0)[0]


@pytest.mark.parametrize(('fault', 'during'), [
    ('dropout:joint_1b@1+1', {1: None}), ('silence@1+1', dict.fromkeys(range(4))),
    ('busoff@1+1', dict.fromkeys(range(4))), ('offset:joint_3a@1+1=2', {3: 0.034907}),
    ('jump:joint_1a@1+1=-5', {0: -0.087266}), ('reboot:joint_1c@1+1', {2: None}),
    ('unplug:joint_1c@1+1', {2: None})])
def test_faults_do_what_they_say_and_end(fault, during):
    at = played(fault)
    for t, expected in ((0.5, {}), (1.5, during), (2.5, {})):
        angles, _ = at(t)
        if t == 2.5 and fault.startswith('reboot'):
            expected = {2: None}  # booted, and not started again
        assert angles == {index: pytest.approx(TRUE[index] + expected.get(index, 0.0), abs=4e-4)
                          for index in range(4) if expected.get(index, 0.0) is not None}


def test_a_jump_is_one_answer():
    at = played('jump:joint_1a@1=5')
    assert at(1.0)[0][0] != pytest.approx(TRUE[0], abs=0.01)
    assert at(1.001)[0][0] == pytest.approx(TRUE[0], abs=1e-3)


def test_late_answers_come_at_once_when_the_fault_ends():
    at = played('late:joint_1b@1+1=0.25')
    at(1.0)
    assert [len(sum(map(list, at(1.125 + 0.125 * number)), [])) for number in range(3)] \
        == [3, 4, 4]
    assert len(at(2.0)[1]) == 2
    assert len(at(2.1)[0]) == 4


def test_lost_answers_are_as_many_as_asked_for():
    at = played('loss:joint_1c@0=10')
    counts = [len(at(1e-3 * number)[0]) for number in range(4000)]
    assert 300 < counts.count(3) < 500 and counts.count(3) + counts.count(4) == 4000


def test_emergency_and_its_reset_and_boot_up_are_sent():
    at = played('emcy:joint_1b@1+1=0x8130', 'reboot:joint_3a@3+1')
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
