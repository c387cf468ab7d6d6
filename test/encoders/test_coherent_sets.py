# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames in, sets out: whole ones of one cycle, or none."""

import random
import time

import can
from encoder_frames import answer, cycle, decoder, feed, LAYOUTS, PERIOD, sync, T0, values
import pytest
from recording import LOG, recorded_angles
from spm_haptic_master.nodes.source_factory import make_source

ANGLES = (0.1, 0.2, 0.3, 0.4)
COUNT = 2.0 * 3.14159265 / 16384


def marked(number):
    """Return angles that no other cycle has: which cycle a set is from can be read off them."""
    return tuple(0.01 * (index + 1) + 4 * COUNT * number for index in range(4))


def frames(numbers):
    """Return the frames of cycles with marked angles, cycle by cycle."""
    return [cycle(number, marked(number)) for number in numbers]


def cycle_of(sample):
    """Return which cycle's answers a set has; fail if it has two cycles' answers."""
    numbers = {round((angle - 0.01 * (index + 1)) / (4 * COUNT))
               for index, angle in enumerate(sample.angles)}
    assert len(numbers) == 1, f'mixed cycles: {numbers}'
    assert abs(sample.stamp - round((T0 + PERIOD * min(numbers)) * 1e9)) < 1000, 'stamp of another'
    return numbers.pop()


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


def test_a_set_carries_its_syncs_time():
    samples = feed(decoder(), sum(frames(range(50)), []))
    assert [cycle_of(sample) for sample in samples] == list(range(50))


def test_answers_in_any_order():
    messages = cycle(0)
    order = [messages[0], messages[4], messages[2], messages[1], messages[3]]
    (sample,) = feed(decoder(), order)
    assert sample.angles == pytest.approx(ANGLES, abs=COUNT)


def test_sync_with_counter_is_sync():
    messages = cycle(0)
    messages[0] = sync(T0, counter=7)
    assert len(feed(decoder(), messages)) == 1


@pytest.mark.parametrize('index', range(4))
@pytest.mark.parametrize('window', [2e-3, 3e-3])
def test_a_missing_answer_costs_its_set(index, window):
    stream = frames(range(20))
    del stream[4][1 + index]
    taker = decoder(encoders__window=window)
    assert [cycle_of(s) for s in feed(taker, sum(stream, []))] \
        == [n for n in range(20) if n != 4]
    assert taker.assembler.missed == [int(index == i) for i in range(4)]
    assert taker.assembler.counters['dropped sets'] == 1


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
    got = [cycle_of(s) for s in feed(decoder(), sum(stream, []))]
    assert got == [n for n in range(12) if n != 3]


@pytest.mark.parametrize('stall', [1, 2, 3, 6])
@pytest.mark.parametrize('at_once', [1, 2, 3, 4, 5, 7, 9, 16])
@pytest.mark.parametrize('answered', range(4))
def test_answers_that_pile_up_are_never_taken_for_fresh(stall, at_once, answered):
    """All encoders hang for some cycles, then answer every SYNC, a few frames a cycle at first."""
    queue, got, taker = [], [], decoder()
    for number in range(40):
        messages = frames([number])[0]
        got += feed(taker, messages[:1])
        queue += messages[1:]
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
    numbers = [cycle_of(sample) for sample in got]
    assert numbers[:10] == list(range(10))
    assert numbers[-10:] == list(range(30, 40))


def test_a_doubled_answer_costs_its_set_only():
    stream = frames(range(6))
    stream[2].insert(3, answer(1, T0 + 2 * PERIOD + 4e-4, 0.5))
    assert [cycle_of(s) for s in feed(decoder(), sum(stream, []))] == [0, 1, 3, 4, 5]


def test_an_answer_beyond_the_window_spoils_its_set():
    taker = decoder(encoders__window=8e-4)
    stream = frames(range(4))
    stream[1][4].timestamp += 3e-4
    assert [cycle_of(s) for s in feed(taker, sum(stream, []))] == [0, 2, 3]
    assert taker.assembler.counters['dropped: answer from joint_3a outside the window'] == 1


def test_nothing_before_the_first_sync():
    assert feed(decoder(), cycle(0)[1:]) == []


@pytest.mark.parametrize(('fields', 'reason'), [
    ({'is_error_frame': True}, 'rejected: error frame'),
    ({'is_remote_frame': True, 'data': b'', 'dlc': 4}, 'rejected: remote frame'),
    ({'is_extended_id': True}, 'joint_1b rejected: identifier width'),
    ({'is_fd': True}, 'rejected: CAN FD frame'),
    ({'data': bytes(3)}, 'joint_1b rejected: 3 bytes instead of 4'),
    ({'data': bytes(8)}, 'joint_1b rejected: 8 bytes instead of 4'),
    ({'data': b''}, 'joint_1b rejected: 0 bytes instead of 4'),
    ({'data': b'\xff' * 4}, 'joint_1b rejected: counts beyond a turn'),
    ({'arbitration_id': 0x185}, 'rejected: foreign identifier'),
    ({'arbitration_id': 0x80, 'data': bytes(2)}, 'rejected: SYNC of wrong length'),
    ({'arbitration_id': 0x80, 'is_extended_id': True, 'data': b''},
     'rejected: foreign identifier'),
    ({'arbitration_id': 0x80, 'is_error_frame': True, 'data': bytes(8)}, 'rejected: error frame'),
    ({'arbitration_id': 0x80, 'is_remote_frame': True, 'data': b''}, 'rejected: remote frame'),
    ({'arbitration_id': 0x701, 'data': bytes(2)}, 'rejected: joint_1a heartbeat of wrong length'),
    ({'arbitration_id': 0x81, 'data': bytes(2)}, 'rejected: joint_1a EMCY of wrong length'),
])
@pytest.mark.parametrize('place', range(6))
def test_a_frame_of_another_kind_changes_nothing(fields, reason, place):
    taker = decoder()
    stream = frames(range(3))
    stream[1].insert(place, answer(1, T0 + PERIOD + 1e-4 * place, **fields))
    assert [cycle_of(s) for s in feed(taker, sum(stream, []))] == [0, 1, 2]
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
                for message in cycle(0, marked(number % 1000)):
                    message.timestamp += began - T0 + PERIOD * number
                    messages += [random_frame(rng, message.timestamp) for _ in range(NOISE)]
                    messages.append(message)
            yield BURST, messages

    if where == 'decoder':
        taker = decoder()
        got = feed(taker, (message for _, messages in bursts() for message in messages))
        assert taker.counters['frames'] == 5 * cycles * (1 + NOISE)
    else:
        got = in_bursts(f'fuzzed {cycles}', bursts())
    assert len(got) == cycles
    for number, sample in enumerate(got):
        assert max(abs(angle - true) for angle, true in zip(
            sample.angles, marked(number % 1000), strict=True)) < COUNT
        assert abs(sample.stamp * 1e-9 - began - PERIOD * number) < 1e-5


def without_sync(number, angles):
    return cycle(number, angles)[1:]


def test_without_sync_four_frames_in_a_window_are_a_set():
    taker = decoder(encoders__sync_id=0)
    samples = feed(taker, sum((without_sync(n, marked(n)) for n in range(20)), []))
    assert len(samples) == 20
    # The first frame's time.
    assert abs(samples[3].stamp - round((T0 + 3 * PERIOD + 1.5e-4) * 1e9)) < 1000


@pytest.mark.parametrize('index', range(4))
def test_without_sync_a_missing_frame_never_mixes_cycles(index):
    taker = decoder(encoders__sync_id=0)
    stream = [without_sync(n, marked(n)) for n in range(10)]
    del stream[4][index]
    samples = feed(taker, sum(stream, []))
    numbers = [{round((a - 0.01 * (i + 1)) / (4 * COUNT)) for i, a in enumerate(s.angles)}
               for s in samples]
    assert numbers == [{n} for n in range(10) if n != 4]


def test_an_unchanged_rolling_counter_yields_no_set():
    overrides = {'encoders__data_length': (5,) * 4, 'encoders__counter_byte': (4,) * 4,
                 'encoders__counter_mask': (0x0F,) * 4}
    taker = decoder(**overrides)
    layouts = tuple(encoder.layout for encoder in taker.encoders)
    got = []
    for number in range(40):
        messages = cycle(number, marked(number), layouts)
        for index, message in enumerate(messages[1:]):
            counter = 10 if index == 2 and 10 <= number < 20 else number
            message.data = layouts[index].data(marked(number)[index], counter)
        got += [cycle_of(sample) for sample in feed(taker, messages)]
    # Frame 10 is the last fresh one; 20 comes as a jump, fresh again.
    assert got == [*range(11), *range(20, 40)]
    assert taker.tally()['joint_1c rejected: rolling counter unchanged'] == 9
    assert taker.tally()['joint_1c rejected: rolling counter jumped (frame kept)'] == 1


def test_status_bits_that_report_an_error_yield_no_set():
    overrides = {'encoders__data_length': (5,) * 4, 'encoders__status_byte': (4,) * 4,
                 'encoders__status_mask': (0x03,) * 4, 'encoders__status_good': (0x01,) * 4}
    taker = decoder(**overrides)
    layouts = tuple(encoder.layout for encoder in taker.encoders)
    assert len(feed(taker, cycle(0, layouts=layouts))) == 1
    messages = cycle(1, layouts=layouts)
    messages[1].data = layouts[0].data(0.1, healthy=False)
    assert feed(taker, messages) == []
    assert taker.tally()['joint_1a rejected: status bits report an error'] == 1


def test_mixed_layouts_on_one_bus():
    """Every joint its own: 29 bits, big-endian, left-aligned, signed."""
    taker = decoder(
        can__protocol='raw', encoders__id=(0x281, 0x18FF1234, 0x10, 0x7FE),
        encoders__extended=(False, True, False, False), encoders__data_length=(8, 6, 2, 4),
        encoders__byte_offset=(4, 2, 0, 0), encoders__bit_length=(32, 24, 16, 32),
        encoders__byte_order=('little', 'big', 'big', 'little'),
        encoders__mask=(0, 0x3FFF, 0xFFF0, 0), encoders__signed=(False, False, False, True),
        encoders__counts_per_turn=(16383, 16384, 4096, 36000), encoders__zero_count=(0, 9, 8, 7))
    layouts = tuple(encoder.layout for encoder in taker.encoders)
    (sample,) = feed(taker, cycle(0, (0.3, -0.2, 1.5, -3.0), layouts))
    assert sample.angles == pytest.approx((0.3, -0.2, 1.5, -3.0), abs=1e-3)


def test_statistics_name_rates_ages_and_missed_cycles():
    taker = decoder()
    stream = frames(range(10))
    del stream[4][2]
    feed(taker, sum(stream, []))
    told = taker.statistics(T0 + 9 * PERIOD + 6e-4)
    assert told['sets'] == 9
    assert told['joint_1b missed cycles'] == 1
    assert told['joint_3a age (ms)'] == pytest.approx(0.0, abs=0.01)
    assert told['skew p50 / p99 / max (us)'] == '450 / 450 / 450'
    assert told['SYNC jitter p50 / p99 / max (us)'].startswith('0 ')
