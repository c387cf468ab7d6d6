# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The joint sample, and the protocol that every source of samples speaks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple


class JointSample(NamedTuple):
    """
    One coherent set of the four joint angles.

    Attributes
    ----------
    stamp : int
        When the set was sampled, ns since the Unix epoch.
    angles : tuple of 4 float
        th1A, th1B, th1C, th3A, rad, each in (-pi, pi].

    """

    stamp: int
    angles: tuple[float, float, float, float]


class EncoderSource(ABC):
    """
    Where joint samples come from: a CAN bus, a recording or a simulation.

    A source is read by one thread. A time-out is a value, a failure is an exception, and what is
    wrong with the encoders meanwhile stands in `fault`.
    """

    #: Whether the source should begin only once somebody listens (a recording must not be cut).
    waits_for_listener = False

    @abstractmethod
    def read(self, timeout: float) -> JointSample | None:
        """
        Return the next sample, or None if none came within `timeout` seconds.

        Raises
        ------
        SourceEnded
            There will be no more samples.
        ReplayError
            The recording is broken.

        """

    @property
    @abstractmethod
    def fault(self) -> str | None:
        """Why no samples come at present, or None."""

    @property
    def caution(self) -> str | None:
        """What an engineer should look at although samples come, or None."""
        return None

    @abstractmethod
    def statistics(self) -> dict[str, object]:
        """Counters and figures for diagnostics, by name."""

    def close(self) -> None:  # noqa: B027, nothing to release is the ordinary case
        """Release the hardware or file; harmless when called twice."""
