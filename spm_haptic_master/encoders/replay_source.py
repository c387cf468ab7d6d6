# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Joint samples from a recorded CAN session, decoded like a live bus, at the recorded pace."""

from __future__ import annotations

from collections.abc import Iterator
import gzip
from pathlib import Path
import time

import can
from can.io.generic import MessageReader
from spm_haptic_master.encoders.frame_decoder import FrameDecoder, WITHOUT_SYNC
from spm_haptic_master.encoders.log_file import open_log, trouble
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.exceptions import ReplayError, SettingError, SourceEnded
from spm_haptic_master.parameters.encoders import LOG_FORMATS

# Largest step back between two frames (s): recorders may swap frames within a cycle.
BACKWARDS_TOLERANCE = 1e-3
# Time between the last frame of a round and the first of the next one (s): a cycle at 1 kHz.
LOOP_GAP = 1e-3
# Shortest wait for the next set that is reported as a gap (s).
GAP = 0.05
# Frames without a set after which a read returns (some 10 ms of work), so that the reading thread
# notices the end of the process.
FRAMES_PER_READ = 1000
# Pause after these frames (s), in which the other threads take a signal or write a log line.
PAUSE = 1e-3
# Largest stamp of a frame (s): later than the 32 bits of a ROS message hold.
STAMP_LIMIT = 2.0 ** 32
# Sets of a round with one and the same stamp that show that the log has no times: two may share
# one in a log of 1 ms resolution.
SETS_AT_ONCE = 3
# Suffix of a format that is refused: python-can's writer of it (4.6) drops what it has not yet
# written when it is stopped, and nothing in the file shows that.
LOSSY_SUFFIX = '.db'
# Size of the blocks in which a compressed file is measured (bytes).
BLOCK = 1 << 20


class ReplaySource(EncoderSource):
    """
    Source that plays a log file.

    Stamps are the recorded ones, shifted to the present by one constant, their spacing divided by
    the rate.

    Parameters
    ----------
    path : str
        Log file, in a format that python-can reads.
    rate : float
        Pace against the recorded one: 2.0 plays twice as fast.
    loop : bool
        Whether to restart at the end.
    decoder : FrameDecoder
        Decoder of frames into sets, the same as on a live bus.

    Raises
    ------
    SettingError
        The file does not exist, or its format cannot be read, or not be trusted.
    ReplayError
        The file cannot be opened.

    """

    waits_for_listener = True

    def __init__(self, path: str, rate: float, loop: bool, decoder: FrameDecoder):
        self._path = Path(path).expanduser()
        if not self._path.is_file():
            raise SettingError('replay.path', path, 'an existing file')
        if self._path.suffix.lower() == LOSSY_SUFFIX:
            raise SettingError(
                'replay.path', str(self._path), f'a log in another format ({LOG_FORMATS}): '
                f'python-can drops frames when it ends a {LOSSY_SUFFIX}, without a trace in the '
                'file')
        self._rate = rate
        self._loop = loop
        self._decoder = decoder
        # Time at which the round's first frame is played, ns since the Unix epoch.
        self._shift: int
        # Recorded times of the round's first and latest frame, s.
        self._origin: float
        self._last = 0.0
        # Next set with the time at which it is due, ns since the Unix epoch.
        self._held: tuple[int, JointSample] | None = None
        # Number of frames since the latest set, and of sets at the beginning of the round.
        self._frames_without_set = 0
        self._sets_before = 0
        self._played = False
        self._rounds = 0
        self._messages = self._play()
        self._reader = self._open()

    def read(self, timeout: float) -> JointSample | None:
        """Return the next set at the time it is due, None if that is after `timeout` seconds."""
        if self._held is None:
            self._held = self._next_set()
            if self._held is None:
                return None
        due, sample = self._held
        ahead = (due - time.time_ns()) * 1e-9
        if ahead > timeout:
            time.sleep(timeout)
            return None
        if ahead > 0.0:
            time.sleep(ahead)
        self._held = None
        self._played = True
        return sample

    def recorded(self) -> Iterator[JointSample]:
        """
        Yield the sets of the whole log with their recorded stamps, without waiting.

        Raises
        ------
        ReplayError
            The recording is broken, or has no set.

        """
        self._decoder.reset()
        before = self._sets
        for message in self._checked():
            sample = self._decoder.feed(message)
            if sample is not None:
                yield sample
        self._require_sets(before)

    @property
    def fault(self) -> str | None:
        """Reason why there is no set at this point of the recording, or None."""
        held = self._held
        if self._played and held is not None and held[0] - time.time_ns() > GAP * 1e9:
            return 'a gap in the recording'
        if self._frames_without_set >= FRAMES_PER_READ:
            # In powers of ten: each other number would be a line of the log.
            frames = 10 ** (len(str(self._frames_without_set)) - 1)
            return f'no set of {self._decoder.words} in {frames} frames of the recording'
        return self._decoder.assembler.cause

    @property
    def caution(self) -> str | None:
        """Problem of the recorded encoders at this point of the recording, or None."""
        return self._decoder.caution(self._last)

    def statistics(self) -> dict[str, object]:
        """Return the counters and figures of the decoder, and the rounds played."""
        return {**self._decoder.statistics(self._last), 'rounds played': self._rounds}

    def close(self) -> None:
        """Close the file."""
        self._reader.stop()

    @property
    def _sets(self) -> int:
        return self._decoder.assembler.counters['sets']

    def _open(self) -> MessageReader:
        try:
            return open_log(self._path)
        except ValueError as error:
            raise SettingError(
                'replay.path', str(self._path), f'a log that python-can reads ({LOG_FORMATS})'
            ) from error
        except Exception as error:
            # As below: the exception depends on the reader.
            raise ReplayError(f'{self._path}: cannot be read: {trouble(self._path, error)}'
                              ) from error

    def _next_set(self) -> tuple[int, JointSample] | None:
        """
        Return the time at which the next set is due, its last frame's, and the set.

        None after `FRAMES_PER_READ` frames without one.
        """
        for message in self._messages:
            sample = self._decoder.feed(message)
            self._frames_without_set += 1
            if sample is not None:
                self._frames_without_set = 0
                if message.timestamp == self._origin \
                        and self._sets - self._sets_before >= SETS_AT_ONCE:
                    raise ReplayError(f'{self._path}: has no times: its first {SETS_AT_ONCE} sets '
                                      f'all have the stamp {message.timestamp:g} s')
                stamp = self._on_our_clock(sample.stamp * 1e-9)
                return self._on_our_clock(message.timestamp), sample._replace(stamp=stamp)
            if self._frames_without_set % FRAMES_PER_READ == 0:
                time.sleep(PAUSE)
                return None
        raise SourceEnded(f'{self._path}: played to its end, {self._sets} sets')

    def _on_our_clock(self, recorded: float) -> int:
        return self._shift + round((recorded - self._origin) / self._rate * 1e9)

    def _play(self) -> Iterator[can.Message]:
        """Yield the recorded frames, round after round if looped."""
        while True:
            self._sets_before = self._sets
            first = True
            for message in self._checked():
                if first:
                    self._begin_round(message.timestamp)
                    first = False
                yield message
            self._require_sets(self._sets_before)
            self._rounds += 1
            if not self._loop:
                return
            self._reader = self._open()

    def _require_sets(self, before: int) -> None:
        """Raise ReplayError if a round has added no set."""
        if self._sets == before:
            raise ReplayError(
                f'{self._path}: no set of {self._decoder.words} in it; its frames: '
                + (', '.join(f'{count} {reason}' for reason, count
                             in self._decoder.tally().most_common(4)) or 'none')
                + (f'; {WITHOUT_SYNC}' if self._decoder.sends_without_sync else ''))

    def _size(self) -> int:
        """Return the size of the log, bytes; of a compressed one, its size without compression."""
        if self._path.suffix.lower() != '.gz':
            return self._path.stat().st_size
        with gzip.open(self._path) as file:
            return sum(len(block) for block in iter(lambda: file.read(BLOCK), b''))

    def _begin_round(self, recorded: float) -> None:
        now = time.time_ns()
        if self._rounds:
            now = max(now, self._on_our_clock(self._last) + round(LOOP_GAP / self._rate * 1e9))
        self._shift, self._origin, self._last = now, recorded, recorded
        self._decoder.reset()

    def _checked(self) -> Iterator[can.Message]:
        """Yield the frames of one round; raise ReplayError where the file is broken."""
        count = 0
        last = None
        try:
            for message in self._reader:
                count += 1
                if not 0.0 <= message.timestamp < STAMP_LIMIT:
                    raise ReplayError(
                        f'{self._path}: the stamp of frame {count} is {message.timestamp:g} s; '
                        f'expected 0 to {STAMP_LIMIT:.0f} s')
                if last is not None and message.timestamp < last - BACKWARDS_TOLERANCE:
                    raise ReplayError(
                        f'{self._path}: time runs backwards at frame {count}, from '
                        f'{last:.6f} s to {message.timestamp:.6f} s')
                self._last = last = message.timestamp
                yield message
            # python-can does not report a truncated .blf; its header has the original size.
            recorded = getattr(self._reader, 'file_size', 0)
            if recorded and recorded > self._size():
                raise ReplayError(f'{self._path}: not readable after {count} frames: '
                                  f'truncated, {recorded} bytes were recorded')
        except ReplayError:
            raise
        except Exception as error:
            # On a truncated file, or one with the wrong suffix, the exception depends on
            # python-can's reader (ValueError, IndexError, struct.error, EOFError, ...).
            raise ReplayError(f'{self._path}: not readable after {count} frames: '
                              f'{trouble(self._path, error, self._reader)}') from error
