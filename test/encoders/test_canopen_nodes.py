# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is known of a node by its own messages, what it is asked, and what it says of SYNC."""

import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes, Node, SUPERVISES_SYNC

REGISTER = canopen.ERROR_REGISTER
SERIAL = canopen.SERIAL_NUMBER
EMERGENCY = 'EMCY 0x5000 device hardware, error register 0x01'


def nodes_of(*messages, timeout=10.0, **fields):
    """Return two nodes, 1 and 2, after messages."""
    nodes = CanopenNodes(('joint_1a', 'joint_1b'), (1, 2), timeout, **fields)
    for message in messages:
        assert nodes.take(message) is None
    return nodes


def heartbeat(at, state, node_id=1):
    return canopen.frame(canopen.HEARTBEAT_BASE + node_id, bytes((state,)), at)


def emergency(at, code):
    message = canopen.emcy(1, code, 1)
    message.timestamp = at
    return message


@pytest.mark.parametrize(
    ('before', 'message', 'supervises'),
    [
        # A SYNC is left out at 100 s; a heartbeat shows within 1.5 s whether a node minds it.
        (canopen.OPERATIONAL, heartbeat(99.9, canopen.PRE_OPERATIONAL), False),
        (canopen.OPERATIONAL, heartbeat(100.0, canopen.PRE_OPERATIONAL), True),
        (canopen.OPERATIONAL, heartbeat(101.49, canopen.PRE_OPERATIONAL), True),
        (canopen.OPERATIONAL, heartbeat(101.5, canopen.PRE_OPERATIONAL), False),
        (canopen.OPERATIONAL, heartbeat(100.1, canopen.STOPPED), True),
        (canopen.OPERATIONAL, heartbeat(100.1, canopen.OPERATIONAL), False),
        # A reboot has another cause, and a node that was not operational cannot leave that state.
        (canopen.OPERATIONAL, heartbeat(100.1, canopen.BOOT_UP), False),
        (canopen.PRE_OPERATIONAL, heartbeat(100.1, canopen.STOPPED), False),
        (canopen.OPERATIONAL, emergency(100.1, 0x8100), True),
        (canopen.PRE_OPERATIONAL, emergency(100.1, 0x8130), True),
        (canopen.OPERATIONAL, emergency(100.1, 0x8220), False),
        (canopen.OPERATIONAL, emergency(100.1, 0x5000), False),
        (canopen.OPERATIONAL, emergency(99.9, 0x8100), False),
    ],
)
def test_a_node_that_minds_a_sync_left_out_supervises_it(before, message, supervises):
    nodes = nodes_of(heartbeat(99.0, before))
    nodes.left_out_sync(100.0)
    nodes.take(message)
    assert nodes.supervise_sync is supervises
    assert nodes.nodes[0].supervises_sync is supervises
    assert not nodes.nodes[1].supervises_sync


def test_without_a_sync_left_out_no_node_supervises_it():
    nodes = nodes_of(heartbeat(99.0, canopen.OPERATIONAL), emergency(99.5, 0x8100))
    assert not nodes.supervise_sync


def test_that_a_node_supervises_sync_is_behind_its_other_trouble():
    node = nodes_of(heartbeat(99.0, canopen.STOPPED)).nodes[0]
    node.supervises_sync = True
    assert node.caution_with_sync(99.0) == SUPERVISES_SYNC
    assert node.trouble(99.0) == f'stopped; {SUPERVISES_SYNC}'
    node.emergency = EMERGENCY
    assert node.caution_with_sync(99.0) == f'{EMERGENCY}; {SUPERVISES_SYNC}'
    node.supervises_sync = False
    assert node.caution_with_sync(99.0) == EMERGENCY
    node.supervises_sync = True
    node.emergency = None
    node.state = canopen.OPERATIONAL
    assert node.trouble(99.0) is None


def test_a_node_is_asked_each_second_and_three_times_for_an_object():
    node = Node('joint_1a', 1, 10.0)
    asked = []
    for tenth in range(100):
        wanted = node.wanted(0.1 * tenth)
        if wanted is not None:
            node.ask(wanted, 0.1 * tenth)
            asked.append((tenth, wanted))
    assert asked == [
        (0, REGISTER),
        (10, REGISTER),
        (20, REGISTER),
        (30, SERIAL),
        (40, SERIAL),
        (50, SERIAL),
    ]


def test_a_clock_set_back_does_not_delay_a_request():
    node = Node('joint_1a', 1, 10.0)
    node.ask(REGISTER, 100.0)
    assert node.wanted(100.9) is None
    assert node.wanted(50.0) == REGISTER


@pytest.mark.parametrize(
    ('answer', 'register', 'serial', 'next_wanted'),
    [
        (canopen.sdo_answer(1, *REGISTER, 0, 1), 0, None, SERIAL),
        (canopen.sdo_answer(1, *REGISTER, 0x11, 1), 0x11, None, SERIAL),
        # Only the lowest byte, where a device answers with four.
        (canopen.sdo_answer(1, *REGISTER, 0x1211), 0x11, None, SERIAL),
        # An abort: it has no such object.
        (canopen.sdo(0x581, canopen.SDO_ABORT, *REGISTER, 0x06020000), 0, None, SERIAL),
        (canopen.sdo_answer(1, *SERIAL, 4711), None, '4711', REGISTER),
        (canopen.sdo(0x581, canopen.SDO_ABORT, *SERIAL, 0x06020000), None, 'none', REGISTER),
        # Answers to others, and to a download.
        (canopen.sdo_answer(1, *canopen.VENDOR_ID, 9), None, None, REGISTER),
        (canopen.sdo(0x581, canopen.SDO_DOWNLOAD_ANSWER, *REGISTER), None, None, REGISTER),
    ],
)
def test_the_answers_of_a_node_are_kept(answer, register, serial, next_wanted):
    node = nodes_of(answer).nodes[0]
    assert (node.register, node.serial) == (register, serial)
    assert node.wanted(0.0) == next_wanted


@pytest.mark.parametrize(
    ('register', 'wanted'),
    [
        (0x10, REGISTER),
        (0, None),
    ],
)
def test_a_node_with_an_error_is_asked_until_it_has_none(register, wanted):
    node = nodes_of(
        canopen.sdo_answer(1, *REGISTER, register, 1),
        canopen.sdo_answer(1, *SERIAL, 4711),
    ).nodes[0]
    node.requests[REGISTER] = 50
    assert node.wanted(0.0) == wanted


@pytest.mark.parametrize(
    ('silent', 'asked'), [((), [1, 2]), ((0,), [1, 2]), ((1,), [1]), ((0, 1), [1])]
)
def test_a_node_that_was_never_heard_at_all_is_not_asked(silent, asked):
    nodes = nodes_of(heartbeat(0.0, canopen.OPERATIONAL))
    requests = nodes.to_ask(1.0, silent)
    assert [(node.node_id, wanted) for node, wanted in requests] == [
        (node_id, REGISTER) for node_id in asked
    ]
    assert nodes.to_ask(1.9, silent) == []


def test_a_boot_up_makes_a_node_unknown_again():
    node = nodes_of(
        emergency(1.0, 0x5000),
        canopen.sdo_answer(1, *REGISTER, 0x11, 1),
        canopen.sdo_answer(1, *SERIAL, 4711),
        heartbeat(2.0, canopen.OPERATIONAL),
    ).nodes[0]
    node.ask(REGISTER, 2.0)
    node.started_at = 2.0
    node.take(heartbeat(2.1, canopen.BOOT_UP))
    assert (node.emergency, node.register, node.serial, node.heard) == (None,) * 4
    assert node.requests[REGISTER] == 0
    assert node.wanted(2.1) == REGISTER
    assert node.started_at < 0.0
    assert node.boot_ups == 1


def test_the_worst_that_is_known_of_a_node_is_its_caution():
    node = nodes_of(
        heartbeat(0.0, canopen.OPERATIONAL),
        emergency(1.0, 0x5000),
        canopen.sdo_answer(1, *REGISTER, 0x04, 1),
    ).nodes[0]
    assert node.caution(20.0) == EMERGENCY
    node.emergency = None
    assert node.caution(20.0) == 'error register 0x04 (voltage)'
    node.register = 0
    assert node.caution(20.0) == 'heartbeat lost'
    assert node.caution(10.0) is None


@pytest.mark.parametrize(
    ('heard', 'started', 'unfit'),
    [(2.0, 1.0, 'pre-operational'), (2.0, 3.0, None), (None, 1.0, None)],
)
def test_a_state_counts_until_the_node_is_started(heard, started, unfit):
    node = Node('joint_1a', 1, 10.0, state=canopen.PRE_OPERATIONAL, heard=heard)
    node.started_at = started
    assert not node.unfit(4.0) if unfit is None else node.unfit(4.0) == unfit


@pytest.mark.parametrize(
    ('identifier', 'length', 'words'),
    [
        (0x081, 7, 'joint_1a EMCY'),
        (0x581, 7, 'joint_1a SDO answer'),
        (0x701, 0, 'joint_1a heartbeat'),
        (0x701, 2, 'joint_1a heartbeat'),
    ],
)
def test_a_frame_of_another_length_is_named_and_not_taken(identifier, length, words):
    nodes = nodes_of()
    assert nodes.take(canopen.frame(identifier, bytes(length))) == words
    node = nodes.nodes[0]
    assert (node.state, node.emergencies, node.register) == (None, 0, None)


@pytest.mark.parametrize(
    ('identifiers', 'listed'),
    [
        ([], None),
        ([0x705, 0x189, 0x2FF], '5, 9, 127'),
        # The nodes of the encoders and drives; no node; an identifier of no node's own frame.
        ([0x701, 0x182, 0x707], None),
        ([0x180, 0x700], None),
        ([0x085, 0x585, 0x605, 0x205], None),
    ],
)
def test_other_nodes_on_the_bus_are_listed(identifiers, listed):
    nodes = nodes_of(drives=(7,))
    for identifier in identifiers:
        nodes.note_other(identifier)
    expected = ''
    if listed:
        expected = (
            f'; on the bus, and not in encoders.node_id: {listed} '
            '(can_scan prints the lines for rig.yaml)'
        )
    assert nodes.others_text() == expected
