# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings at their pace: when sets are due, rounds, gaps, and the end."""

from encoder_frames import cycle, record, stream, T0, values
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import ReplayError, SourceEnded
from spm_haptic_master.simulation.source_factory import make_source


@pytest.fixture
def replay(tmp_path):
    """Make a source that plays frames."""

    def make(messages, rate=100.0, **overrides):
        path = record(tmp_path / 'recorded.log', messages)
        return make_source(
            'replay',
            values(
                'replay',
                replay__path=str(path),
                replay__rate=rate,
                **overrides,
            ),
        )

    return make


def test_two_sets_of_one_stamp_are_played_in_every_round_until_the_file_is_gone(replay, tmp_path):
    """As in a log of 1 ms resolution."""
    frames = stream(0, 0, 1)
    for message in frames[:10]:
        message.timestamp = frames[0].timestamp
    source = replay(frames, replay__loop=True)
    assert all(source.read(1.0) for _ in range(9))
    (tmp_path / 'recorded.log').unlink()
    (tmp_path / 'recorded.log').mkdir()
    with pytest.raises(ReplayError, match='recorded.log: cannot be read: Is a directory'):
        [*iter(lambda: source.read(1.0), None)]


@pytest.mark.parametrize(
    ('rate', 'paused'),
    [
        (1.0, 0),
        (4.0, 0),
        (1.0, 1000.0),
    ],
)
def test_sets_are_due_at_their_last_frame_and_rounds_a_millisecond_apart(
    replay, clock, rate, paused
):
    source = replay(stream(0, 1, 2), rate, replay__loop=True)
    begin = clock.time_ns()
    # The last frame of a round comes 2.6 ms after its first.
    for played, start in enumerate((0.0, 2.6 / rate + (paused or 1.0 / rate))):
        for number in range(3):
            sample = source.read(1.0)
            # SYNC at number ms, the last answer 0.6 ms later.
            assert sample.stamp - begin == pytest.approx(1e6 * (start + number / rate), abs=3000)
            assert clock.time_ns() - begin == pytest.approx(
                1e6 * (start + (number + 0.6) / rate), abs=3000
            )
        assert source.statistics()['rounds played'] == played
        clock.now += 1e-3 * paused


def test_a_set_not_yet_due_is_kept_for_the_next_read_and_a_gap_is_reported(replay, clock):
    source = replay(stream(0, 100), 1.0)
    begin = clock.time_ns()
    assert source.read(1.0) is not None
    assert source.read(0.04) is None
    assert clock.slept[-1] == 0.04
    assert source.fault == 'a gap of 0.1 s in the recording, 0.0 s after its beginning'
    assert source.read(0.02) is None
    # 40 ms ahead: no gap any more.
    assert source.fault is None
    assert source.read(1.0).stamp - begin == pytest.approx(1e8, abs=2000)


def test_a_late_reader_gets_sets_at_once(replay, clock):
    source = replay(stream(0, 1, 2), 1.0)
    source.read(1.0)
    slept = len(clock.slept)
    clock.now += 1.0
    assert source.read(0.0)
    assert source.read(0.0)
    assert len(clock.slept) == slept
    with pytest.raises(SourceEnded, match='played to its end, 3 sets'):
        source.read(1.0)


def test_a_round_ends_the_open_cycle(replay):
    """Answers at a recording's end never join those at its beginning."""
    source = replay([*cycle(0)[2:], *stream(1, 2), *cycle(3)[:2]], replay__loop=True)
    assert all(source.read(1.0) for _ in range(8))
    figures = source.statistics()
    assert figures['rejected: before the first SYNC'] == 3 * (1 + figures['rounds played'])


def test_fault_and_figures_are_those_at_this_point_of_the_recording(replay):
    source = replay(
        [*cycle(0), *[m for m in cycle(1) if m.arbitration_id != 0x183], *stream(2, 3, 4)]
    )
    source.read(1.0)
    assert source.fault is None
    assert source.statistics()['joint_1a age (ms)'] == pytest.approx(0.45, abs=0.01)
    source.read(0.0)
    assert source.statistics()['joint_1c missed cycles'] == 1
    assert source.waits_for_listener


def test_a_recording_without_sets_for_long_is_a_fault(replay, clock):
    others = [canopen.frame(0x123, stamp=T0) for _ in range(2500)]
    source = replay([*others, *cycle(0), *others[:995], *cycle(1)])
    assert source.read(1.0) is source.read(1.0) is None
    assert clock.slept == [1e-3] * 2
    assert source.fault == 'no set of four encoders in 1000 frames of the recording'
    assert source.read(1.0)
    assert source.read(1.0)


@pytest.mark.parametrize(
    ('cycles', 'rate', 'due'),
    [
        # Gaps up to 5 s are played in full, and longer ones as one of 5 s, at the rate.
        (4900, 1.0, 4.9),
        (9000, 1.0, 5.0),
        (9000, 2.0, 2.5),
    ],
)
def test_nobody_waits_for_more_than_five_seconds_of_a_gap(replay, clock, cycles, rate, due):
    source = replay(stream(0, cycles), rate)
    begin = clock.time_ns()
    source.read(1.0)
    sample = source.read(10.0)
    assert (sample.stamp - begin) * 1e-9 == pytest.approx(due, abs=2e-3)
    assert (clock.time_ns() - begin) * 1e-9 == pytest.approx(due, abs=2e-3)


def at_times(times):
    """Return cycles whose frames all have the time of their cycle, ms."""
    frames = []
    for time in times:
        messages = cycle(0)
        for message in messages:
            message.timestamp = T0 + 1e-3 * time
        frames += messages
    return frames


def test_three_sets_of_one_stamp_are_a_log_without_times(replay):
    source = replay(at_times([0, 0, 0, 1]))
    source.read(1.0)
    source.read(1.0)
    with pytest.raises(ReplayError, match='has no times: its first 3 sets all have the stamp'):
        source.read(1.0)


def with_stops(count, stops):
    """Return times of sets, ms, that stand still `stops` times, each for two sets."""
    times = list(range(count))
    for number in range(stops):
        place = (1 + number) * count // (1 + stops)
        times[place : place + 3] = [place] * 3
    return times


@pytest.mark.parametrize(
    ('count', 'stops', 'coarse'),
    [
        # Two in a hundred may be a clock that was set back; fewer sets show nothing.
        (100, 2, False),
        (100, 3, True),
        (99, 10, False),
    ],
)
def test_times_that_often_stand_still_are_too_coarse(replay, count, stops, coarse):
    source = replay(at_times(with_stops(count, stops)), encoders__window=1e-3)
    expected = ReplayError if coarse else SourceEnded
    with pytest.raises(expected, match='too coarse: of 100 sets' if coarse else 'played to its'):
        for _ in range(count + 1):
            source.read(1.0)


def test_recorded_sets_have_their_recorded_stamps(replay):
    without_answer = [m for m in cycle(1) if m.arbitration_id != 0x183]
    source = replay([*cycle(0), *without_answer, *stream(2, 3, 4)])
    found = [sample.stamp for sample in source.recorded()]
    assert found == pytest.approx([(T0 + 1e-3 * each) * 1e9 for each in (0, 2, 3)], abs=2000)
    assert source.cycles == 5
    assert sum(source.dropped.values()) == 1


def test_a_recording_without_any_set_is_refused(replay):
    with pytest.raises(ReplayError, match='no set of four encoders in it; its frames: 2'):
        list(replay([canopen.frame(0x123, stamp=T0)] * 2).recorded())


@pytest.mark.parametrize(
    ('cycles', 'is_gap'),
    [
        (49, False),
        (51, True),
    ],
)
def test_a_wait_of_fifty_milliseconds_is_a_gap(replay, clock, cycles, is_gap):
    source = replay(stream(0, cycles), 1.0)
    source.read(1.0)
    assert source.read(0.0) is None
    assert (source.fault is not None) is is_gap


def test_before_the_first_set_there_is_no_gap(replay, clock):
    """Other frames come all the time, the first set after a tenth of a second."""
    others = [canopen.frame(0x123, stamp=T0 + 0.01 * number) for number in range(10)]
    source = replay([*others, *cycle(100)], 1.0)
    assert source.read(0.0) is None
    assert source.fault is None
