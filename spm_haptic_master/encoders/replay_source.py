# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recorded CAN session, decoded as the live bus is, at its recorded pace."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import time

import can
from can.io.generic import MessageReader

from spm_haptic_master.encoders.frame_decoder import FrameDecoder
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.exceptions import ReplayError, SettingError, SourceEnded

# A recorder may write two frames of one bus in the wrong order, by less than a cycle; s.
BACKWARDS_TOLERANCE = 1e-3
# Between a loop's last frame and the first of the next round, s.
LOOP_GAP = 1e-3
# s to the next set from which on the recording counts as having a gap.
GAP = 0.05
FORMATS = '.log, .asc, .csv, .trc, each also with .gz, and .blf'


class ReplaySource(EncoderSource):
    """
    Plays a log that python-can reads.

    The stamps are the recorded ones, shifted by one constant to the present (and their spacing
    divided by the rate).

    Parameters
    ----------
    path : str
        The log file.
    rate : float
        1.0 plays at recorded pace, 2.0 twice as fast.
    loop : bool
        Start again at the end.
    decoder : FrameDecoder
        Frames to sets, the same as on a live bus.

    Raises
    ------
    SettingError
        There is no such file, or no reader for its format.

    """

    waits_for_listener = True

    def __init__(self, path: str, rate: float, loop: bool, decoder: FrameDecoder):
        self._path = Path(path).expanduser()
        if not self._path.is_file():
            raise SettingError('replay.path', path, 'a file that is there')
        self._rate = rate
        self._loop = loop
        self._decoder = decoder
        # Where the recording's time stands on this machine's clock, ns; set at the first frame.
        self._shift = 0
        self._origin = 0.0
        self._last = 0.0
        self._held: tuple[int, JointSample] | None = None
        self._played = False
        self._rounds = 0
        self._messages = self._play()
        self._reader = self._open()

    def read(self, timeout: float) -> JointSample | None:
        """Return the next set when it is due."""
        if self._held is None:
            self._held = self._next_set()
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

    @property
    def fault(self) -> str | None:
        """Why there is no set at this place of the recording."""
        held = self._held
        if self._played and held is not None and held[0] - time.time_ns() > GAP * 1e9:
            return 'a gap in the recording'
        return self._decoder.assembler.cause

    def statistics(self) -> dict[str, object]:
        """Return the decoder's counters and figures, and the rounds played."""
        return {**self._decoder.statistics(self._last), 'rounds played': self._rounds}

    def close(self) -> None:
        """Close the file."""
        self._reader.stop()

    @property
    def _sets(self) -> int:
        return self._decoder.assembler.counters['sets']

    def _open(self) -> MessageReader:
        try:
            return can.LogReader(str(self._path))
        except ValueError as error:
            raise SettingError(
                'replay.path', str(self._path), f'a log that python-can reads ({FORMATS})'
            ) from error
        except Exception as error:
            # As below: each reader in its own way.
            raise ReplayError(f'{self._path}: cannot be read: '
                              f'{type(error).__name__}: {error}') from error

    def _next_set(self) -> tuple[int, JointSample]:
        """Return the next set with its own stamp and when it is due (its last frame's time)."""
        for message in self._messages:
            sample = self._decoder.feed(message)
            if sample is not None:
                stamp = self._on_our_clock(sample.stamp * 1e-9)
                return self._on_our_clock(message.timestamp), sample._replace(stamp=stamp)
        raise SourceEnded(f'{self._path}: played to its end, '
                          f'{self._sets} sets')

    def _on_our_clock(self, recorded: float) -> int:
        return self._shift + round((recorded - self._origin) / self._rate * 1e9)

    def _play(self) -> Iterator[can.Message]:
        """Yield the recorded frames, round after round where looped."""
        while True:
            sets_before = self._sets
            first = True
            for message in self._checked():
                if first:
                    self._begin_round(message.timestamp)
                    first = False
                yield message
            if self._sets == sets_before:
                raise ReplayError(
                    f'{self._path}: no set of four encoders in it; its frames: '
                    + (', '.join(f'{count} {reason}' for reason, count
                                 in self._decoder.tally().most_common(4)) or 'none'))
            self._rounds += 1
            if not self._loop:
                return
            self._reader = self._open()

    def _begin_round(self, recorded: float) -> None:
        now = time.time_ns()
        if self._rounds:
            now = max(now, self._on_our_clock(self._last) + round(LOOP_GAP / self._rate * 1e9))
        self._shift, self._origin, self._last = now, recorded, recorded
        self._decoder.reset()

    def _checked(self) -> Iterator[can.Message]:
        """Yield one round's frames, and say what is wrong with a broken file."""
        count = 0
        last = None
        try:
            for message in self._reader:
                count += 1
                if last is not None and message.timestamp < last - BACKWARDS_TOLERANCE:
                    raise ReplayError(
                        f'{self._path}: time runs backwards at frame {count}, from '
                        f'{last:.6f} s to {message.timestamp:.6f} s')
                self._last = last = message.timestamp
                yield message
            # python-can ends quietly where a .blf is cut; its header knows better.
            recorded = getattr(self._reader, 'file_size', 0)
            if recorded > self._path.stat().st_size:
                raise ReplayError(f'{self._path}: not readable after {count} frames: it is cut, '
                                  f'{recorded} bytes were recorded')
        except ReplayError:
            raise
        except Exception as error:
            # Each of python-can's readers fails in its own way on a file that is cut or is not
            # what its name says (ValueError, IndexError, struct.error, EOFError, ...).
            raise ReplayError(f'{self._path}: not readable after {count} frames: '
                              f'{type(error).__name__}: {error}') from error
