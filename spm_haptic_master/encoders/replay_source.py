# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Joint samples from a recorded CAN session, decoded like a live bus, at the recorded pace."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterator
import time

import can
from spm_haptic_master.encoders.frame_decoder import FrameDecoder, WITHOUT_SYNC
from spm_haptic_master.encoders.log_file import LogFile
from spm_haptic_master.encoders.single_axis import AxisReading
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.exceptions import ReplayError, SourceEnded

# Time between the last frame of a round and the first of the next one (s): a cycle at 1 kHz.
LOOP_GAP = 1e-3
# Shortest wait for the next set that is reported as a gap, and the longest (s): a clock that was
# set forward while the log was recorded makes no replay wait for an hour.
GAP = 0.05
LONGEST_GAP = 5.0
# Least number of sets, and share of them with which the time stands still, that show that a log's
# times are too coarse for its sets (unit 1). A clock that was set back stands still once.
SETS_COMPARED = 100
COARSE = 0.02
# Frames without a set after which a read returns (some 10 ms of work), so that the reading thread
# notices the end of the process.
FRAMES_PER_READ = 1000
# Pause after these frames (s), in which the other threads take a signal or write a log line.
PAUSE = 1e-3
# Sets of a round with one and the same stamp that show that the log has no times: two may share
# one in a log of 1 ms resolution.
SETS_AT_ONCE = 3


class ReplaySource(EncoderSource):
    """
    Source that plays a log file, and again if that is asked for.

    Stamps are the recorded ones, shifted to the present by one constant, their spacing divided by
    the rate; a longer gap than `LONGEST_GAP` is played as one of that length.

    Parameters
    ----------
    path : str
        Log file.
    rate : float
        Rate against the recorded pace (unit 1).
    loop : bool
        Whether it restarts after its end.
    decoder : FrameDecoder
        What makes sets of frames.
    channel : str
        Channel, where several channels of the log have frames of the encoders.

    Raises
    ------
    SettingError, ReplayError
        As of LogFile.

    """

    waits_for_listener = True

    def __init__(
        self,
        path: str,
        rate: float,
        loop: bool,
        decoder: FrameDecoder,
        channel: str,
    ):
        self._log = LogFile(path)
        self._channel = self._log.select_channel(
            {(layout.can_id, layout.extended) for layout in decoder.layouts}, channel
        )
        self._rate = rate
        self._loop = loop
        self._decoder = decoder
        self.axes = decoder.axes
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
        # Length of the latest gap and its place in the round, s.
        self._gap = 0.0, 0.0
        # Number of sets of the round, how often the time began to stand still, the latest stamp,
        # and whether it stands still.
        self._compared = self._stops = self._latest = 0
        self._stands = False
        self._played = False
        self._rounds = 0
        self._messages = self._play()

    def read(self, timeout: float) -> JointSample | None:
        """
        Return the next set at the time it is due.

        Parameters
        ----------
        timeout : float
            Longest wait, s.

        Returns
        -------
        JointSample or None
            None if no set is due meanwhile, or after many frames without one.

        Raises
        ------
        SourceEnded
            The recording is played to its end.
        ReplayError
            It is broken, has no sets, or its times are too coarse.

        """
        self._held = self._held or self._next_set()
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
        """Yield all sets with recorded stamps, in place of `read`; ReplayError where it fails."""
        for found in self.recorded_with_axes():
            if isinstance(found, JointSample):
                yield found

    def recorded_with_axes(self) -> Iterator[JointSample | AxisReading]:
        """Yield sets, and readings of the axes, with recorded stamps; errors as `recorded`."""
        yield from self.recorded_readings()
        self._require_sets()

    def recorded_readings(self) -> Iterator[JointSample | AxisReading]:
        """Yield all that `recorded_with_axes` does, of a log that needs no sets."""
        for message in self._frames():
            self._last = message.timestamp
            sample = self._decoder.feed(message)
            while self._decoder.readings:
                yield self._decoder.readings.popleft()
            if sample is not None:
                self._check_times(sample)
                yield sample

    @property
    def cycles(self) -> int:
        """Return the number of cycles of the bus so far, with and without a set."""
        return self._decoder.assembler.counters['cycles']

    @property
    def dropped(self) -> Counter[str]:
        """Return the number of cycles and frames from which no set came, by reason."""
        return Counter(
            {
                reason: count
                for reason, count in self._decoder.tally().items()
                if reason.startswith('dropped: ') or ' rejected: ' in reason
            }
        )

    @property
    def axis_time(self) -> float:
        """Time on the clock of the axes' readings, s: that of the recording."""
        return self._last

    def take_readings(self) -> list[AxisReading]:
        """Return the readings of the axes that are due since the last call."""
        now = time.time_ns()
        due: list[AxisReading] = []
        readings = self._decoder.readings
        while readings and (stamp := self._on_our_clock(readings[0].stamp * 1e-9)) <= now:
            due.append(readings.popleft()._replace(stamp=stamp))
        return due

    @property
    def fault(self) -> str | None:
        """Reason why there is no set at this point of the recording, or None."""
        held = self._held
        if self._played and held is not None and held[0] - time.time_ns() > GAP * 1e9:
            length, place = self._gap
            return f'a gap of {length:.1f} s in the recording, {place:.1f} s after its beginning'
        if self._frames_without_set >= FRAMES_PER_READ:
            return f'no set of {self._decoder.words} in {FRAMES_PER_READ} frames of the recording'
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
        self._messages.close()

    @property
    def _sets(self) -> int:
        """Return the number of sets so far, over all rounds."""
        return self._decoder.assembler.counters['sets']

    def _next_set(self) -> tuple[int, JointSample] | None:
        """Return the next set and when it is due, or None after many frames without one."""
        for message in self._messages:
            sample = self._decoder.feed(message)
            self._frames_without_set += 1
            if sample is not None:
                self._frames_without_set = 0
                self._check_times(sample)
                if (
                    message.timestamp == self._origin
                    and self._sets - self._sets_before >= SETS_AT_ONCE
                ):
                    raise ReplayError(
                        f'{self._log.path}: has no times: its first {SETS_AT_ONCE} '
                        f'sets all have the stamp {message.timestamp:g} s'
                    )
                stamp = self._on_our_clock(sample.stamp * 1e-9)
                return self._on_our_clock(message.timestamp), sample._replace(stamp=stamp)
            if self._frames_without_set % FRAMES_PER_READ == 0:
                time.sleep(PAUSE)
                return None
        raise SourceEnded(f'{self._log.path}: played to its end, {self._sets} sets')

    def _on_our_clock(self, recorded: float) -> int:
        """Return when a recorded time, s, is played, ns since the Unix epoch."""
        return self._shift + round((recorded - self._origin) / self._rate * 1e9)

    def _play(self) -> Generator[can.Message, None, None]:
        """Yield the recorded frames, round after round if looped."""
        while True:
            self._sets_before = self._sets
            for number, message in enumerate(self._frames()):
                if number == 0:
                    now = time.time_ns()
                    if self._rounds:
                        now = max(
                            now,
                            self._on_our_clock(self._last) + round(LOOP_GAP / self._rate * 1e9),
                        )
                    self._shift = now
                    self._origin = message.timestamp
                    self._compared = self._stops = self._latest = 0
                    self._decoder.assembler.reset()
                elif message.timestamp - self._last > GAP:
                    self._note_gap(message.timestamp - self._last)
                self._last = message.timestamp
                yield message
            self._require_sets()
            self._rounds += 1
            if not self._loop:
                return

    def _frames(self) -> Iterator[can.Message]:
        """Yield the frames of the selected channel, and those without one."""
        for message in self._log.frames():
            if not self._channel or self._log.channel_of(message) in ('', self._channel):
                yield message

    def _note_gap(self, length: float) -> None:
        """
        Note a gap between two frames, and shorten one that nobody would wait for.

        Parameters
        ----------
        length : float
            Length of the gap, s of the recording.

        """
        self._gap = length, self._last - self._origin
        if length > LONGEST_GAP:
            self._shift -= round((length - LONGEST_GAP) / self._rate * 1e9)

    def _check_times(self, sample: JointSample) -> None:
        """Raise ReplayError where too many sets are not later than the one before."""
        stands = sample.stamp <= self._latest
        if stands and not self._stands:
            self._stops += 1
        self._stands = stands
        self._latest = max(self._latest, sample.stamp)
        self._compared += 1
        if self._compared >= SETS_COMPARED and self._stops > COARSE * self._compared:
            raise ReplayError(
                f'{self._log.path}: its times are too coarse: of {self._compared} sets many have '
                'the time of the one before; record it with times of 0.1 ms or finer'
            )

    def _require_sets(self) -> None:
        """Raise ReplayError, with what the frames were, for a round without a set."""
        if self._sets == self._sets_before:
            raise ReplayError(
                f'{self._log.path}: no set of {self._decoder.words} in it; its frames: '
                + (
                    ', '.join(
                        f'{count} {reason}'
                        for reason, count in self._decoder.tally().most_common(4)
                    )
                    or 'none'
                )
                + (f'; {WITHOUT_SYNC}' if self._decoder.sends_without_sync else '')
            )
