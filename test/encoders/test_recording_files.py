# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Logs of every format, broken ones, frames that a source keeps, and tables; none overwritten."""

from contextlib import closing
import gzip

import can
from encoder_frames import cycle, record, stream, sync, T0, values
import pytest
from scripted_bus import cycles, error_frame, opening_of, run
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.recording_files import FrameLog, free_path, Table, write_new
from spm_haptic_master.exceptions import InputError, ReplayError, SettingError
from spm_haptic_master.simulation.source_factory import make_replay

FORMATS = (
    '.log',
    '.asc',
    '.blf',
    '.csv',
    '.trc',
    '.log.gz',
    '.asc.gz',
    '.blf.gz',
    '.csv.gz',
    '.trc.gz',
)


def replayed(path):
    """Return the sets of a recording, with their recorded stamps."""
    with closing(make_replay(values('replay', replay__path=str(path)))) as source:
        return [*source.recorded()]


@pytest.mark.parametrize('suffix', FORMATS)
def test_every_format_keeps_sets_and_spacing(tmp_path, monkeypatch, suffix):
    # python-can reads .blf.gz and does not write it.
    path = record(tmp_path / f'a{suffix}'.replace('.blf.gz', '.blf'), stream(*range(30)))
    if suffix == '.blf.gz':
        path = path.with_suffix('.blf.gz')
        path.write_bytes(gzip.compress(path.with_suffix('').read_bytes()))
    monkeypatch.setenv('HOME', str(tmp_path))
    got = replayed(f'~/{path.name}')
    assert [s.angles for s in got] == [pytest.approx((0.1, 0.2, 0.3, 0.4), abs=4e-4)] * 30
    spacing = [(b.stamp - a.stamp) * 1e-3 for a, b in zip(got, got[1:], strict=False)]
    # us; how finely a format writes the time.
    assert spacing == pytest.approx([1000.0] * 29, abs=110.0 if suffix.startswith('.trc') else 2.0)


@pytest.mark.parametrize('suffix', ['.log.gz', '.blf'])
def test_a_cut_recording_is_not_taken_for_a_whole_one(tmp_path, suffix):
    path = record(tmp_path / f'a{suffix}', stream(*range(700)))
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    with pytest.raises(ReplayError, match=f'{path}: not readable after'):
        replayed(path)


def test_of_a_line_that_is_no_frame_the_begin_is_quoted(tmp_path):
    for text, dots in (('x' * 60, ''), ('x' * 61, r' \.\.\.')):
        (tmp_path / 'a.log').write_text(text)
        with pytest.raises(ReplayError, match=f"line 1 is '{text[:60]}'{dots}; expected "):
            replayed(tmp_path / 'a.log')


def test_a_recording_without_one_encoder_has_no_set_and_names_it(tmp_path):
    frames = [frame for frame in stream(*range(20)) if frame.arbitration_id != 0x184]
    frames.append(canopen.frame(0x123, stamp=frames[-1].timestamp))
    # The four most frequent reasons.
    with pytest.raises(ReplayError, match='20 dropped: no answer from joint_3a$'):
        replayed(record(tmp_path / 'a.log', frames))
    with pytest.raises(ReplayError, match='its frames: none'):
        replayed(record(tmp_path / 'empty.log', []))


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('missing.log', 'an existing file'),
        ('.', 'an existing file'),
        # python-can's writer drops frames of a .db; what is left would play without a word.
        *(
            (name, r'a format that keeps all frames \(\.log, \.asc, \.blf')
            for name in ('a.txt', 'a.db', 'a.log.DB')
        ),
    ],
)
def test_a_path_that_is_not_a_log_is_refused(tmp_path, name, expected):
    if name.startswith('a.'):
        (tmp_path / name).write_text('nothing')
    with pytest.raises(SettingError, match=f"'replay.path' is .*{expected}"):
        replayed(tmp_path / name)


def test_frames_may_be_swapped_by_less_than_a_cycle(tmp_path):
    messages = stream(*range(10))
    last = messages[-1].timestamp

    def swapped(back):
        other = canopen.frame(0x123, stamp=last - back)
        return replayed(record(tmp_path / 'recorded.log', [*messages, other]))

    assert len(swapped(0.9e-3)) == 10
    with pytest.raises(
        ReplayError,
        match=f'time runs backwards at frame 51, from {last:.6f} s to {last - 1.1e-3:.6f} s',
    ):
        swapped(1.1e-3)


def test_no_file_is_overwritten(tmp_path):
    path = tmp_path / 'a.b_motion.log'
    for name in ('a.b_motion.log', 'a.b_motion_2.log', 'a.b_motion_3.log'):
        found = free_path(path)
        assert found == tmp_path / name
        found.write_text(name)


def test_a_clock_that_is_set_back_a_little_leaves_a_log_that_can_be_read(tmp_path):
    log = FrameLog(tmp_path / 'motion.log')
    for number in (*range(50), *range(30, 100)):
        for message in cycle(number):
            log.take(message)
    log.close()
    assert len(replayed(log.path)) >= 90


@pytest.mark.parametrize('produces', [False, True])
def test_the_replay_of_kept_frames_gives_the_same_sets(rig, producing, tmp_path, produces):
    """Also where SYNC is sent and not received."""
    script = [
        *cycles(0.01, 120),
        *cycles(1.21, 5, without=(2,)),
        error_frame(1.262, 0x20),
        (
            1.263,
            can.Message(
                arbitration_id=0x5AB, data=b'\1\2', is_extended_id=True, timestamp=T0 + 1.263
            ),
        ),
        *cycles(1.27, 60),
    ]
    if produces:
        driver, producer = producing((), rate=100.0)
        producer.openings, driver.buses[0].script = opening_of(script)
    else:
        driver = rig(script)
    log = FrameLog(tmp_path / 'motion.log')
    driver.keep(log.take)
    sets = run(driver, 2.0)
    log.close()
    again = replayed(log.path)
    # A log of microseconds ends before the SYNC that ends an incomplete cycle.
    assert len(again) == len(sets) > 150
    for live, kept in zip(sets, again, strict=True):
        assert kept.angles == live.angles
        assert abs(kept.stamp - live.stamp) <= 1000


def test_a_table_is_made_with_its_first_row_and_no_file_is_overwritten(tmp_path):
    path = tmp_path / 'made' / 'table.csv'
    table = Table(path, ('x', 'y'))
    assert (table.rows, table.span, path.exists()) == (0, (0, 0), False)
    for stamp in (1_000_000_001, 2_000_000_000, 3_000_000_000):
        table.write(stamp, (1.0, -2.5))
    table.close()
    assert path.read_text() == 'time,x,y\n' + ''.join(
        f'{time},1.000000000,-2.500000000\n'
        for time in ('1.000000001', '2.000000000', '3.000000000')
    )
    assert (table.rows, table.span) == (3, (1_000_000_001, 3_000_000_000))
    write_new(tmp_path / 'rig' / 'rig.json', '{}')
    for again in (lambda: Table(path, ()), lambda: write_new(tmp_path / 'rig' / 'rig.json', '')):
        with pytest.raises(InputError, match='already exists; choose another directory'):
            again()
    assert (tmp_path / 'rig' / 'rig.json').read_text() == '{}'


def test_what_cannot_be_written_is_named(tmp_path):
    (tmp_path / 'file').write_text('')
    path = tmp_path / 'file' / 'table.csv'
    for attempt in (lambda: Table(path, ()).write(0, ()), lambda: write_new(path, '')):
        with pytest.raises(InputError, match='table.csv: cannot be written: '):
            attempt()
    # A log stops nothing.
    log = FrameLog(path)
    log.close()
    assert log.error is None
    for _ in range(2):
        log.take(sync(T0))
        log.close()
        assert 'Not a directory' in str(log.error)
