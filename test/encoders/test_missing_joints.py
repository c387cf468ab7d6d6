# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A sensor that is not there: what becomes of its joint, of the set, and of the next sets."""

from math import isnan
import random

from encoder_frames import feed, PERIOD, T0
from marked_cycles import angle, by_cycle, cycle, rig, STATUS
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Cycles without an answer after which a joint is not waited for.
SILENT = 3
EMERGENCY = 'EMCY 0x5000 device hardware, error register 0x01'


def at(when, message):
    message.timestamp = T0 + when
    return message


@pytest.mark.parametrize(('sensors', 'gone'), [
    (5, {4}), (5, {0}), (6, {4}), (6, {5}), (6, {0, 1}), (6, {3, 4})])
def test_the_sets_go_on_without_a_silent_sensor_and_do_not_wait_for_it(sensors, gone):
    taker, layouts = rig(sensors)
    found = by_cycle(feed(taker, sum((cycle(layouts, number) for number in range(10)), [])))
    held = 0
    for number in range(10, 60):
        opening, *answers = cycle(layouts, number, gone)
        at_sync, at_answers = feed(taker, [opening]), feed(taker, answers)
        held += len(at_sync)
        found |= by_cycle(at_sync + at_answers)
        # It goes out with its last answer.
        assert len(at_answers) == (number >= 10 + SILENT)
    assert found == {number: gone if number >= 10 else set() for number in range(60)}
    assert held == SILENT == taker.assembler.counters['sets at the end of the cycle']
    assert taker.caution(T0 + 60 * PERIOD) == '; '.join(
        f'{ALL_JOINT_NAMES[index]}: no frames' for index in sorted(gone))


@pytest.mark.parametrize(('sensors', 'gone'), [
    (4, {3}), (4, {0}), (5, {0, 4}), (6, {0, 3, 5})])
def test_fewer_than_four_readings_are_no_set(sensors, gone):
    taker, layouts = rig(sensors)
    feed(taker, cycle(layouts, 0))
    assert sum((feed(taker, cycle(layouts, number, gone)) for number in range(1, 30)), []) == []
    names = ', '.join(ALL_JOINT_NAMES[index] for index in sorted(gone))
    assert taker.assembler.cause == f'no answer from {names}'
    # The 29th is not over.
    assert taker.assembler.counters['dropped sets'] == 29


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('silent', [1, 2, 3, 4, 20])
def test_a_sensor_is_taken_again_when_it_answers_again(sensors, silent):
    """One lost frame costs one reading, or with four one set."""
    for index in range(sensors) if silent == 1 else (3,):
        taker, layouts = rig(sensors)
        begin, back = 10, 10 + silent
        stream = [cycle(layouts, number, {index} if begin <= number < back else ())
                  for number in range(back + 20)]
        found = by_cycle(feed(taker, sum(stream, [])))
        # Until its late answers would have come, what comes may be one of them.
        lost = range(begin, back + (0 if silent == 1 else 3))
        assert found == {n: {index} if n in lost else set() for n in range(back + 20)
                         if sensors > 4 or n not in lost}
        assert taker.assembler.missed == [silent * (i == index) for i in range(sensors)]


@pytest.mark.parametrize(('sensors', 'share'), [(4, 0.94), (5, 0.99), (6, 0.999)])
def test_one_per_cent_of_lost_frames(sensors, share):
    """Where no two joints are lost together, four sensors give 96 % of the sets."""
    rng = random.Random(25)
    taker, layouts = rig(sensors)
    cycles = 3000
    stream = (message for number in range(cycles) for message in cycle(
        layouts, number, {index for index in range(sensors) if rng.random() < 0.01}))
    found = by_cycle(feed(taker, stream))
    assert len(found) > share * cycles
    assert sum(map(len, found.values())) < 0.02 * sensors * cycles


@pytest.mark.parametrize('sensors', [5, 6])
@pytest.mark.parametrize(('begin', 'end', 'reason'), [
    (canopen.emcy(5, 0x5000, 1), canopen.emcy(5, 0, 0), EMERGENCY),
    (canopen.frame(0x705, b'\x7f'), canopen.frame(0x705, b'\x05'), 'pre-operational'),
    (canopen.frame(0x705, b'\x04'), canopen.frame(0x705, b'\x05'), 'stopped'),
])
def test_a_node_that_is_not_well_takes_its_joint_away_and_no_set(sensors, begin, end, reason):
    taker, layouts = rig(sensors)
    stream = [cycle(layouts, number) for number in range(30)]
    # Between SYNC and the answers: it counts for the answer behind it.
    stream[10].insert(1, at(10.01 * PERIOD, begin))
    stream[20].insert(1, at(20.01 * PERIOD, end))
    found = by_cycle(feed(taker, sum(stream[:20], [])))
    assert taker.caution(T0 + 20 * PERIOD) == f'joint_3b: {reason}'
    found |= by_cycle(feed(taker, sum(stream[20:], [])))
    assert found == {n: {4} if 10 <= n < 20 else set() for n in range(30)}
    assert taker.assembler.counters['sets at the end of the cycle'] == 0
    assert taker.caution(T0 + 30 * PERIOD) is None


def test_a_lost_heartbeat_takes_the_joint_away_until_it_comes_again():
    taker, layouts = rig(6, can__heartbeat_timeout=0.02)
    stream = [cycle(layouts, number) for number in range(60)]
    for place in (0, 50):
        stream[place].insert(0, at(PERIOD * (place - 0.05), canopen.frame(0x705, b'\x05')))
    found = by_cycle(feed(taker, sum(stream[:50], [])))
    assert taker.caution(T0 + 49 * PERIOD) == 'joint_3b: heartbeat lost'
    # Heartbeats are checked every 10 ms.
    assert not any(found[n] for n in range(20)) and all(found[n] == {4} for n in range(31, 50))
    assert by_cycle(feed(taker, sum(stream[50:], []))) == {n: set() for n in range(50, 60)}


def test_a_node_that_was_started_is_operational_until_its_heartbeat():
    """Boot-up, then NMT start: the first heartbeat comes later than the first answers."""
    taker, layouts = rig(6)
    taker.feed(at(0.0, canopen.frame(0x705, b'\x00')))
    assert by_cycle(feed(taker, cycle(layouts, 1))) == {1: set()}


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_status_bits_take_their_joint_away(sensors):
    taker, layouts = rig(sensors, STATUS)
    bad = cycle(layouts, 1)
    bad[4].data = layouts[3].data(angle(3, 1), healthy=False)
    found = by_cycle(feed(taker, [*cycle(layouts, 0), *bad]))
    assert taker.caution(T0 + 2 * PERIOD) \
        == 'joint_3a: frames rejected, status bits report an error'
    found |= by_cycle(feed(taker, cycle(layouts, 2)))
    assert found == {0: set(), **({} if sensors == 4 else {1: {3}}), 2: set()}
    assert taker.tally()['dropped: joint_3a: status bits report an error'] == (sensors == 4)
    assert taker.tally()['joint_3a rejected: status bits report an error'] == 1


def test_too_many_nodes_that_are_not_well_are_all_named():
    taker, layouts = rig(6)
    for node_id in (1, 5, 6):
        taker.feed(at(0.0, canopen.emcy(node_id, 0x5000, 1)))
    assert feed(taker, cycle(layouts, 0)) == []
    assert taker.explain((), T0, 1.0) == '; '.join(
        f'{joint}: {EMERGENCY}' for joint in ('joint_1a', 'joint_3b', 'joint_3c'))


@pytest.mark.parametrize(('sensors', 'gone'), [(4, {2}), (5, {4}), (6, {0}), (6, {2, 3})])
def test_without_sync_a_silent_sensor_is_not_waited_for_either(sensors, gone):
    taker, layouts = rig(sensors, encoders__sync_id=0)
    stream = [cycle(layouts, number, gone if 10 <= number < 30 else ())[1:]
              for number in range(40)]
    samples = feed(taker, sum(stream, []))
    assert taker.assembler.counters['sets at the end of the cycle'] <= SILENT + 1
    if sensors == 4:
        assert len(samples) == 20 - 1 + (0 in gone)
        return
    # The time of a set is that of its first frame.
    numbers = [int((sample.stamp * 1e-9 - T0) / PERIOD + 1e-6) for sample in samples]
    assert numbers == list(range(40))
    for number, sample in zip(numbers, samples, strict=True):
        found = {index for index, reading in enumerate(sample.angles) if isnan(reading)}
        # When it is back, its first frame may come after the set.
        assert found == gone if 10 <= number < 30 else found <= (gone if number == 30 else set())
