# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The counts of one encoder as they come: how they move, and whether its layout fits them.

A wrong layout shows in counts that jump as the joint turns, or that are beyond a turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.encoders.encoder_layout import EncoderLayout, TURN

# Changes of the counts after which their travel is compared, and how much longer it is in the
# wrong byte order: a step of one count is one of 256 there.
FEWEST_CHANGES = 10
TIMES_LONGER = 8
# Share of the frames with counts beyond a turn from which on a layout does not fit (unit 1): an
# encoder may have an error value now and then.
BEYOND_SHARE = 0.2
# Smallest movement that is one (rad): more than the noise of an encoder at rest.
LEAST_MOVEMENT = 0.004


@dataclass(slots=True)
class CountsTrack:
    """
    Counts by one layout: unwrapped, with their span and travel; in counts.

    Attributes
    ----------
    layout : EncoderLayout
        Where the counts are in a frame.
    latest : int or None
        Latest counts; None before the first.
    frames : int
        Number of frames.
    beyond : int
        Number of frames with a value of a turn or more.
    changes : int
        Number of frames with other counts than the one before.
    travel : int
        Sum of all steps, without sign.
    position : int
        Counts without the wraps, from the first counts on.
    least, greatest : int
        Extremes of the position.

    """

    layout: EncoderLayout
    latest: int | None = None
    frames: int = 0
    beyond: int = 0
    changes: int = 0
    travel: int = 0
    position: int = 0
    least: int = 0
    greatest: int = 0

    def take(self, data: bytes | bytearray) -> None:
        """Take the data of a frame."""
        self.frames += 1
        before = self.latest
        counts = self.layout.counts(data)
        if counts is None:
            self.beyond += 1
            return
        self.latest = counts
        if before is None or before == counts:
            return
        turn = self.layout.counts_per_turn
        step = (counts - before + turn // 2) % turn - turn // 2
        self.changes += 1
        self.travel += abs(step)
        self.position += step
        self.least = min(self.least, self.position)
        self.greatest = max(self.greatest, self.position)

    @property
    def fits(self) -> bool:
        """Return whether nearly all frames have counts below a turn."""
        return self.beyond <= BEYOND_SHARE * self.frames


def smaller_resolution(angles: NDArray[np.float64], counts_per_turn: Sequence[int]) -> int | None:
    """
    Return the smaller resolution that all encoders may have.

    That no count reaches it does not prove it: the joints may have moved in that part of a turn
    alone.

    Parameters
    ----------
    angles : ndarray, shape (n, N)
        Raw angles of a whole motion, rad: counts times 2 pi / counts_per_turn.
    counts_per_turn : sequence of N int
        Configured counts per turn of each encoder.

    Returns
    -------
    int or None
        Smallest power of two above all counts; None if it is not at most half a turn.

    """
    if not len(angles):
        return None
    counts = np.round(angles % TURN * np.array(counts_per_turn) / TURN)
    largest = int(np.max(counts))
    smaller = 1 << max(1, largest).bit_length()
    if 2 * smaller <= min(counts_per_turn):
        return smaller
    return None


class CountsWatch:
    """
    Counts of one encoder by its layout, and by the other byte order.

    Parameters
    ----------
    layout : EncoderLayout
        Configured layout.

    Attributes
    ----------
    track : CountsTrack
        Counts by that layout.
    heard : float or None
        Time of the latest frame, s.
    healthy : bool
        Whether the status bits of that frame were good.
    other_length : int or None
        Length of the latest frame with another length than configured, bytes.

    """

    def __init__(self, layout: EncoderLayout):
        self.layout = layout
        self.track = CountsTrack(layout)
        self._other_order: Literal['little', 'big'] = 'little'
        if layout.byte_order == 'little':
            self._other_order = 'big'
        self._other = CountsTrack(replace(layout, byte_order=self._other_order))
        self.heard: float | None = None
        self.healthy = True
        self.other_length: int | None = None
        # Position at the latest `moved`, counts.
        self._shown = 0

    def take(self, data: bytes | bytearray, stamp: float) -> None:
        """
        Take a frame; one of another length is no frame of this layout.

        Parameters
        ----------
        data : bytes
            Data of the frame.
        stamp : float
            Receive time, s.

        """
        if len(data) != self.layout.data_length:
            self.other_length = len(data)
            return
        self.heard = stamp
        self.healthy = self.layout.healthy(data)
        self.track.take(data)
        if self.layout.byte_length > 1:
            self._other.take(data)

    @property
    def angle(self) -> float | None:
        """Return the latest counts as an angle from count 0, rad in [0, 2 pi); None without."""
        latest = self.track.latest
        if latest is None:
            return None
        turn = self.layout.counts_per_turn
        return latest % turn * TURN / turn

    @property
    def span(self) -> float:
        """Return the angle over which it has moved, rad."""
        return (self.track.greatest - self.track.least) * TURN / self.layout.counts_per_turn

    def moved(self) -> float:
        """Return by how much it has moved since the last call, rad; 0 for noise."""
        counts = abs(self.track.position - self._shown)
        moved = counts * TURN / self.layout.counts_per_turn
        self._shown = self.track.position
        if moved > LEAST_MOVEMENT:
            return moved
        return 0.0

    def problem(self) -> str | None:
        """
        Return why the layout does not fit the counts.

        Returns
        -------
        str or None
            Which setting is probably another one; None where the layout fits.

        """
        track = self.track
        other = self._other
        if not track.frames:
            return None
        reads = f'encoders.byte_order is {self.layout.byte_order}'
        if not track.fits:
            share = f'{track.beyond} of {track.frames} frames have counts of a turn or more'
            if other.frames and other.fits:
                return f'{share}: {reads}, and {self._other_order} fits'
            return (
                f'{share}: encoders.counts_per_turn ({self.layout.counts_per_turn}), .mask, '
                '.byte_offset or .byte_order is another one'
            )
        jumps = other.changes >= FEWEST_CHANGES and track.travel > TIMES_LONGER * other.travel
        if jumps and other.fits:
            return (
                f'its counts jump as it turns: {reads}, and in the order {self._other_order} '
                'they do not jump'
            )
        return None
