# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Record a bring-up of force: a step of each motor, releases, and poses for the weight."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import csv
from dataclasses import dataclass
from math import isfinite, pi, remainder
from pathlib import Path
import time

import numpy as np
from spm_haptic_master.calibration.motor_bring_up import (
    MOTOR_JOINTS,
    step_response,
    StepResponse,
    wiring_faults,
)
from spm_haptic_master.drives.drives import Drives
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force import ForceLimits
from spm_haptic_master.force.joint_motion import JointMotion
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.force.statics import clipped
from spm_haptic_master.kinematics import estimate_sample, Geometry, UsedSensors
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion

# Columns of a recording.
ANGLES = ['th1a', 'th1b', 'th1c', 'th3a']
TORQUES = ['tau1a', 'tau1b', 'tau1c', 'tau3a']
# Longest time until angles come and the drives are ready, and between two steps of them meanwhile
# (s).
READY = 30.0
WAIT = 0.005
# Times of a step and of a release (s): its rest begins to be recorded, ends, the torque ends, the
# opposite torque of a step ends, and all of it.
SHOWN = 0.55
REST = 0.6
PUSH = 0.65
BACK = 0.7
END = 0.8
# Torque of a motor alone, and about the handle's z axis (N m): a turn of some degrees.
STEP = 0.01
RELEASES = (0.005, -0.01, 0.01, -0.005)
# Turn of a joint in a step or release that ends the recording (rad): nothing of it turns so far.
FARTHEST = 0.6
# The same of a step of one motor: 0.06 rad on the paper's mechanism.
FARTHEST_STEP = 0.15
# Of a pose: largest turn of a joint at rest, least turn of one from every other pose, and the turn
# of one by which a hand takes the handle back (rad).
STILL = 0.01
APART = 0.15
TAKEN = 0.1
# Spring and damping of each joint (N m/rad, N m s/rad), and the largest torque of a motor (N m).
STIFFNESS = 1.0
DAMPING = 0.02
LARGEST = 0.3
# Time at rest before the motors hold, until the hand has let go, and at rest after that; time for
# which the spring comes up, and that is recorded; longest time of a pose (s).
SETTLED = 1.0
LET_GO = 3.0
QUIET = 1.0
RAMP = 0.5
RECORDED = 0.5
PATIENCE = 300.0

Torques = tuple[float, ...]


class BringUp:
    """
    A device in a bring-up, sample by sample, and what is recorded of it.

    Parameters
    ----------
    source : EncoderSource
        Source of the angles.
    drives : Drives
        Drives that take the torques.
    geometry : Geometry
        Link angles and axes of the mechanism.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.
    sigma : tuple of float
        Noise of the encoders, rad, 1 standard deviation.
    silence : float
        Longest time without angles, s.
    show : callable
        Takes what a person has to know.

    Attributes
    ----------
    nothing : tuple of float
        Zero torque of each motor, N m.
    rows : list
        Part, time in it, s, angles, rad, and torques, N m, of each recorded sample.
    part : str
        Name of the current part.
    angles : tuple of float
        Latest joint angles, rad.
    since : float
        Time in the part, s.
    still : float
        Time since a joint has turned by more than `STILL`, s.

    """

    def __init__(
        self,
        source: EncoderSource,
        drives: Drives,
        geometry: Geometry,
        working_mode: WorkingMode,
        sigma: tuple[float, ...],
        silence: float,
        show: Callable[[str], None],
    ) -> None:
        self._source = source
        self._drives = drives
        self._silence = silence
        self.show = show
        self._geometry = geometry
        self._sensors = UsedSensors(sigma)
        self._statics = make_statics(geometry, working_mode, drives.motors, ForceLimits())
        self.nothing: Torques = (0.0,) * drives.motors
        # Part, time, angles and torques of each recorded sample.
        self.rows: list[tuple[str, float, Torques, Torques]] = []

    def wait(self) -> None:
        """
        Wait until angles come and the drives are ready, without torque.

        Raises
        ------
        InputError
            That takes longer than `READY`.

        """
        end = time.monotonic() + READY
        while time.monotonic() < end:
            sample = self._source.read(WAIT)
            report = self._drives.step(self.nothing, time.monotonic())
            if sample is not None and report.ready:
                return
        raise InputError(
            f'no set of angles within {READY:g} s: {self._source.fault}'
            if sample is None
            else f'the drives are not ready after {READY:g} s: {report.fault}'
        )

    def begin(self, part: str) -> None:
        """
        Begin a part with the next sample.

        Parameters
        ----------
        part : str
            Name of the part.

        Raises
        ------
        InputError
            No angles come.

        """
        self.part, self._motion = part, JointMotion(len(self.nothing))
        self._start, self.angles = self._read()
        # Times in the part, and since a joint has turned, s.
        self.since = self.still = self._near_since = 0.0
        self._near = self.angles
        self._motion.follow(self._start, self.angles, self.nothing, 0.0)

    def step(self, torques: Torques, recorded: bool = False) -> None:
        """
        Command torques for the latest sample, and take the next one.

        Parameters
        ----------
        torques : Torques
            Torque of each motor, N m.
        recorded : bool, optional
            Whether the latest sample is recorded, with these torques.

        Raises
        ------
        InputError
            The drives are no longer ready, no angles come, or the part takes too long.

        """
        report = self._drives.step(torques, time.monotonic())
        if not report.ready:
            raise InputError(f'{self.part}: the drives are no longer ready: {report.fault}')
        if recorded:
            self.rows.append((self.part, self.since, self.angles[:4], torques))
        if self.since > PATIENCE:
            raise InputError(f'{self.part}: not at rest within {PATIENCE:g} s')
        stamp, self.angles = self._read()
        before = self.since
        self.since = 1e-9 * (stamp - self._start)
        self._motion.follow(stamp, self.angles, self.nothing, self.since - before)
        if self.turn(self._near) > STILL:
            self._near = self.angles
            self._near_since = self.since
        self.still = self.since - self._near_since

    def turn(self, angles: Torques) -> float:
        """
        Return the largest turn of a joint from given angles.

        Parameters
        ----------
        angles : Torques
            Joint angles, rad.

        Returns
        -------
        float
            rad, 0 or more.

        """
        return max(
            abs(remainder(a - b, 2.0 * pi)) for a, b in zip(self.angles, angles, strict=True)
        )

    def about_z(self, torque: float) -> Torques:
        """
        Return the motor torques of a torque about the handle's z axis.

        By virtual work at the estimated orientation (`force.statics`).

        Parameters
        ----------
        torque : float
            About the platform's z axis, N m.

        Returns
        -------
        Torques
            Torque of each motor, N m.

        """
        R = rotation_from_quaternion(
            *estimate_sample(self.angles[:4], self._sensors, self._geometry).quaternion
        )
        self._statics.place(R)
        return self._statics.render((torque * R[2], torque * R[5], torque * R[8]))[0]

    def spring(
        self,
        stiffness: float,
        angles: Torques,
        largest: float,
    ) -> Torques:
        """
        Return the torques of a spring and a damper on each motor's joint.

        Parameters
        ----------
        stiffness : float
            Stiffness of each joint, N m/rad.
        angles : Torques
            Joint angles at which the springs are at rest, rad.
        largest : float
            Limit of each motor's torque, N m.

        Returns
        -------
        Torques
            Torque of each motor, N m; none before a velocity is known.

        """
        velocity = self._motion.velocity
        if velocity is None:
            return self.nothing
        return tuple(
            [
                clipped(stiffness * remainder(centre - angle, 2.0 * pi) - DAMPING * rate, largest)
                for centre, angle, rate in zip(angles, self.angles, velocity, strict=False)
            ]
        )

    def _read(self) -> tuple[int, Torques]:
        """
        Return stamp and angles of the next set.

        Returns
        -------
        stamp : int
            Time, ns.
        angles : tuple of float
            Joint angles, rad.

        Raises
        ------
        InputError
            No set comes in time, or it lacks an angle.

        """
        sample = self._source.read(self._silence)
        if sample is None:
            raise InputError(f'no set of angles within {self._silence:g} s: {self._source.fault}')
        if not isfinite(sum(sample.angles)):
            raise InputError(f'angles {sample.angles}: expected those of all joints')
        return sample.stamp, sample.angles


def record(
    path: Path,
    bring_up: BringUp,
    poses: int = 0,
) -> None:
    """
    Move the device through a bring-up, and write the recording.

    First each motor makes a step. Only where the steps show nothing wrong, the motors release
    the handle, and hold it in poses to which a hand brings it.

    Parameters
    ----------
    path : Path
        CSV file to write.
    bring_up : BringUp
        The device.
    poses : int, optional
        Number of poses.

    Raises
    ------
    InputError
        No angles come, the drives are not ready, a joint turns too far, or the file cannot be
        written.

    """
    bring_up.wait()
    motors = range(len(bring_up.nothing))
    responses = [_step(bring_up, motor) for motor in motors]
    if not wiring_faults(responses):
        for number, torque in enumerate(RELEASES, start=1):
            _release(bring_up, f'release z {number}', torque)
        held: list[Torques] = []
        while len(held) < poses:
            bring_up.show(
                f'pose {len(held) + 1} of {poses}: bring the handle to a new pose, 10 '
                'deg or more from the others, and keep it still'
            )
            held.append(_pose(bring_up, held))
        bring_up.show('all parts are recorded: the motors no longer hold the handle')
    try:
        with path.open('w', encoding='utf-8', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(('part', 'time', *ANGLES, *TORQUES[: len(motors)]))
            writer.writerows(
                (name, f'{since:.6f}', *angles, *torques)
                for name, since, angles, torques in bring_up.rows
            )
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error


@dataclass(frozen=True, slots=True)
class Stage:
    """
    Part of a motion with one rule for the torques.

    Attributes
    ----------
    end : float
        Time in the part at which it ends, s.
    torques : callable
        Returns the torque of each motor for a sample, N m.
    recorded : bool
        Whether its samples are recorded.

    """

    end: float
    torques: Callable[[], Torques]
    recorded: bool = False


def _step(bring_up: BringUp, motor: int) -> StepResponse:
    """
    Turn one motor alone, there and back.

    Parameters
    ----------
    bring_up : BringUp
        The device.
    motor : int
        Index of the motor.

    Returns
    -------
    StepResponse
        What the step did.

    Raises
    ------
    InputError
        A joint turns farther than `FARTHEST_STEP`.

    """
    name = f'step {ANGLES[motor][2:]}'
    before = len(bring_up.rows)
    nothing = bring_up.nothing

    def alone(torque: float) -> Torques:
        """Return a torque of this motor, none of the others."""
        return (*nothing[:motor], torque, *nothing[motor + 1 :])

    # The opposite step takes the speed away again, whatever the sign.
    stages = (
        Stage(SHOWN, lambda: nothing),
        Stage(
            end=REST,
            torques=lambda: nothing,
            recorded=True,
        ),
        Stage(
            end=PUSH,
            torques=lambda: alone(STEP),
            recorded=True,
        ),
        Stage(BACK, lambda: alone(-STEP)),
        Stage(END, lambda: nothing),
    )
    _move(
        bring_up=bring_up,
        part=name,
        stages=stages,
        farthest=FARTHEST_STEP,
        remedy=(
            f'by {STEP:g} N m of the motor on {MOTOR_JOINTS[motor]} alone; is its rated torque '
            'right, is the device balanced, and does nobody hold it?'
        ),
    )
    own = bring_up.rows[before:]
    return step_response(
        motor,
        np.array([torques[motor] for *_, torques in own]),
        np.array([angles for _, _, angles, _ in own]),
    )


def _release(
    bring_up: BringUp,
    name: str,
    torque: float,
) -> None:
    """
    Turn the handle from rest for a moment, and let it go.

    Parameters
    ----------
    bring_up : BringUp
        The device.
    name : str
        Name of the part.
    torque : float
        Torque about the handle's z axis, N m.

    Raises
    ------
    InputError
        A joint turns farther than `FARTHEST`.

    """
    stages = (
        Stage(SHOWN, lambda: bring_up.spring(0.0, bring_up.angles, STEP)),
        Stage(
            end=REST,
            torques=lambda: bring_up.nothing,
            recorded=True,
        ),
        Stage(
            end=PUSH,
            torques=lambda: bring_up.about_z(torque),
            recorded=True,
        ),
        Stage(
            end=END,
            torques=lambda: bring_up.nothing,
            recorded=True,
        ),
    )
    _move(
        bring_up=bring_up,
        part=name,
        stages=stages,
        farthest=FARTHEST,
        remedy='is the device balanced, and does nobody hold it?',
    )


def _move(
    bring_up: BringUp,
    part: str,
    stages: Iterable[Stage],
    farthest: float,
    remedy: str,
) -> None:
    """
    Do a part by stages.

    Parameters
    ----------
    bring_up : BringUp
        The device.
    part : str
        Name of the part.
    stages : iterable of Stage
        Stages in the order of their ends.
    farthest : float
        Turn of a joint that ends the recording, rad.
    remedy : str
        What may be wrong then, in words.

    Raises
    ------
    InputError
        A joint turns too far.

    """
    bring_up.show(part)
    bring_up.begin(part)
    first = bring_up.angles
    for stage in stages:
        while bring_up.since < stage.end:
            bring_up.step(stage.torques(), stage.recorded)
            turn = bring_up.turn(first)
            if turn > farthest:
                raise InputError(
                    f'{part}: a joint turned by {turn:.2f} rad, expected less than '
                    f'{farthest:g}: {remedy}'
                )


def _pose(bring_up: BringUp, others: list[Torques]) -> Torques:
    """
    Let the motors hold the handle where a hand brings it, and record it at rest.

    The spring comes up over `RAMP`. After the recording the motors let go when the hand turns a
    joint by `TAKEN`.

    Parameters
    ----------
    bring_up : BringUp
        The device.
    others : list of Torques
        Angles of the poses before, from which the new one has to be away.

    Returns
    -------
    Torques
        Joint angles of the pose, rad.

    Raises
    ------
    InputError
        The handle does not come to rest.

    """
    name = f'pose {len(others) + 1}'
    bring_up.begin(name)
    while bring_up.still < SETTLED or any(bring_up.turn(each) <= APART for each in others):
        bring_up.step(bring_up.nothing)
    bring_up.show(f'{name}: let go of the handle: the motors hold it')
    held = bring_up.angles
    began = bring_up.since

    def hold(
        until: Callable[[], bool],
        recorded: bool = False,
    ) -> None:
        """Hold the pose until a condition is true."""
        while not until():
            rise = min(1.0, (bring_up.since - began) / RAMP)
            bring_up.step(bring_up.spring(STIFFNESS * rise, held, LARGEST), recorded)

    hold(lambda: bring_up.since - began >= LET_GO and bring_up.still >= QUIET)
    bring_up.show(f'{name}: at rest, recording')
    pose = bring_up.angles
    end = bring_up.since + RECORDED
    hold(lambda: bring_up.since >= end, recorded=True)
    bring_up.show(f'{name}: recorded: take the handle again')
    hold(lambda: bring_up.turn(pose) > TAKEN)
    bring_up.step(bring_up.nothing)
    return pose
