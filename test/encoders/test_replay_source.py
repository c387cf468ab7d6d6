# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings: every format, the recorded spacing, and broken ones told in a line."""

import time

import can
from encoder_frames import cycle, values
import pytest
from recording import LOG

from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import ReplayError, SettingError, SourceEnded
from spm_haptic_master.source_factory import make_source

FORMATS = ('.log', '.asc', '.blf', '.csv', '.trc', '.log.gz', '.asc.gz', '.csv.gz', '.trc.gz')
# us; how finely a format writes the time.
RESOLUTION = {'.trc': 110.0}


def write(path, messages):
    """Record messages with python-can's own writer."""
    with can.Logger(str(path)) as logger:
        for message in messages:
            logger(message)
    return path


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


@pytest.mark.parametrize('suffix', FORMATS)
def test_every_format_keeps_sets_and_spacing(tmp_path, suffix):
    path = write(tmp_path / f'recorded{suffix}', stream(30))
    got, end = play(open_replay(path, replay__rate=1.0))
    assert end == f'{path}: played to its end, 30 sets'
    assert [s.angles for s in got] == [got[0].angles] * 30
    assert got[0].angles == pytest.approx((0.1, 0.2, 0.3, 0.4), abs=4e-4)
    spacing = [(b.stamp - a.stamp) * 1e-3 for a, b in zip(got, got[1:], strict=False)]
    assert spacing == pytest.approx([1000.0] * 29, abs=RESOLUTION.get(suffix.split('.gz')[0], 2.0))


def test_pace_and_stamps(tmp_path):
    path = write(tmp_path / 'recorded.log', stream(300))
    began = time.time()
    got, _ = play(open_replay(path, replay__rate=2.0))
    assert time.time() - began == pytest.approx(0.15, abs=0.1)
    assert got[0].stamp * 1e-9 == pytest.approx(began, abs=0.1)
    assert (got[-1].stamp - got[0].stamp) * 1e-9 == pytest.approx(0.1495, abs=1e-5)


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
    with pytest.raises(SettingError, match=r'\.log, \.asc, \.csv'):
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
