# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen nodes as the driver follows them."""

from encoder_frames import decoder, T0
from spm_haptic_master.encoders import canopen

WORDS = 'EMCY 0x5000 device hardware, error register 0x01'
EMERGENCY = bytes((0x00, 0x50, 0x01, 0, 0, 0, 0, 0))


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
    assert started(0.0, 0, 2) == started(0.1, 0, 2) == []
    # A node that boots again and again, as in a recording in a loop, is started once.
    for _ in range(3):
        taker.feed(heard(0x703, b'\x00', 0.15))
    assert started(0.15, 2) == [3]
    assert started(0.499, 0, 2) == []
    assert started(0.5, 0, 2) == [1]
    # A clock set back does not delay the next start.
    assert started(-3.0, 0, 2) == [1, 3]


def test_nodes_are_followed_by_heartbeat_boot_up_and_emergency():
    taker = decoder(can__heartbeat_timeout=0.25)
    node = taker.network.nodes[1]
    beats = 'operational, heartbeat '
    for at, identifier, data, now, trouble, caution, state, emergency in (
            (0.0, 0x701, b'\x05', 0.0, None, None, 'unknown, no heartbeat yet', 'none (0'),
            # Boot-up, then operational: bit 7 is not the state's.
            (0.1, 0x702, b'\x00', 0.2, 'booting', None, 'booting, no heartbeat yet', 'none (0'),
            (0.25, 0x702, b'\x85', 0.3, None, None, beats + '50 ms ago', 'none (0'),
            # A heartbeat is lost after its timeout, not at it.
            (0.25, 0x702, b'\x85', 0.5, None, None, beats + '250 ms ago', 'none (0'),
            (0.25, 0x702, b'\x85', 0.51, *('heartbeat lost',) * 2, beats + '260 ms ago (lost)',
             'none (0'),
            # An emergency comes first, until it is reset or the node boots.
            (0.6, 0x82, EMERGENCY, 0.6, WORDS, WORDS, beats + '350 ms ago (lost)', WORDS + ' (1'),
            (0.7, 0x82, bytes(8), 0.7, *('heartbeat lost',) * 2, beats + '450 ms ago (lost)',
             'none (2'),
            (0.8, 0x82, EMERGENCY, 0.8, WORDS, WORDS, beats + '550 ms ago (lost)', WORDS + ' (3'),
            (0.9, 0x702, b'\x00', 9.0, 'booting', None, 'booting, no heartbeat yet', 'none (3')):
        taker.feed(heard(identifier, data, at))
        assert (node.trouble(T0 + now), node.caution(T0 + now)) == (trouble, caution)
        assert node.statistics(T0 + now) == {
            'joint_1b node 2': state, 'joint_1b boot-ups': (at >= 0.1) + (at >= 0.9),
            'joint_1b EMCY': emergency + ' messages)'}
