# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Simulated encoders as a source: noisy angles along a trajectory, quantised, at a fixed rate.

No bus is simulated: use `sim_bus` to see frames.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from math import isfinite, nan, radians, remainder
import time

import can
from spm_haptic_master.encoders.encoder_layout import angle_from_counts, counts_from_angle, TURN
from spm_haptic_master.encoders.harmonics import Harmonics
from spm_haptic_master.encoders.single_axis import AxisReading, SingleAxis
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.simulation.fault_injection import Fault
from spm_haptic_master.simulation.noisy_motion import NoisyMotion
from spm_haptic_master.simulation.simulated_axes import simulated_axis
from spm_haptic_master.timing import DeadlineGrid

# Largest lateness of a sample (s) at which the angles prepared for its deadline are used: a joint
# at 1 rad/s moves by half a count of 14 bits meanwhile. A real encoder has its angle at once, so
# the simulation should not delay the sample by computing it.
PUNCTUAL = 2e-4


class SimSource(EncoderSource):
    """
    Encoders on a simulated master, as a source of samples.

    Parameters
    ----------
    motion : NoisyMotion
        Motion that the sensors measure.
    rate : float
        Samples per second, Hz.
    counts_per_turn : tuple of N int
        Quantisation of each sensor.
    harmonics : tuple of N Harmonics or None
        What each reading is corrected by, as the driver does with those of a bus.
    axes : tuple of SingleAxis
        Insertion and gripper, if they have encoders.

    Attributes
    ----------
    rig : Rig
        The simulated rig.
    steering : Steering
        Leads the motion away from its trajectory.
    faults : tuple of Fault
        Faults that are present; another thread may replace them.

    """

    def __init__(
        self,
        motion: NoisyMotion,
        rate: float,
        counts_per_turn: tuple[int, ...],
        harmonics: tuple[Harmonics | None, ...],
        axes: tuple[SingleAxis, ...] = (),
    ):
        self.rig = motion.rig
        self.steering = motion.steering
        self._motion = motion
        self._counts_per_turn = counts_per_turn
        self._harmonics = harmonics
        # Insertion and gripper, and their motion.
        self.axes = axes
        self._axis_motions = tuple(map(simulated_axis, axes))
        # Stamp of the latest deadline, ns, until its readings of the axes are taken.
        self._axes_at: int | None = None
        self._period = 1.0 / rate
        self._grid = DeadlineGrid(self._period)
        self._began = 0
        self._sets = 0
        # The next deadline, s into the motion, and the angles there, computed in advance.
        self._due = 0.0
        self._prepared: tuple[float, ...] | None = None
        # The time of the last sample's angles, s into the motion.
        self._last = 0.0
        self.faults: tuple[Fault, ...] = ()
        # Where the stuck sensors got stuck, by sensor (rad).
        self._stuck: dict[int, float] = {}
        # The angles of the last pose within reach (rad): the first one is, by `make_motion`.
        self._reached: tuple[float, ...] = ()

    def read(self, timeout: float) -> JointSample | None:
        """
        Return the sample of the next deadline, stamped when the thread woke.

        Parameters
        ----------
        timeout : float
            Longest wait, s.

        Returns
        -------
        JointSample or None
            None if no deadline comes meanwhile, or if fewer than four sensors answer.

        """
        if self._prepared is None:
            self._prepared = self.angles(self._due)
        if not self._grid.wait(timeout):
            return None
        stamp = time.time_ns()
        if not self._began:
            self._began = stamp
        self._sets += 1
        t = (stamp - self._began) * 1e-9
        lateness = self._grid.lateness
        if lateness <= PUNCTUAL:
            self._last = self._due
            angles = self._prepared
        else:
            self._last = t
            angles = self.angles(t)
        since_deadline = lateness % self._period
        self._due = t - since_deadline + self._period
        self._prepared = None
        self._axes_at = stamp
        faults = self.faults
        if faults or self._stuck:
            angles = self._with_faults(angles, faults)
            present = sum(map(isfinite, angles))
            if present < len(JOINT_NAMES):
                return None
        return JointSample(stamp, angles)

    def take_readings(self) -> list[AxisReading]:
        """Return the readings of insertion and gripper at the latest deadline, by their frames."""
        stamp = self._axes_at
        self._axes_at = None
        if stamp is None:
            return []
        t = (stamp - self._began) * 1e-9
        seconds = stamp * 1e-9
        readings = []
        for axis, motion in zip(self.axes, self._axis_motions, strict=True):
            message = can.Message(
                timestamp=seconds,
                arbitration_id=axis.layout.can_id,
                data=axis.layout.data(motion.angle(t)),
            )
            reading = axis.take(message, seconds)
            if reading is not None:
                readings.append(reading._replace(stamp=stamp))
        return readings

    def angles(self, t: float) -> tuple[float, ...]:
        """
        Return the angles of healthy sensors, quantised and corrected.

        Parameters
        ----------
        t : float
            Time, s into the motion.

        Returns
        -------
        tuple of N float
            Angles, rad; where the pose is out of reach, those of the last pose within it.

        """
        with suppress(UnreachableError):
            self._reached = self._motion.angles(t)
        return tuple(map(_measured, self._reached, self._counts_per_turn, self._harmonics))

    def _with_faults(
        self,
        angles: tuple[float, ...],
        faults: Iterable[Fault],
    ) -> tuple[float, ...]:
        """Return what sensors with faults read, rad; NaN without an answer."""
        stuck = {}
        for joint in _joints('stuck', faults):
            stuck[joint] = self._stuck.get(joint, angles[joint])
        self._stuck = stuck
        read = list(angles)
        for joint, angle in stuck.items():
            read[joint] = angle
        for fault in faults:
            if fault.kind == 'offset' and fault.joint is not None:
                shifted = read[fault.joint] + radians(fault.value)
                read[fault.joint] = remainder(shifted, TURN)
        for joint in _joints('dropout', faults):
            read[joint] = nan
        return tuple(read)

    def orientation(self) -> tuple[float, float, float, float]:
        """Return the true R_base_platform of the last sample, quaternion x, y, z, w."""
        return self._motion.orientation(self._last)

    @property
    def fault(self) -> str | None:
        """Return which encoders do not answer, as requested, if too few do; or None."""
        return self._absence(suffices=False)

    @property
    def caution(self) -> str | None:
        """Return which encoders do not answer, as requested, if enough others do; or None."""
        return self._absence(suffices=True)

    def _absence(self, suffices: bool) -> str | None:
        """
        Return which encoders do not answer, in words.

        Parameters
        ----------
        suffices : bool
            Whether this is asked for the case that enough other encoders answer.

        Returns
        -------
        str or None
            None if all answer, or if the other case is present.

        """
        missing = _joints('dropout', self.faults)
        left = len(self._counts_per_turn) - len(missing)
        is_enough = left >= len(JOINT_NAMES)
        if not missing or suffices != is_enough:
            return None
        names = [ALL_JOINT_NAMES[joint] for joint in missing]
        return f'no answer of {", ".join(names)}'

    def statistics(self) -> dict[str, object]:
        """Return the numbers of sets made and of deadlines missed."""
        return {
            'sets': self._sets,
            'missed deadlines': self._grid.missed,
        }

    @property
    def lost(self) -> float:
        """Time by which the thread that reads it has missed its deadlines, s."""
        return self._grid.missed * self._period


def _joints(kind: str, faults: Iterable[Fault]) -> list[int]:
    """Return the joints that have a fault of a kind."""
    found = set()
    for fault in faults:
        if fault.kind == kind and fault.joint is not None:
            found.add(fault.joint)
    return sorted(found)


def _measured(
    angle: float,
    per_turn: int,
    harmonics: Harmonics | None,
) -> float:
    """Return an angle as the driver has it, rad: quantised, then corrected by its harmonics."""
    counts = counts_from_angle(
        angle=angle,
        zero_count=0,
        direction=1,
        counts_per_turn=per_turn,
    )
    reading = angle_from_counts(
        counts=counts,
        zero_count=0,
        direction=1,
        counts_per_turn=per_turn,
    )
    if harmonics is None:
        return reading
    return float(harmonics.angles(reading))
