# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames in, sets out: whole ones of one cycle, or none."""

import random
import time

import can
from encoder_frames import answer, cycle, decoder, feed, LAYOUTS, PERIOD, sync, T0, values
from marked_cycles import angle, by_cycle, COUNT, rig
from marked_cycles import cycle as marked
import pytest
from recording import LOG, recorded_angles
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.simulation.source_factory import make_source


def frames(numbers):
    """Return the frames of cycles of four encoders, cycle by cycle."""
    return [marked(LAYOUTS, number) for number in numbers]


def whole(*numbers):
    return {number: set() for number in numbers}


@pytest.mark.parametrize('sets', [2000, pytest.param(20_000, marks=pytest.mark.slow)])
def test_recorded_log_gives_every_set(sets):
    taker = decoder()
    log = iter(can.LogReader(str(LOG)))
    samples = []
    while len(samples) < sets:
        samples += feed(taker, [next(log)])
    if sets == 20_000:
        assert feed(taker, log) == []
    expected = recorded_angles()[:sets]
    assert max(abs(a - b) for sample, row in zip(samples, expected, strict=True)
               for a, b in zip(sample.angles, row, strict=True)) < 1e-9
    assert {node.boot_ups for node in taker.network.nodes} == {1}


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_a_set_is_one_answer_of_each_encoder_in_any_order(sensors):
    taker, layouts = rig(sensors)
    assert tuple(layout.joint for layout in layouts) == ALL_JOINT_NAMES[:sensors]
    opening, *answers, last = marked(layouts, 0)
    # SYNC may have a counter.
    assert feed(taker, [sync(T0, counter=7), *reversed(answers)]) == []
    (sample,) = feed(taker, [last])
    assert sample.stamp == round(T0 * 1e9)
    assert sample.angles == pytest.approx([angle(i, 0) for i in range(sensors)], abs=COUNT)
    # An encoder that is not configured is foreign.
    feed(taker, [answer(3, T0, arbitration_id=0x181 + sensors)])
    assert taker.counters['rejected: foreign identifier'] == 1


def test_answers_before_the_first_sync_are_not_taken():
    assert feed(decoder(), cycle(0)[1:]) == []


@pytest.mark.parametrize('index', range(4))
@pytest.mark.parametrize('late_by', [1, 2, 3])
@pytest.mark.parametrize('first', [True, False])
def test_a_late_answer_never_completes_a_later_cycle(index, late_by, first):
    """It comes before the other answers of that cycle, or in its usual place."""
    stream = frames(range(12))
    late = stream[3].pop(1 + index)
    place = 1 if first else 1 + index
    late.timestamp = stream[3 + late_by][place].timestamp - 1e-5
    stream[3 + late_by].insert(place, late)
    assert by_cycle(feed(decoder(), sum(stream, []))) == whole(0, 1, 2, *range(4, 12))


@pytest.mark.parametrize('stall', [1, 2, 3, 6])
@pytest.mark.parametrize('at_once', [1, 2, 3, 4, 5, 7, 9, 16])
@pytest.mark.parametrize('answered', range(4))
def test_answers_that_pile_up_are_never_taken_for_fresh(stall, at_once, answered):
    """All encoders hang for some cycles, then answer every SYNC, a few frames a cycle at first."""
    queue, got, taker = [], [], decoder()
    for number in range(40):
        opening, *answers = marked(LAYOUTS, number)
        got += feed(taker, [opening])
        queue += answers
        if number == 10:
            able = answered
        elif 10 < number < 10 + stall:
            able = 0
        else:
            # Four a cycle is what comes in: the backlog of less than five would stay for good.
            able = at_once if 10 <= number < 12 + stall else max(at_once, 5)
            able = len(queue) if number >= 20 or number < 10 else able
        for message in queue[:able]:
            message.timestamp = T0 + PERIOD * number + 1e-4
            got += feed(taker, [message])
        del queue[:able]
    numbers = [*by_cycle(got)]
    assert numbers[:10] == [*range(10)] and numbers[-10:] == [*range(30, 40)]


def test_a_doubled_answer_and_one_beyond_the_window_cost_their_sets_only():
    taker = decoder(encoders__window=8e-4)
    stream = frames(range(8))
    stream[2].insert(3, answer(1, T0 + 2 * PERIOD + 4e-4, 0.5))
    stream[5][4].timestamp += 6e-4
    assert by_cycle(feed(taker, sum(stream, []))) == whole(0, 1, 3, 4, 6, 7)
    assert taker.assembler.counters['dropped: answer from joint_3a outside the window'] == 1


@pytest.mark.parametrize(('fields', 'reason'), [
    ({'is_error_frame': True}, 'rejected: error frame'),
    ({'is_remote_frame': True, 'data': b'', 'dlc': 4}, 'rejected: remote frame'),
    ({'is_extended_id': True}, 'joint_1b rejected: identifier width'),
    ({'is_fd': True}, 'rejected: CAN FD frame'),
    ({'data': bytes(3)}, 'joint_1b rejected: 3 bytes instead of 4'),
    ({'data': bytes(8)}, 'joint_1b rejected: 8 bytes instead of 4'),
    ({'data': b'\xff' * 4}, 'joint_1b rejected: counts beyond a turn'),
    ({'arbitration_id': 0x185}, 'rejected: foreign identifier'),
    ({'arbitration_id': 0x80, 'data': bytes(2)}, 'rejected: SYNC of wrong length'),
    ({'arbitration_id': 0x80, 'is_extended_id': True, 'data': b''},
     'rejected: foreign identifier'),
    ({'arbitration_id': 0x80, 'is_error_frame': True, 'data': bytes(8)}, 'rejected: error frame'),
    ({'arbitration_id': 0x80, 'is_remote_frame': True, 'data': b''}, 'rejected: remote frame'),
    ({'arbitration_id': 0x80, 'is_fd': True, 'data': b''}, 'rejected: CAN FD frame'),
    ({'arbitration_id': 0x701, 'data': bytes(2)}, 'rejected: joint_1a heartbeat of wrong length'),
    ({'arbitration_id': 0x81, 'data': bytes(2)}, 'rejected: joint_1a EMCY of wrong length'),
])
def test_a_frame_of_another_kind_changes_nothing(fields, reason):
    for place in range(6):
        taker = decoder()
        stream = frames(range(3))
        stream[1].insert(place, answer(1, T0 + PERIOD + 1e-4 * place, **fields))
        assert by_cycle(feed(taker, sum(stream, []))) == whole(0, 1, 2)
        assert taker.tally()[reason] == 1


def random_frame(rng, at):
    """Return a frame of any kind, but none that passes for one of the bus's own."""
    known = [0x80, 0x81, 0x84, 0x181, 0x182, 0x183, 0x184, 0x701, 0x704, 0]
    lengths = {0x80: (0, 1), **{layout.can_id: (4,) for layout in LAYOUTS}}
    extended = rng.random() < 0.3
    identifier = rng.choice(known) if rng.random() < 0.5 \
        else rng.randrange(1 << (29 if extended else 11))
    kind = rng.choice(['data', 'data', 'error', 'remote', 'fd'])
    length = rng.randrange(9)
    if kind == 'data' and not extended and length in lengths.get(identifier, ()):
        length = 5
    return can.Message(
        arbitration_id=identifier, is_extended_id=extended, timestamp=at,
        is_error_frame=kind == 'error', is_remote_frame=kind == 'remote', is_fd=kind == 'fd',
        data=b'' if kind == 'remote' else rng.randbytes(length), dlc=length)


def in_bursts(channel, bursts):
    """Return the sets that a source reads from a virtual bus, burst by burst."""
    source = make_source('can', values(can__interface='virtual', can__channel=channel))
    got = []
    with can.Bus(interface='virtual', channel=channel, preserve_timestamps=True) as bus:
        source.read(0.01)
        for cycles, burst in bursts:
            for message in burst:
                bus.send(message)
            before = len(got)
            while len(got) - before < cycles and (sample := source.read(1.0)):
                got.append(sample)
    source.close()
    return got


NOISE, BURST = 4, 10


@pytest.mark.parametrize(('where', 'cycles'), [
    ('decoder', 1000), ('virtual bus', 500),
    pytest.param('decoder', 5000, marks=pytest.mark.slow),
    pytest.param('virtual bus', 5000, marks=pytest.mark.slow)])
def test_a_hundred_thousand_random_frames_lose_nothing_and_add_nothing(where, cycles):
    """Four random frames before each of a cycle's five: 100,000 in 5000 cycles."""
    rng = random.Random(20)
    began = time.time()

    def bursts():
        for first in range(0, cycles, BURST):
            messages = []
            for number in range(first, first + BURST):
                for message in marked(LAYOUTS, number):
                    message.timestamp += began - T0
                    messages += [random_frame(rng, message.timestamp) for _ in range(NOISE)]
                    messages.append(message)
            yield BURST, messages

    if where == 'decoder':
        taker = decoder()
        got = feed(taker, (message for _, messages in bursts() for message in messages))
        assert taker.counters['frames'] == 5 * cycles * (1 + NOISE)
    else:
        got = in_bursts(f'fuzzed {cycles}', bursts())
    shift = round((began - T0) * 1e9)
    assert by_cycle(sample._replace(stamp=sample.stamp - shift) for sample in got) \
        == whole(*range(cycles))


@pytest.mark.parametrize('index', range(4))
def test_without_sync_frames_in_a_window_are_a_set_and_never_mix_cycles(index):
    taker = decoder(encoders__sync_id=0)
    stream = [messages[1:] for messages in frames(range(20))]
    del stream[4][index]
    samples = feed(taker, sum(stream, []))
    assert by_cycle(samples) == whole(*range(4), *range(5, 20))
    # The first frame's time.
    assert abs(samples[3].stamp - round((T0 + 3 * PERIOD + 8e-5) * 1e9)) < 1000


def test_mixed_layouts_on_one_bus():
    """Every joint its own: 29 bits, big-endian, left-aligned, signed."""
    taker = decoder(
        can__protocol='raw', encoders__id=(0x281, 0x18FF1234, 0x10, 0x7FE),
        encoders__extended=(False, True, False, False), encoders__data_length=(8, 6, 2, 4),
        encoders__byte_offset=(4, 2, 0, 0), encoders__bit_length=(32, 24, 16, 32),
        encoders__byte_order=('little', 'big', 'big', 'little'),
        encoders__mask=(0, 0x3FFF, 0xFFF0, 0), encoders__signed=(False, False, False, True),
        encoders__counts_per_turn=(16383, 16384, 4096, 36000), encoders__zero_count=(0, 9, 8, 7))
    (sample,) = feed(taker, cycle(0, (0.3, -0.2, 1.5, -3.0), taker.layouts))
    assert sample.angles == pytest.approx((0.3, -0.2, 1.5, -3.0), abs=1e-3)
