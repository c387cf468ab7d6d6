# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The reason that is reported while no sets come, and the problems while they do."""

import can
from encoder_frames import answer, sync, T0
import pytest
from scripted_bus import cycles, error_frame, node_frame, REASON_HOLD, run
from spm_haptic_master.encoders import canopen


def test_a_reason_is_held_before_another_takes_its_place(rig):
    script = [*cycles(0.01, 1), *cycles(0.02, 200, without=(2,))]
    driver = rig(script, can__timeout=0.05)
    run(driver, 0.1)
    assert driver.fault == 'joint_1c silent (no frames)'
    run(driver, 2.02 + 0.06)
    # The bus is silent, and the reason is not yet replaced: it was read at 0.1 s, long ago.
    assert driver.fault == 'no frames on virtual can7'
    bus = driver.buses[0]
    now = driver.clock.now
    bus.script = cycles(now, 400, without=(1,))
    run(driver, now + 0.5 * REASON_HOLD)
    assert driver.fault == 'no frames on virtual can7'
    run(driver, now + REASON_HOLD + 0.01)
    assert driver.fault == 'joint_1b silent (no frames)'
    # Sets end it at once, and the next reason is new at once.
    now = driver.clock.now
    bus.script = [*cycles(now, 5), *cycles(now + 0.05, 30, without=(3,))]
    run(driver, now + 0.05)
    assert driver.fault is None
    run(driver, now + 0.3)
    assert driver.fault == 'joint_3a silent (no frames)'


def without_sync(script):
    return [entry for entry in script if entry[1].arbitration_id != 0x80]


def beside(script, *others):
    """Return a script with a frame of other nodes behind each cycle."""
    return script + [
        node_frame(0.0102 + 0.01 * n, identifier, bytes(1 if identifier > 0x700 else 4))
        for n in range(20) for identifier in others]


ALL = range(4)
NO_SYNC = 'no SYNC 0x80 on virtual can7: no other master makes it, and can.sync is consume; '
OTHERS = ' (no frames); on the bus, and not in encoders.node_id: {} (can_scan prints the lines ' \
    'for rig.yaml)'


@pytest.mark.parametrize(('script', 'until', 'fault'), [
    ([node_frame(0.01 * n, 0x701, b'\x05') for n in range(1, 9)], 0.08,
     NO_SYNC + 'give -p can.sync:=produce to make it here'),
    (without_sync(cycles(0.01, 20, without=(3,))), 0.02,
     NO_SYNC + 'the encoders send without SYNC: give -p encoders.sync_id:=0'),
    ([error_frame(0.01 * n, 0x20) for n in range(1, 9)], 0.085,
     'virtual can7: no acknowledge (is any other node on the bus?)'),
    # Bus-off is the reason until an encoder is heard; another error frame explains none then.
    ([*cycles(0.01, 1), error_frame(0.02, 0x40), error_frame(0.03, 0x100)], 0.19,
     'virtual can7: bus-off'),
    ([*cycles(0.01, 1), error_frame(0.02, 0x40), *cycles(0.2, 1, without=(0, 1))], 0.7,
     'no frames on virtual can7'),
    ([*cycles(0.01, 10, without=(2,)), error_frame(0.1011, 0x88)], 0.11,
     'joint_1c silent (no frames)'),
    (cycles(0.01, 20, without=ALL), 0.2, 'all encoders silent (no frames)'),
    # Heartbeats or TPDOs of nodes that are not configured: the node ids are wrong.
    (beside(cycles(0.01, 20, without=ALL), 0x72C, 0x709), 0.21,
     'all encoders silent' + OTHERS.format('9, 44')),
    (beside(cycles(0.01, 20, without=(3,)), 0x189), 0.21, 'joint_3a silent' + OTHERS.format(9)),
    # Every encoder is heard, but never all four in a window: the assembler's cause.
    ([*cycles(0.01, 20, without=(3,)), *((0.0199 + 0.01 * n, answer(3, T0 + 0.0199 + 0.01 * n))
                                         for n in range(20))], 0.2,
     'answer from joint_3a outside the window'),
    ([*((0.001, answer(index, T0 + 0.001)) for index in ALL), (0.002, sync(T0 + 0.002))], 0.01,
     'frames on virtual can7, but no set of four encoders'),
])
def test_a_reason_is_given_while_no_sets_come(rig, script, until, fault):
    driver = rig(script)
    run(driver, until)
    assert driver.fault == fault


def test_where_the_bus_has_no_sync_none_is_missed(rig):
    driver = rig(without_sync(cycles(0.01, 20, without=(3,))), encoders__sync_id=0)
    run(driver, 0.2)
    assert driver.fault == 'joint_3a silent (no frames)'


def test_another_rate_of_sync_is_a_caution(rig):
    driver = rig(cycles(0.01, 300), rate=1000.0, encoders__window=0.003)  # every 10 ms
    assert len(run(driver, 2.5)) > 200
    assert driver.fault is None
    assert driver.caution.startswith('SYNC comes at 100 Hz, rate is 1000 Hz: ')


def test_emergencies_are_the_reason_where_they_stop_the_sets(rig):
    emergency = canopen.emcy(4, 0x5000, 1)
    emergency.timestamp = T0 + 0.02
    for stops in (True, False):
        driver = rig([(0.02, emergency)], can__emcy_stops=stops)
        begin = driver.clock.now
        driver.buses[0].script = [*cycles(begin + 0.01, 1), (begin + 0.02, emergency),
                                  *cycles(begin + 0.03, 8)]
        got = run(driver, begin + 0.11)
        words = 'joint_3a: EMCY 0x5000 device hardware, error register 0x01'
        assert driver.fault == (words if stops else None)
        assert driver.caution == words
        assert len(got) == (1 if stops else 9)
        assert driver.statistics().get(f'dropped: {words}', 0) == (8 if stops else 0)


def test_a_producer_hears_syncs_and_opens_cycles_before_other_frames(producing):
    answers = [answer(index, T0 + 0.0105) for index in range(4)]
    driver, producer = producing([(0.005, sync(T0 + 0.005)),
                                  *((0.0105, message) for message in answers)])
    producer.opening = [T0 + 0.0102]
    (sample,) = run(driver, 0.02)
    assert sample.stamp == pytest.approx((T0 + 0.0102) * 1e9, abs=1000)
    assert producer.calls[:3] == ['start', ('heard', T0 + 0.005), ('openings', T0 + 0.0105)]


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
    assert (producer.sync_id, producer.period, producer.calls) == (0x80, 1e-3, [])
    run(driver, 0.3)
    assert producer.calls == ['start', 'stop', 'start']
    producer.lost, producer.foreign = 0.25, 5
    assert driver.lost == 0.25 and driver.statistics()["another master's SYNC"] == 5
    assert driver.caution is None
    producer.yielding = True
    assert driver.caution == 'another master makes SYNC: this driver follows it and makes none'
    driver.close()
    assert producer.calls[-1] == 'stop'
    # Its own frames are asked for, where the interface can.
    assert [own for *_, own in driver.opened] == [True, True]


@pytest.mark.parametrize(('missed', 'present'), [(1, ()), (2, ()), (3, ()), (5, ()), (1, (0,)),
                                                 (1, (1, 3))])
def test_answers_that_are_missing_at_the_start_are_not_waited_for_for_ever(rig, missed, present):
    """Encoders that come up during a cycle: each later answer was taken for the one before."""
    script = [*cycles(0.01, missed, without=set(range(4)) - set(present)),
              *cycles(0.01 * (missed + 1), 100)]
    assert len(run(rig(script), 0.01 * (missed + 101))) > 90
