# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings: every format, the recorded spacing, and broken ones told in a line."""

import gzip

import can
from encoder_frames import cycle, values
import pytest
from recording import LOG
from spm_haptic_master.encoders import canopen, replay_source
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import ReplayError, SettingError, SourceEnded
from spm_haptic_master.ros.source_factory import make_source

FORMATS = ('.log', '.asc', '.blf', '.csv', '.trc',
           '.log.gz', '.asc.gz', '.blf.gz', '.csv.gz', '.trc.gz')
# us; how finely a format writes the time.
RESOLUTION = {'.trc': 110.0}


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
    path.unlink()
    return packed


def stream(cycles):
    return [message for number in range(cycles) for message in cycle(number)]


def open_replay(path, **overrides):
    overrides = {'replay__rate': 100.0} | overrides
    return make_source('replay', values('replay', replay__path=str(path), **overrides))


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
    finally:
        source.close()


class Clock:
    """Time that passes only in sleep."""

    def __init__(self):
        self.now = 1_800_000_000_000_000_000
        self.slept = []

    def time_ns(self):
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += round(seconds * 1e9)


@pytest.fixture
def clock(monkeypatch):
    """Put replays on a clock that only the test moves."""
    clock = Clock()
    monkeypatch.setattr(replay_source, 'time', clock)
    return clock


@pytest.mark.parametrize('suffix', FORMATS)
def test_every_format_keeps_sets_and_spacing(tmp_path, suffix):
    path = write(tmp_path / f'recorded{suffix}', stream(30))
    got, end = play(open_replay(path, replay__rate=1.0))
    assert end == f'{path}: played to its end, 30 sets'
    assert [s.angles for s in got] == [got[0].angles] * 30
    assert got[0].angles == pytest.approx((0.1, 0.2, 0.3, 0.4), abs=4e-4)
    spacing = [(b.stamp - a.stamp) * 1e-3 for a, b in zip(got, got[1:], strict=False)]
    assert spacing == pytest.approx([1000.0] * 29, abs=RESOLUTION.get(suffix.split('.gz')[0], 2.0))


def test_loop_goes_on_with_new_stamps(tmp_path):
    source = open_replay(write(tmp_path / 'recorded.log', stream(10)), replay__loop=True)
    got = [sample for _ in range(35) if (sample := source.read(1.0))]
    assert len(got) == 35
    assert all(b.stamp > a.stamp for a, b in zip(got, got[1:], strict=False))
    assert source.statistics()['rounds played'] == 3
    source.close()


def test_a_gap_in_a_recording_is_told(tmp_path):
    late = cycle(2000)
    source = open_replay(write(tmp_path / 'recorded.log', stream(5) + late), replay__rate=1.0)
    for _ in range(5):
        assert source.read(1.0)
    assert source.read(0.05) is None
    assert source.fault == 'a gap in the recording'
    source.close()


def cut(path):
    data = path.read_bytes()
    path.write_bytes(data[:len(data) * 2 // 3])
    return path


def renamed(path, suffix):
    return path.rename(path.with_suffix(suffix))


def garbled(path):
    lines = path.read_text().splitlines()
    lines[40] = lines[40][:20]
    path.write_text('\n'.join(lines))
    return path


BROKEN = {
    'cut gzip': (lambda d: cut(write(d / 'a.log.gz', stream(2000))), 'not readable after'),
    'cut blf': (lambda d: cut(write(d / 'a.blf', stream(2000))), 'not readable after'),
    'cut blf, compressed then': (
        lambda d: compressed(cut(write(d / 'a.blf', stream(2000)))), 'truncated'),
    'blf, cut when compressed': (
        lambda d: cut(write(d / 'a.blf.gz', stream(2000))), 'not readable after'),
    'cut line': (lambda d: garbled(write(d / 'a.log', stream(20))),
                 'not readable after 40 frames'),
    'blf called log': (lambda d: renamed(write(d / 'a.blf', stream(20)), '.log'), 'not readable'),
    'log called blf': (lambda d: renamed(write(d / 'a.log', stream(20)), '.blf'), 'read'),
    'log called csv': (lambda d: renamed(write(d / 'a.log', stream(20)), '.csv'), 'read'),
    'empty': (lambda d: write(d / 'a.log', []), 'no set of four encoders in it; its frames: none'),
    'no encoder frames': (
        lambda d: write(d / 'a.log', [canopen.frame(0x701, b'\x05') for _ in range(9)]),
        'no set of four encoders in it; its frames: 9 frames'),
    'one encoder missing': (
        lambda d: write(d / 'a.log', [m for m in stream(9) if m.arbitration_id != 0x184]),
        'no answer from joint_3a'),
    'backwards': (lambda d: write(d / 'a.log', stream(20) + stream(20)),
                  'time runs backwards at frame 101'),
}


@pytest.mark.parametrize('name', BROKEN)
def test_a_broken_recording_ends_with_a_clear_error(tmp_path, name):
    make, expected = BROKEN[name]
    path = make(tmp_path)
    with pytest.raises(ReplayError) as error:
        play(open_replay(path))
    assert str(path) in str(error.value)
    assert expected in str(error.value)
    assert '\n' not in str(error.value)


def test_an_empty_gzip_is_refused(tmp_path):
    path = tmp_path / 'a.log.gz'
    path.write_bytes(b'')
    with pytest.raises(ReplayError, match='no set of four encoders|read'):
        play(open_replay(path))


@pytest.mark.parametrize('name', ['missing.log', '.'])
def test_a_missing_file_is_a_wrong_setting(tmp_path, name):
    with pytest.raises(SettingError, match="'replay.path' is .*; expected an existing file"):
        open_replay(tmp_path / name)


def test_a_format_without_reader_is_a_wrong_setting(tmp_path):
    path = tmp_path / 'a.txt'
    path.write_text('nothing')
    with pytest.raises(SettingError, match=r'\.log, \.asc, \.blf'):
        open_replay(path)


@pytest.mark.parametrize('name', ['a.db', 'a.DB'])
def test_a_format_that_loses_frames_is_refused(tmp_path, name):
    """python-can's writer drops frames of a .db; what is left would play without a word."""
    path = write(tmp_path / 'a.db', stream(20)).rename(tmp_path / name)
    with pytest.raises(SettingError, match=r'replay.path.*another format \(\.log.*drops frames'):
        open_replay(path)


def test_a_log_in_wrong_order_by_less_than_a_cycle_plays(tmp_path):
    messages = stream(20)
    messages[52], messages[53] = messages[53], messages[52]
    got, _ = play(open_replay(write(tmp_path / 'a.log', messages)))
    assert len(got) == 20


def test_the_recorded_session_plays_through_the_live_decoder():
    source = open_replay(LOG)
    got = [sample for _ in range(500) if (sample := source.read(5.0))]
    source.close()
    assert len(got) == 500


def test_pace_and_stamps(tmp_path, clock):
    begin = clock.now
    got, _ = play(open_replay(write(tmp_path / 'recorded.log', stream(300)), replay__rate=2.0))
    assert (clock.now - begin) * 1e-9 == pytest.approx(0.1498, abs=1e-5)
    assert got[0].stamp == begin
    assert (got[-1].stamp - got[0].stamp) * 1e-9 == pytest.approx(0.1495, abs=1e-5)


@pytest.mark.parametrize('rate', [1.0, 4.0])
def test_sets_are_due_at_their_last_frame(tmp_path, clock, rate):
    source = open_replay(write(tmp_path / 'recorded.log', stream(5)), replay__rate=rate)
    begin = clock.now
    for number in range(5):
        sample = source.read(1.0)
        # SYNC at number ms, the last answer 0.6 ms later.
        assert sample.stamp - begin == pytest.approx(number * 1e6 / rate, abs=2000)
        assert clock.now - begin == pytest.approx((number * 1e6 + 6e5) / rate, abs=2000)
    source.close()


def test_a_set_not_yet_due_is_kept_for_the_next_read(tmp_path, clock):
    source = open_replay(write(tmp_path / 'recorded.log', [*cycle(0), *cycle(100)]),
                         replay__rate=1.0)
    begin = clock.now
    assert source.read(1.0) is not None
    assert source.read(0.04) is None
    assert clock.slept[-1] == 0.04
    assert source.fault == 'a gap in the recording'
    assert source.read(0.02) is None
    # 40 ms ahead: no gap any more.
    assert source.fault is None
    assert source.read(1.0).stamp - begin == pytest.approx(1e8, abs=2000)
    source.close()


def test_a_late_reader_gets_sets_at_once(tmp_path, clock):
    source = open_replay(write(tmp_path / 'recorded.log', stream(3)), replay__rate=1.0)
    source.read(1.0)
    slept = len(clock.slept)
    clock.now += 10**9
    assert source.read(0.0) is not None
    assert source.read(0.0) is not None
    assert len(clock.slept) == slept
    with pytest.raises(SourceEnded, match='3 sets'):
        source.read(1.0)
    source.close()


@pytest.mark.parametrize(('rate', 'paused'), [(1.0, 0), (2.0, 0), (1.0, 10**9)])
def test_a_round_begins_after_the_one_before(tmp_path, clock, rate, paused):
    source = open_replay(write(tmp_path / 'recorded.log', stream(3)), replay__rate=rate,
                         replay__loop=True)
    first = [source.read(1.0) for _ in range(3)]
    assert source.statistics()['rounds played'] == 0
    clock.now += paused
    again = [source.read(1.0) for _ in range(3)]
    # The last frame of the three cycles came 2.6 ms after the first.
    assert again[0].stamp - first[0].stamp >= 2.6e6 / rate + paused - 100
    assert again[0].stamp - first[0].stamp <= 3.6e6 / rate + paused + 100
    assert again[2].stamp - again[0].stamp == pytest.approx(2e6 / rate, abs=3000)
    assert source.statistics()['rounds played'] == 1
    source.close()


def test_a_round_ends_the_open_cycle(tmp_path):
    """Answers at a recording's end never join those at its beginning."""
    messages = [*cycle(0)[2:], *stream(3)[5:], *cycle(3)[:2]]
    source = open_replay(write(tmp_path / 'recorded.log', messages), replay__loop=True)
    got = [source.read(1.0) for _ in range(8)]
    assert all(got)
    figures = source.statistics()
    assert figures['rejected: before the first SYNC'] == 3 * (1 + figures['rounds played'])
    source.close()


@pytest.mark.parametrize(('back', 'fine'), [(0.9e-3, True), (1.1e-3, False)])
def test_frames_may_be_swapped_by_less_than_a_cycle(tmp_path, back, fine):
    messages = stream(10)
    last = messages[-1].timestamp
    messages.append(canopen.frame(0x123))
    messages[-1].timestamp = last - back
    path = write(tmp_path / 'recorded.log', messages)
    if fine:
        assert len(play(open_replay(path))[0]) == 10
        return
    with pytest.raises(ReplayError) as error:
        play(open_replay(path))
    assert f'time runs backwards at frame 51, from {last:.6f} s to {last - back:.6f} s' \
        in str(error.value)


def test_the_assemblers_cause_is_the_fault(tmp_path):
    messages = [*cycle(0), *[m for m in cycle(1) if m.arbitration_id != 0x183], *cycle(2),
                *cycle(3), *cycle(4), *cycle(5), *cycle(6), *cycle(7)]
    source = open_replay(write(tmp_path / 'recorded.log', messages))
    source.read(1.0)
    assert source.fault is None
    assert source.statistics()['joint_1a age (ms)'] == pytest.approx(0.45, abs=0.01)
    source.read(0.0)
    source.close()
    assert source.statistics()['joint_1c missed cycles'] == 1


def test_closing_closes_the_file(tmp_path):
    source = open_replay(write(tmp_path / 'recorded.log', stream(2)))
    file = source._log._reader.file
    assert not file.closed
    source.close()
    assert file.closed


def test_a_recording_waits_for_its_listener():
    assert replay_source.ReplaySource.waits_for_listener
    assert not EncoderSource.waits_for_listener


def test_a_path_may_begin_with_the_home_directory(tmp_path, monkeypatch):
    monkeypatch.setenv('HOME', str(tmp_path))
    write(tmp_path / 'recorded.log', stream(2))
    assert len(play(open_replay('~/recorded.log'))[0]) == 2
