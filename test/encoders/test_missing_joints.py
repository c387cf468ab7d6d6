# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A sensor that is not there: what becomes of its joint, of the set, and of the next sets."""

from math import isnan
import random

from encoder_frames import answer, decoder, feed, PERIOD, sync, T0
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.joints import ALL_JOINT_NAMES

# rad; the counts of a cycle's angles, by which it is known which cycle's they are.
COUNT = 2.0 * 3.14159265 / 16384
# Cycles without an answer after which a joint is not waited for.
SILENT = 3
COUNTER = {'encoders__data_length': 5, 'encoders__counter_byte': 4, 'encoders__counter_mask': 0x0F}
STATUS = {'encoders__data_length': 5, 'encoders__status_byte': 4, 'encoders__status_mask': 0x03,
          'encoders__status_good': 0x01}
EMERGENCY = 'EMCY 0x5000 device hardware, error register 0x01'


def rig(sensors, layout=None, **overrides):
    """Return a decoder of N encoders, and their layouts."""
    taker = decoder(sensors=sensors, **overrides, **{
        name: (value,) * sensors for name, value in (layout or {}).items()})
    return taker, tuple(encoder.layout for encoder in taker.encoders)


def angle(index, number):
    """Return the angle of a joint in a cycle, rad."""
    return 0.01 * (index + 1) + 4 * COUNT * (number % 1000)


def frame(layouts, index, number, sampled=None):
    """Return an answer that comes in a cycle, of the angle sampled in that one or another."""
    sampled = number if sampled is None else sampled
    at = T0 + PERIOD * number + 8e-5 * (index + 1)
    data = layouts[index].data(angle(index, sampled), sampled)
    return answer(index, at, layouts=layouts, data=data)


def cycle(layouts, number, without=()):
    return [sync(T0 + PERIOD * number), *(
        frame(layouts, index, number) for index in range(len(layouts)) if index not in without)]


def missing(sample):
    """Return the joints without a reading; fail if another reading is of another cycle."""
    number = round((sample.stamp * 1e-9 - T0) / PERIOD)
    for index, reading in enumerate(sample.angles):
        assert isnan(reading) or abs(reading - angle(index, number)) < COUNT, (number, index)
    return {index for index, reading in enumerate(sample.angles) if isnan(reading)}


def by_cycle(samples):
    """Return the joints without a reading, by the cycle of each set."""
    found = {round((sample.stamp * 1e-9 - T0) / PERIOD): missing(sample) for sample in samples}
    assert len(found) == len(samples) and list(found) == sorted(found)
    return found


@pytest.mark.parametrize(('sensors', 'gone'), [
    (5, {4}), (5, {0}), (6, {4}), (6, {5}), (6, {0, 1}), (6, {3, 4})])
def test_the_sets_go_on_without_a_silent_sensor_and_do_not_wait_for_it(sensors, gone):
    taker, layouts = rig(sensors)
    for number in range(10):
        assert len(feed(taker, cycle(layouts, number))) == 1
    held = 0
    for number in range(10, 60):
        opening, *answers = cycle(layouts, number, gone)
        at_sync, at_answers = feed(taker, [opening]), feed(taker, answers)
        held += len(at_sync)
        for sample in at_sync + at_answers:
            assert missing(sample) == gone
        # It goes out with its last answer.
        assert len(at_answers) == (number >= 10 + SILENT)
    assert held == SILENT == taker.assembler.counters['sets at the end of the cycle']
    assert taker.assembler.counters['sets'] == 60
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
    taker, layouts = rig(sensors)
    begin, back = 10, 10 + silent
    stream = [cycle(layouts, number, {3} if begin <= number < back else ())
              for number in range(back + 20)]
    found = by_cycle(feed(taker, sum(stream, [])))
    # Until its late answers would have come, what comes may be one of them.
    doubt = 0 if silent == 1 else 3
    lost = range(begin, back + doubt)
    if sensors == 4:
        assert list(found) == [n for n in range(back + 20) if n not in lost]
    else:
        assert found == {n: {3} if n in lost else set() for n in range(back + 20)}


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_a_lost_frame_costs_one_joint_of_one_set_or_with_four_one_set(sensors):
    for index in range(sensors):
        taker, layouts = rig(sensors)
        stream = [cycle(layouts, number, {index} if number == 5 else ()) for number in range(20)]
        found = by_cycle(feed(taker, sum(stream, [])))
        if sensors == 4:
            assert found == {number: set() for number in range(20) if number != 5}
        else:
            assert found == {number: {index} if number == 5 else set() for number in range(20)}


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
    for place, message in ((10, begin), (20, end)):
        message.timestamp = T0 + PERIOD * (place - 0.05)
        stream[place].insert(0, message)
    found = by_cycle(feed(taker, sum(stream[:20], [])))
    assert taker.caution(T0 + 20 * PERIOD) == f'joint_3b: {reason}'
    found |= by_cycle(feed(taker, sum(stream[20:], [])))
    assert found == {n: {4} if 10 <= n < 20 else set() for n in range(30)}
    assert taker.assembler.counters['sets at the end of the cycle'] == 0
    assert taker.caution(T0 + 30 * PERIOD) is None


def test_an_emergency_counts_for_the_answer_behind_it():
    taker, layouts = rig(6)
    opening, *answers = cycle(layouts, 0)
    emergency = canopen.emcy(5, 0x5000, 1)
    emergency.timestamp = T0 + 1e-5
    assert [missing(sample) for sample in feed(taker, [opening, emergency, *answers])] == [{4}]


def test_a_lost_heartbeat_takes_the_joint_away_until_it_comes_again():
    taker, layouts = rig(6, can__heartbeat_timeout=0.02)
    beat = [canopen.frame(0x705, b'\x05') for _ in range(2)]
    stream = [cycle(layouts, number) for number in range(60)]
    for place, message in zip((0, 50), beat, strict=True):
        message.timestamp = T0 + PERIOD * (place - 0.05)
        stream[place].insert(0, message)
    found = by_cycle(feed(taker, sum(stream[:50], [])))
    assert taker.caution(T0 + 49 * PERIOD) == 'joint_3b: heartbeat lost'
    # Heartbeats are checked every 10 ms.
    assert not any(found[n] for n in range(20)) and all(found[n] == {4} for n in range(31, 50))
    assert by_cycle(feed(taker, sum(stream[50:], []))) == {n: set() for n in range(50, 60)}


def test_a_node_that_was_started_is_operational_until_its_heartbeat():
    """Boot-up, then NMT start: the first heartbeat comes later than the first answers."""
    taker, layouts = rig(6)
    boot = canopen.frame(0x705, b'\x00')
    boot.timestamp = T0
    taker.feed(boot)
    assert [missing(sample) for sample in feed(taker, cycle(layouts, 1))] == [set()]


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_status_bits_take_their_joint_away(sensors):
    taker, layouts = rig(sensors, STATUS)
    bad = cycle(layouts, 1)
    bad[4].data = layouts[3].data(angle(3, 1), healthy=False)
    found = by_cycle(feed(taker, [*cycle(layouts, 0), *bad]))
    caution = taker.caution(T0 + 2 * PERIOD)
    found |= by_cycle(feed(taker, cycle(layouts, 2)))
    assert caution == 'joint_3a: frames rejected, status bits report an error'
    if sensors == 4:
        assert list(found) == [0, 2]
        assert taker.tally()['dropped: joint_3a: status bits report an error'] == 1
    else:
        assert found == {0: set(), 1: {3}, 2: set()}


def test_too_many_nodes_that_are_not_well_are_all_named():
    taker, layouts = rig(6)
    for node_id in (1, 5, 6):
        emergency = canopen.emcy(node_id, 0x5000, 1)
        emergency.timestamp = T0
        taker.feed(emergency)
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
