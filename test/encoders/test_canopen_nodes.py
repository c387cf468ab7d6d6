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

    def state(now):
        """Return the trouble and the caution of node 2, and its figures."""
        node = taker.network.nodes[1]
        figures = node.statistics(T0 + now)
        return (node.trouble(T0 + now), node.caution(T0 + now),
                *(figures[f'joint_1b {name}'] for name in ('node 2', 'boot-ups', 'EMCY')))

    none = 'none (0 messages)'
    assert state(0.0) == (None, None, 'unknown, no heartbeat yet', 0, none)
    # Boot-up, in pre-operational, then operational: bit 7 is not the state's.
    taker.feed(heard(0x702, b'\x00', 0.1))
    assert state(0.2) == ('booting', None, 'booting, no heartbeat yet', 1, none)
    taker.feed(heard(0x702, b'\x7F', 0.2))
    assert state(0.25)[:3] == (
        'pre-operational', None, 'pre-operational, heartbeat 50 ms ago')
    taker.feed(heard(0x702, b'\x85', 0.25))
    # A heartbeat is lost after its timeout, not at it.
    assert state(0.5) == (None, None, 'operational, heartbeat 250 ms ago', 1, none)
    assert state(0.51) == ('heartbeat lost', 'heartbeat lost',
                           'operational, heartbeat 260 ms ago (lost)', 1, none)
    # An emergency comes first, until it is reset.
    taker.feed(heard(0x82, EMERGENCY, 0.6))
    assert state(0.6)[:2] == (WORDS, WORDS)
    assert state(0.6)[4] == f'{WORDS} (1 messages)'
    taker.feed(heard(0x84, EMERGENCY, 0.6))
    assert taker.caution(T0 + 0.6) == f'joint_1b: {WORDS}; joint_3a: {WORDS}'
    taker.feed(heard(0x82, bytes(8), 0.7))
    assert state(0.7)[4] == 'none (2 messages)'
    assert taker.caution(T0 + 0.7) \
        == f'joint_1b: heartbeat lost; joint_3a: {WORDS}'
    # A reboot ends emergency and supervision.
    taker.feed(heard(0x82, EMERGENCY, 0.8))
    taker.feed(heard(0x702, b'\x00', 0.9))
    assert state(9.0) == ('booting', None, 'booting, no heartbeat yet', 2, 'none (3 messages)')
