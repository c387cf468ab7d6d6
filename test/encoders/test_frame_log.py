# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frames that a live source keeps: whole lines at any moment, and the same sets again."""

import can
from encoder_frames import cycle, sync, T0, values
from scripted_bus import cycles, error_frame, opening_of
from spm_haptic_master.encoders.log_file import FrameLog, free_path
from spm_haptic_master.simulation.source_factory import make_replay

# Error of a stamp in a log of microseconds (ns).
MICROSECOND = 1000


def replayed(path, **overrides):
    source = make_replay(values('replay', replay__path=str(path), **overrides))
    try:
        return [*source.recorded()]
    finally:
        source.close()


def test_every_frame_is_in_the_file_at_once(tmp_path):
    """A program that is killed loses none, and leaves whole lines."""
    path = tmp_path / 'motion.log'
    log = FrameLog(path)
    for number in range(10):
        for message in cycle(number):
            log.take(message)
        text = path.read_bytes()
        assert text.endswith(b'\n') and len(text.splitlines()) == 5 * (number + 1)
    assert len(replayed(path)) == 10  # without `close`


def test_no_file_is_overwritten(tmp_path):
    path = tmp_path / 'a.b_motion.log'
    for name in ('a.b_motion.log', 'a.b_motion_2.log', 'a.b_motion_3.log'):
        found = free_path(path)
        assert found == tmp_path / name
        found.write_text(name)


def test_no_frame_makes_no_file(tmp_path):
    log = FrameLog(tmp_path / 'motion.log')
    log.close()
    assert not log.path.exists() and log.error is None


def test_a_file_that_cannot_be_written_is_reported_and_stops_nothing(tmp_path):
    log = FrameLog(tmp_path / 'missing' / 'motion.log')
    log.take(sync(T0))
    log.close()
    log.take(sync(T0))
    log.close()
    assert 'No such file' in str(log.error)


def test_a_clock_that_is_set_back_a_little_leaves_a_log_that_can_be_read(tmp_path):
    log = FrameLog(tmp_path / 'motion.log')
    for number in (*range(50), *range(30, 100)):
        for message in cycle(number):
            log.take(message)
    log.close()
    assert len(replayed(log.path)) >= 90


def taken(driver, until, path):
    """Return the sets of a source that keeps its frames, and those of what it kept."""
    log = FrameLog(path)
    driver.keep(log.take)
    sets = []
    while driver.clock.now < until:
        sample = driver.read(min(0.01, until - driver.clock.now))
        if sample is not None:
            sets.append(sample)
    driver.close()
    log.close()
    return sets, replayed(path)


def check_same(sets, again):
    # A log ends before the SYNC that ends an incomplete cycle.
    assert len(again) == len(sets) > 150
    for live, kept in zip(sets, again, strict=True):
        assert kept.angles == live.angles and abs(kept.stamp - live.stamp) <= MICROSECOND


def test_a_replay_of_what_a_source_kept_gives_its_sets(rig, tmp_path):
    script = [*cycles(0.01, 120), *cycles(1.21, 5, without=(2,)), error_frame(1.262, 0x20),
              (1.263, can.Message(arbitration_id=0x5AB, data=b'\1\2', is_extended_id=True,
                                  timestamp=T0 + 1.263)), *cycles(1.27, 60)]
    check_same(*taken(rig(script), 2.0, tmp_path / 'motion.log'))


def test_sync_that_is_sent_and_not_received_is_kept_too(producing, tmp_path):
    driver, producer = producing((), rate=100.0)
    begin = driver.clock.now
    producer.openings, driver.buses[0].script = opening_of(cycles(begin + 0.01, 180))
    check_same(*taken(driver, begin + 2.0, tmp_path / 'motion.log'))
