# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings: every format, the recorded spacing, and broken ones told in a line."""

import gzip

import can
from encoder_frames import cycle, values
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import ReplayError, SettingError, SourceEnded
from spm_haptic_master.simulation.source_factory import make_source

FORMATS = ('.log', '.asc', '.blf', '.csv', '.trc',
           '.log.gz', '.asc.gz', '.blf.gz', '.csv.gz', '.trc.gz')


def write(path, messages):
    """Record messages with python-can's own writer, compressed by gzip where that has none."""
    if path.name.endswith('.blf.gz'):
        return compressed(write(path.with_suffix(''), messages))
    with can.Logger(str(path)) as logger:
        for message in messages:
            logger(message)
    return path


def compressed(path):
    packed = path.with_name(path.name + '.gz')
    packed.write_bytes(gzip.compress(path.read_bytes()))
    return packed


def stream(*numbers):
    return [message for number in numbers for message in cycle(number)]


@pytest.fixture
def replay(tmp_path):
    """Make a source that plays frames, or a file."""
    made = []

    def make(recorded, rate=100.0, **overrides):
        path = write(tmp_path / 'recorded.log', recorded) if isinstance(recorded, list) \
            else recorded
        made.append(make_source('replay', values(
            'replay', replay__path=str(path), replay__rate=rate, **overrides)))
        return made[-1]

    yield make
    for source in made:
        source.close()


def play(source):
    """Return the sets, and the text that ends them."""
    got = []
    try:
        while True:
            sample = source.read(1.0)
            if sample is not None:
                got.append(sample)
    except SourceEnded as end:
        return got, str(end)


@pytest.mark.parametrize('suffix', FORMATS)
def test_every_format_keeps_sets_and_spacing(tmp_path, replay, suffix):
    path = write(tmp_path / f'recorded{suffix}', stream(*range(30)))
    got, end = play(replay(path, rate=1.0))
    assert end == f'{path}: played to its end, 30 sets'
    assert [s.angles for s in got] == [pytest.approx((0.1, 0.2, 0.3, 0.4), abs=4e-4)] * 30
    spacing = [(b.stamp - a.stamp) * 1e-3 for a, b in zip(got, got[1:], strict=False)]
    # us; how finely a format writes the time.
    assert spacing == pytest.approx([1000.0] * 29, abs=110.0 if suffix.startswith('.trc') else 2.0)


def cut(path):
    data = path.read_bytes()
    path.write_bytes(data[:len(data) * 2 // 3])
    return path


def garbled(path):
    lines = path.read_text().splitlines()
    lines[40] = lines[40][:20]
    path.write_text('\n'.join(lines))
    return path


LONG, SHORT = stream(*range(2000)), stream(*range(20))
BROKEN = {
    'cut gzip': (lambda d: cut(write(d / 'a.log.gz', LONG)), 'not readable after'),
    'cut blf': (lambda d: cut(write(d / 'a.blf', LONG)), 'not readable after'),
    'cut blf, compressed then': (lambda d: compressed(cut(write(d / 'a.blf', LONG))), 'truncated'),
    'blf, cut when compressed': (lambda d: cut(write(d / 'a.blf.gz', LONG)),
                                 'not readable after'),
    'cut line': (lambda d: garbled(write(d / 'a.log', SHORT)), 'not readable after 40 frames'),
    'blf called log': (lambda d: write(d / 'a.blf', SHORT).rename(d / 'a.log'), 'not readable'),
    'log called blf': (lambda d: write(d / 'a.log', SHORT).rename(d / 'a.blf'), 'read'),
    'log called csv': (lambda d: write(d / 'a.log', SHORT).rename(d / 'a.csv'), 'read'),
    'empty': (lambda d: write(d / 'a.log', []), 'no set of four encoders in it; its frames: none'),
    'empty gzip': (lambda d: cut(compressed(write(d / 'a.log', []))), ''),
    'no encoder frames': (
        lambda d: write(d / 'a.log', [canopen.frame(0x701, b'\x05') for _ in range(9)]),
        'no set of four encoders in it; its frames: 9 frames'),
    'one encoder missing': (
        lambda d: write(d / 'a.log', [m for m in SHORT if m.arbitration_id != 0x184]),
        'no answer from joint_3a'),
    'no times': (lambda d: write(d / 'a.log', [m for _ in range(9) for m in _timeless()]),
                 'has no times: its first 3 sets all have the stamp 64 s'),
}


def _timeless():
    messages = cycle(0)
    for message in messages:
        message.timestamp = 64.0
    return messages


@pytest.mark.parametrize('name', BROKEN)
def test_a_broken_recording_ends_with_a_clear_error(tmp_path, replay, name):
    make, expected = BROKEN[name]
    path = make(tmp_path)
    with pytest.raises(ReplayError) as error:
        play(replay(path))
    assert str(path) in str(error.value)
    assert expected in str(error.value)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(('name', 'expected'), [
    ('missing.log', 'an existing file'), ('.', 'an existing file'),
    ('a.txt', r'a log that python-can reads \(\.log, \.asc, \.blf'),
    # python-can's writer drops frames of a .db; what is left would play without a word.
    ('a.db', r'another format \(\.log.*drops frames'), ('a.DB', 'another format')])
def test_what_is_no_log_is_a_wrong_setting(tmp_path, replay, name, expected):
    if name.startswith('a.'):
        (tmp_path / name).write_text('nothing')
    with pytest.raises(SettingError, match=f"'replay.path' is .*{expected}"):
        replay(tmp_path / name)


@pytest.mark.parametrize('rate', [1.0, 4.0])
def test_sets_are_due_at_their_last_frame(replay, clock, rate):
    source = replay(stream(*range(5)), rate)
    begin = clock.time_ns()
    for number in range(5):
        sample = source.read(1.0)
        # SYNC at number ms, the last answer 0.6 ms later.
        assert sample.stamp - begin == pytest.approx(number * 1e6 / rate, abs=2000)
        assert clock.time_ns() - begin == pytest.approx((number * 1e6 + 6e5) / rate, abs=2000)


def test_a_set_not_yet_due_is_kept_for_the_next_read_and_a_gap_is_reported(replay, clock):
    source = replay(stream(0, 100), 1.0)
    begin = clock.time_ns()
    assert source.read(1.0) is not None
    assert source.read(0.04) is None
    assert clock.slept[-1] == 0.04
    assert source.fault == 'a gap in the recording'
    assert source.read(0.02) is None
    # 40 ms ahead: no gap any more.
    assert source.fault is None
    assert source.read(1.0).stamp - begin == pytest.approx(1e8, abs=2000)


def test_a_late_reader_gets_sets_at_once(replay, clock):
    source = replay(stream(0, 1, 2), 1.0)
    source.read(1.0)
    slept = len(clock.slept)
    clock.now += 1.0
    assert source.read(0.0) is not None
    assert source.read(0.0) is not None
    assert len(clock.slept) == slept
    with pytest.raises(SourceEnded, match='3 sets'):
        source.read(1.0)


@pytest.mark.parametrize(('rate', 'paused'), [(1.0, 0), (2.0, 0), (1.0, 1.0)])
def test_a_round_begins_a_millisecond_after_the_one_before(replay, clock, rate, paused):
    source = replay(stream(0, 1, 2), rate, replay__loop=True)
    first = [source.read(1.0) for _ in range(3)]
    assert source.statistics()['rounds played'] == 0
    clock.now += paused
    again = [source.read(1.0) for _ in range(3)]
    # The last frame of the three cycles came 2.6 ms after the first.
    assert again[0].stamp - first[0].stamp == pytest.approx(
        2.6e6 / rate + (1e9 * paused or 1e6 / rate), abs=3000)
    assert again[2].stamp - again[0].stamp == pytest.approx(2e6 / rate, abs=3000)
    assert source.statistics()['rounds played'] == 1


def test_a_round_ends_the_open_cycle(replay):
    """Answers at a recording's end never join those at its beginning."""
    source = replay([*cycle(0)[2:], *stream(1, 2), *cycle(3)[:2]], replay__loop=True)
    assert all(source.read(1.0) for _ in range(8))
    figures = source.statistics()
    assert figures['rejected: before the first SYNC'] == 3 * (1 + figures['rounds played'])


@pytest.mark.parametrize(('back', 'fine'), [(0.9e-3, True), (1.1e-3, False)])
def test_frames_may_be_swapped_by_less_than_a_cycle(replay, back, fine):
    messages = stream(*range(10))
    last = messages[-1].timestamp
    messages.append(canopen.frame(0x123))
    messages[-1].timestamp = last - back
    source = replay(messages)
    if fine:
        assert len(play(source)[0]) == 10
        return
    with pytest.raises(ReplayError, match=f'time runs backwards at frame 51, from {last:.6f} s to '
                       f'{last - back:.6f} s'):
        play(source)


def test_fault_and_figures_are_those_at_this_point_of_the_recording(replay):
    source = replay([*cycle(0), *[m for m in cycle(1) if m.arbitration_id != 0x183],
                     *stream(2, 3, 4)])
    source.read(1.0)
    assert source.fault is None
    assert source.statistics()['joint_1a age (ms)'] == pytest.approx(0.45, abs=0.01)
    source.read(0.0)
    assert source.statistics()['joint_1c missed cycles'] == 1
    assert source.waits_for_listener
    file = source._log._reader.file
    assert not file.closed
    source.close()
    assert file.closed


def test_a_recording_without_sets_for_long_is_a_fault_in_powers_of_ten(replay, clock):
    frames = [canopen.frame(0x123) for _ in range(2500)]
    source = replay([*frames, *cycle(0)])
    assert source.read(1.0) is source.read(1.0) is None
    assert clock.slept == [1e-3] * 2
    assert source.fault == 'no set of four encoders in 1000 frames of the recording'


def test_a_path_may_begin_with_the_home_directory(tmp_path, replay, monkeypatch):
    monkeypatch.setenv('HOME', str(tmp_path))
    write(tmp_path / 'recorded.log', stream(0, 1))
    assert len(play(replay('~/recorded.log'))[0]) == 2
