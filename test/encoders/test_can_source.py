# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bus that is opened, fails and is reopened; what goes out on it, and which reason is given."""

from unittest.mock import call, Mock

import can
from encoder_frames import answer, sync, T0
import pytest
from scripted_bus import cycles, error_frame, node_frame, opening_of, run
from spm_haptic_master.encoders import canopen

# What a user is promised, s: first time between attempts to open a bus, silence after which it is
# reopened, polls, the time that a reason holds.
REOPEN_FIRST = 0.1
REOPEN_SILENT = 2.0
POLL_PERIOD = 0.02
REASON_HOLD = 0.5


def stamps(*times):
    return [pytest.approx((T0 + at) * 1e9, abs=1000) for at in times]


def test_sets_arrive_with_syncs_receive_time(rig):
    driver = rig(cycles(0.05, 3))
    assert driver.fault == 'virtual can7: not opened yet'
    assert [sample.stamp for sample in run(driver, 0.1)] == stamps(0.05, 0.06, 0.07)
    assert driver.fault is driver.caution is None
    figures = driver.statistics()
    assert (figures['bus'], figures['bus opened']) == ('virtual can7', 1)
    assert 'last send refused' not in figures
    assert 'SYNC sent' not in figures


def test_a_read_ends_at_its_timeout_and_polls_in_between(rig):
    driver = rig(())
    assert driver.read(0.05) is None
    assert driver.clock.now == pytest.approx(0.05, abs=1e-5)
    waits = driver.buses[0].waits
    assert max(waits) <= POLL_PERIOD + 1e-9
    assert len(waits) <= 5


def test_opening_is_tried_again_with_back_off_and_soon_after_frames(rig):
    broken = can.CanInitializationError('no such device\nTraceback ...')
    driver = rig(*[broken] * 7, [*cycles(8.0, 1), (9.0, broken)], broken)
    assert run(driver, 7.0) == []
    # In one line, whatever python-can's error has.
    assert driver.fault == 'virtual can7: no such device'
    assert driver.statistics()['bus opened'] == 0
    run(driver, 9.5)
    assert [at for at, *_ in driver.opened] == pytest.approx(
        [0.0, 0.1, 0.3, 0.7, 1.5, 3.1, 5.1, 7.1, 9.1, 9.3]
    )


@pytest.mark.parametrize(
    'error',
    [
        can.CanOperationError(''),
        OSError('Network is down'),
        ValueError('bad'),
        ImportError('no x'),
    ],
)
def test_each_kind_of_bus_error_is_survived(rig, error):
    driver = rig([(0.01, error)], cycles(0.2, 5))
    shutdown = driver.buses[0].shutdown = Mock(side_effect=OSError('gone for good'))
    assert run(driver, 0.05) == []
    assert driver.fault == f'virtual can7: {str(error) or "CanOperationError"}'
    assert shutdown.call_count == 1
    assert len(run(driver, 0.25)) == 5
    assert driver.fault is None
    assert [at for at, *_ in driver.opened] == pytest.approx([0.0, 0.01 + REOPEN_FIRST])
    assert driver.statistics()['bus opened'] == 2


def test_a_bus_that_dies_without_a_word_is_opened_again(rig):
    """An interface that went and came back leaves its old socket silent for ever."""
    driver = rig(cycles(0.01, 2), (), cycles(5.0, 2))
    assert len(run(driver, 4.9)) == 2
    assert driver.fault == 'no frames on virtual can7'
    # After its last frame, or silent from the start.
    _, *opened = [at for at, *_ in driver.opened]
    for last, again in zip((0.02, opened[0]), opened, strict=True):
        assert 0.0 < again - last - REOPEN_SILENT < 2 * POLL_PERIOD
    assert driver.buses[0].shut == 1
    assert len(run(driver, 5.1)) == 2


@pytest.mark.parametrize(
    ('start', 'again'),
    [
        (T0, T0),
        (5000.0, 1.0),
    ],
)
def test_a_reopened_bus_starts_a_new_cycle_and_a_new_clock(rig, start, again):
    """No answer joins a SYNC from before the break; a device may count from another start."""
    first = cycles(0.01, 2)[:8]
    second = [*cycles(0.19, 1)[3:], *cycles(0.2, 1)]
    for script, begin in ((first, start), (second, again)):
        for _, message in script:
            message.timestamp += begin - T0
    driver = rig([*first, (0.05, OSError('gone'))], second)
    assert [sample.stamp for sample in run(driver, 0.3)] == stamps(0.01, 0.2)
    assert driver.statistics()['rejected: before the first SYNC'] == 2


def test_silent_and_booting_nodes_are_started(rig):
    driver = rig(
        [
            *cycles(0.005, 25, without=(1,)),
            *cycles(0.255, 15, without=(1, 2)),
            *cycles(0.405, 80, without=(1,)),
            node_frame(0.3511, 0x703, b'\x00'),
        ]
    )
    run(driver, 1.19)
    starts = [
        (at, *message.data[1:])
        for at, message in driver.buses[0].sent
        if bytes(message.data[:1]) == bytes((canopen.NMT_START,))
    ]
    # All four before any was heard; node 2 every half second; node 3 when it has booted.
    assert starts[:4] == [(0.0, 1), (0.0, 2), (0.0, 3), (0.0, 4)]
    assert [node for _, node in starts[4:]] == [3, 2, 2]
    assert 0.0 < starts[4][0] - 0.3511 <= POLL_PERIOD
    for place, expected in ((5, 0.5), (6, 1.0)):
        assert -1e-6 < starts[place][0] - expected < 3 * POLL_PERIOD


def test_a_refused_start_is_reported_and_not_fatal(rig):
    driver = rig(())
    driver.buses[0].refusal = can.CanOperationError('Transmit buffer full\nmore')
    run(driver, 0.1)
    assert driver.fault == 'no frames on virtual can7 (sending: Transmit buffer full)'
    assert driver.statistics()['last send refused'] == 'Transmit buffer full'
    driver.buses[0].refusal = None
    run(driver, 0.7)
    assert driver.fault == 'no frames on virtual can7'
    assert 'last send refused' not in driver.statistics()


@pytest.mark.parametrize('stop', [True, False])
def test_closing_stops_the_nodes_where_configured(rig, stop):
    driver = rig(cycles(0.01, 1), can__nmt_stop=stop)
    driver.close()
    assert driver.opened == []
    run(driver, 0.05)
    bus = driver.buses[0]
    bus.sent.clear()
    driver.close()
    driver.close()
    assert bus.shut == 1
    assert [tuple(message.data) for _, message in bus.sent] == [
        (canopen.NMT_STOP, node_id) for node_id in (1, 2, 3, 4) if stop
    ]


def test_a_reason_is_held_before_another_takes_its_place(rig):
    driver = rig(
        [
            *cycles(0.01, 40, without=(2,)),
            *cycles(0.41, 60, without=(1,)),
            *cycles(1.01, 5),
            *cycles(1.06, 30, without=(3,)),
        ],
        can__timeout=0.05,
    )
    # Sets end a reason at once, and the next one is new at once.
    for until, silent in (
        (0.3, '1c'),
        (0.3 + 0.9 * REASON_HOLD, '1c'),
        (0.31 + REASON_HOLD, '1b'),
        (1.055, None),
        (1.3, '3a'),
    ):
        run(driver, until)
        assert driver.fault == (silent and f'joint_{silent} silent (no frames)')


def beside(script, *others):
    """Return a script with a frame of other nodes behind each cycle."""
    return script + [
        node_frame(0.0102 + 0.01 * n, identifier, bytes(1 if identifier > 0x700 else 4))
        for n in range(20)
        for identifier in others
    ]


ALL = range(4)
NO_SYNC = 'no SYNC 0x80 on virtual can7: no other master makes it, and can.sync is consume; '
OTHERS = (
    ' (no frames); on the bus, and not in encoders.node_id: {} (can_scan prints the lines '
    'for rig.yaml)'
)


@pytest.mark.parametrize(
    ('script', 'until', 'fault'),
    [
        (
            [node_frame(0.01 * n, 0x701, b'\x05') for n in range(1, 9)],
            0.08,
            NO_SYNC + 'give -p can.sync:=produce to make it here',
        ),
        (
            opening_of(cycles(0.01, 20, without=(3,)))[1],
            0.02,
            NO_SYNC + 'the encoders send without SYNC: give -p encoders.sync_id:=0',
        ),
        (
            [error_frame(0.01 * n, 0x20) for n in range(1, 9)],
            0.085,
            'virtual can7: no acknowledge (is any other node on the bus?)',
        ),
        # Bus-off is the reason until an encoder is heard; another error frame explains none then.
        (
            [*cycles(0.01, 1), error_frame(0.02, 0x40), error_frame(0.03, 0x100)],
            0.19,
            'virtual can7: bus-off',
        ),
        (
            [*cycles(0.01, 1), error_frame(0.02, 0x40), *cycles(0.2, 1, without=(0, 1))],
            0.7,
            'no frames on virtual can7',
        ),
        (
            [*cycles(0.01, 10, without=(2,)), error_frame(0.1011, 0x88)],
            0.11,
            'joint_1c silent (no frames)',
        ),
        (cycles(0.01, 20, without=ALL), 0.2, 'all encoders silent (no frames)'),
        # Heartbeats or TPDOs of nodes that are not configured: the node ids are wrong.
        (
            beside(cycles(0.01, 20, without=ALL), 0x72C, 0x709),
            0.21,
            'all encoders silent' + OTHERS.format('9, 44'),
        ),
        (
            beside(cycles(0.01, 20, without=(3,)), 0x189),
            0.21,
            'joint_3a silent' + OTHERS.format(9),
        ),
        # Every encoder is heard, but never all four in a window: the assembler's cause.
        (
            [
                *cycles(0.01, 20, without=(3,)),
                *((0.0199 + 0.01 * n, answer(3, T0 + 0.0199 + 0.01 * n)) for n in range(20)),
            ],
            0.2,
            'answer from joint_3a outside the window',
        ),
        (
            [*((0.001, answer(index, T0 + 0.001)) for index in ALL), (0.002, sync(T0 + 0.002))],
            0.01,
            'frames on virtual can7, but no set of four encoders',
        ),
    ],
)
def test_a_reason_is_given_while_no_sets_come(rig, script, until, fault):
    driver = rig(script)
    run(driver, until)
    assert driver.fault == fault


def test_where_the_bus_has_no_sync_and_no_nodes_none_is_missed_or_started(rig):
    driver = rig(
        opening_of(cycles(0.01, 20, without=(3,)))[1], encoders__sync_id=0, can__protocol='raw'
    )
    run(driver, 0.2)
    assert driver.fault == 'joint_3a silent (no frames)'
    assert driver.buses[0].sent == []


def test_another_rate_of_sync_is_a_caution(rig):
    driver = rig(cycles(0.01, 300), rate=1000.0, encoders__window=0.003)  # every 10 ms
    assert len(run(driver, 2.5)) > 200
    assert driver.fault is None
    assert driver.caution.startswith('SYNC comes at 100 Hz, rate is 1000 Hz: ')


@pytest.mark.parametrize('stops', [True, False])
def test_emergencies_are_the_reason_where_they_stop_the_sets(rig, stops):
    emergency = (0.02, canopen.emcy(4, 0x5000, 1))
    driver = rig([*cycles(0.01, 1), emergency, *cycles(0.03, 8)], can__emcy_stops=stops)
    words = 'joint_3a: EMCY 0x5000 device hardware, error register 0x01'
    assert len(run(driver, 0.11)) == (1 if stops else 9)
    assert (driver.fault, driver.caution) == (words if stops else None, words)
    assert driver.statistics().get(f'dropped: {words}', 0) == (8 if stops else 0)


def test_a_producer_hears_syncs_and_opens_cycles_before_other_frames(producing):
    answers = [answer(index, T0 + 0.0105) for index in range(4)]
    driver, producer = producing(
        [(0.005, sync(T0 + 0.005)), *((0.0105, message) for message in answers)]
    )
    producer.openings.side_effect = [[T0 + 0.0102], [], [], []]
    (sample,) = run(driver, 0.02)
    assert sample.stamp == pytest.approx((T0 + 0.0102) * 1e9, abs=1000)
    assert producer.method_calls[:4] == [
        call.start(),
        call.skip(),
        call.heard(T0 + 0.005),
        call.openings(T0 + 0.0105),
    ]


@pytest.mark.parametrize(
    ('left_out', 'attempts'),
    [
        (True, 1),
        (False, 3),
    ],
)
def test_no_sync_is_left_out_any_more_where_a_node_minded_one(producing, left_out, attempts):
    driver, producer = producing(
        [
            node_frame(0.01, 0x702, bytes((canopen.OPERATIONAL,))),
            node_frame(0.02, 0x702, bytes((canopen.PRE_OPERATIONAL,))),
        ]
    )
    producer.skip.return_value = left_out
    run(driver, 2.05)
    # At once, and each second.
    assert producer.skip.call_count == attempts


def test_a_sync_is_left_out_on_a_bus_without_nodes_too(producing):
    driver, producer = producing((), can__protocol='raw')
    producer.skip.return_value = True
    run(driver, 0.05)
    assert producer.skip.call_count == 1


def test_a_missing_sync_of_our_own_is_explained(producing):
    driver, producer = producing([node_frame(0.002 * n, 0x701, b'\x05') for n in range(1, 800)])
    run(driver, 0.1)
    missing = 'no SYNC 0x80 on virtual can7: '
    assert driver.fault == missing + 'listening for another master first'
    producer.producing = True
    run(driver, 0.1 + REASON_HOLD + 0.01)
    assert driver.fault == missing + 'this machine is too busy to make it in time'
    driver.buses[0].refusal = can.CanOperationError('full')
    run(driver, 0.1 + 2.0 * REASON_HOLD + 0.05)
    assert driver.fault == missing + 'sending: full'


def test_a_producer_starts_with_each_bus_and_its_figures_are_in_the_statistics(producing):
    driver, producer = producing([(0.05, OSError('gone'))], ())
    assert (producer.made_with['sync_id'], producer.made_with['period']) == (0x80, 1e-3)
    assert producer.method_calls == []
    run(driver, 0.3)
    assert producer.method_calls == [call.start(), call.skip(), call.stop(), call.start()]
    producer.lost = 0.25
    producer.statistics.return_value = {'SYNC sent': 5}
    assert driver.lost == 0.25
    assert driver.statistics()['SYNC sent'] == 5
    assert driver.caution is None
    producer.yielding = True
    assert driver.caution == 'another master makes SYNC: this driver follows it and makes none'
    driver.close()
    assert producer.method_calls[-1] == call.stop()
    # Its own frames are asked for, where the interface can.
    assert [own for *_, own in driver.opened] == [True, True]
