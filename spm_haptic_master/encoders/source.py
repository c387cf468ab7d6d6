# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The joint sample, and the interface that every source of samples implements."""

from __future__ import annotations

from abc import ABC, abstractmethod
import time
from typing import NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from spm_haptic_master.encoders.single_axis import AxisReading, SingleAxis


class JointSample(NamedTuple):
    """
    One coherent set of the joint angles, of which at least four have a reading.

    Attributes
    ----------
    stamp : int
        Sampling time of the set, ns since the Unix epoch.
    angles : tuple of N float
        Joint angles th1A, th1B, th1C, th3A, with five sensors th3B, with six th3C, rad, each in
        (-pi, pi]; NaN for a joint without a reading, of five or six sensors.

    """

    stamp: int
    angles: tuple[float, ...]


class EncoderSource(ABC):
    """
    Source of joint samples: a CAN bus, a recording or a simulation.

    A source is read by one thread. A timeout is a value, a failure is an exception, and an error
    of the encoders is reported by `fault`.

    Attributes
    ----------
    waits_for_listener : bool
        Whether reading should start only with the first listener: a recording would lose its
        start.
    axes : tuple of SingleAxis
        Encoders beside the set, insertion and gripper, that this source has.

    """

    waits_for_listener = False

    axes: tuple[SingleAxis, ...] = ()

    @property
    def axis_time(self) -> float:
        """Time on the clock of the axes' readings, s since the Unix epoch."""
        return time.time()

    def take_readings(self) -> list[AxisReading]:
        """Return the readings of the axes since the last call."""
        return []

    @abstractmethod
    def read(self, timeout: float) -> JointSample | None:
        """
        Return the next sample.

        Parameters
        ----------
        timeout : float
            Longest wait, s.

        Returns
        -------
        JointSample or None
            None if none came meanwhile, or an axis was read.

        Raises
        ------
        SourceEnded
            There are no more samples.
        ReplayError
            The recording is broken.

        """

    @property
    @abstractmethod
    def fault(self) -> str | None:
        """Reason why no samples come at present, or None."""

    @property
    def caution(self) -> str | None:
        """Problem that an engineer should investigate although samples come, or None."""
        return None

    @property
    def lost(self) -> float:
        """Time that a thread of its own has lost because it did not run when it was due, s."""
        return 0.0

    @abstractmethod
    def statistics(self) -> dict[str, object]:
        """Counters and figures for diagnostics, by name."""

    def close(self) -> None:  # noqa: B027, nothing to release is the ordinary case
        """Release the hardware or file; harmless when called twice."""
