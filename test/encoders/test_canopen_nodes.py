# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen nodes as the driver follows them, and as the simulation plays them."""

from encoder_frames import decoder, LAYOUTS, T0, values
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.simulation.fault_injection import KINDS, parse_fault
from spm_haptic_master.simulation.settings import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.simulation.simulated_nodes import SimulatedNode


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


def test_boot_ups_that_nobody_answers_are_not_collected():
    """A recording in a loop, in which a node boots again and again, starts none."""
    taker = decoder()
    for number in range(1000):
        taker.feed(heard(0x702, b'\x00', 0.001 * number))
    assert len(taker.network._booted) == 1
    assert taker.network.nodes[1].boot_ups == 1000


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
    assert nodes.cautions(T0) == {}
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
    assert nodes.cautions(T0 + 0.49) == {}
    assert nodes.cautions(T0 + 0.51) == {1: 'heartbeat lost'}
    assert nodes.trouble(1, T0 + 0.51) == 'heartbeat lost'
    assert figures(0.55)['node 2'] == 'operational, heartbeat 250 ms ago (lost)'
    # An emergency comes first, until it is reset.
    taker.feed(heard(0x82, bytes((0x00, 0x50, 0x01, 0, 0, 0, 0, 0)), 0.6))
    words = 'EMCY 0x5000 device hardware, error register 0x01'
    assert nodes.trouble(1, T0 + 0.6) == words
    assert nodes.emergencies() == {1: words}
    assert nodes.cautions(T0 + 0.6) == {1: words}
    assert figures(0.6)['EMCY'] == f'{words} (1 messages)'
    taker.feed(heard(0x82, bytes(8), 0.7))
    assert nodes.emergencies() == {}
    assert figures(0.7)['EMCY'] == 'none (2 messages)'
    # A reboot ends emergency and supervision.
    taker.feed(heard(0x82, bytes((0x00, 0x50, 0x01, 0, 0, 0, 0, 0)), 0.8))
    taker.feed(heard(0x702, b'\x00', 0.9))
    assert nodes.emergencies() == {}
    assert nodes.cautions(T0 + 9.0) == {}
    assert node.boot_ups == 2
    assert [other.boot_ups for other in nodes.nodes] == [0, 2, 0, 0]


def test_a_heartbeat_at_its_timeout_is_not_lost():
    taker = decoder(can__heartbeat_timeout=0.25)
    message = canopen.frame(0x702, b'\x05')
    message.timestamp = 64.0
    taker.feed(message)
    assert taker.network.cautions(64.25) == {}
    assert taker.network.cautions(64.26) == {1: 'heartbeat lost'}


def test_two_nodes_in_trouble_are_both_named():
    taker = decoder()
    for node_id in (1, 4):
        taker.feed(heard(0x80 + node_id, bytes((0x00, 0x50, 0x01, 0, 0, 0, 0, 0)), 0.0))
    words = 'EMCY 0x5000 device hardware, error register 0x01'
    assert taker.caution(T0) == f'joint_1a: {words}; joint_3a: {words}'


def played(*faults):
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


TRUE = played()(0.0)[0]


@pytest.mark.parametrize(('fault', 'during'), [
    ('dropout:joint_1b@1+1', {1: None}), ('silence@1+1', dict.fromkeys(range(4))),
    ('busoff@1+1', dict.fromkeys(range(4))), ('offset:joint_3a@1+1=2', {3: 0.034907}),
    ('jump:joint_1a@1+1=-5', {0: -0.087266}), ('reboot:joint_1c@1+1', {2: None})])
def test_faults_do_what_they_say_and_end(fault, during):
    at = played(fault)
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
    at = played('jump:joint_1a@1=5')
    assert at(1.0)[0][0] != pytest.approx(TRUE[0], abs=0.01)
    assert at(1.001)[0][0] == pytest.approx(TRUE[0], abs=1e-3)


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
