# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What messages of other programs say, in values; None of a message that says nothing.

Every field of a message may have any length: a program of another maker sends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import json
from math import isfinite, nan

from geometry_msgs.msg import QuaternionStamped, WrenchStamped
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.timing import SECOND
from std_msgs.msg import Float64MultiArray, Header


@dataclass(frozen=True, slots=True)
class StampedAngles:
    """
    Angles of joints, rad, and their stamp, ns.

    Attributes
    ----------
    stamp : int
        Time of the sample, ns.
    angles : tuple of float
        Angles, rad, in the order of the message's joints; nan without a reading, where that is
        allowed.

    """

    stamp: int
    angles: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Calibration:
    """
    What to do next in a calibration, and shares 0 .. 1 of what is needed, by name.

    Attributes
    ----------
    text : str
        What the user should do next.
    shares : dict
        Share 0 .. 1 of what is needed that has been reached, by the name of each part.

    """

    text: str
    shares: dict[str, float]


def stamp_of(header: Header) -> int:
    """Return the stamp of a header, ns."""
    return int(header.stamp.sec) * SECOND + int(header.stamp.nanosec)


def mechanism_joints(message: JointState) -> StampedAngles | None:
    """
    Return the angles of all nine joints; None if one is missing or is no number.

    Parameters
    ----------
    message : JointState
        A message on `joint_states`.

    Returns
    -------
    StampedAngles or None
        Angles in the order of MECHANISM_JOINT_NAMES, rad, all of them finite.

    """
    angles = tuple(message.position)
    if tuple(message.name) != MECHANISM_JOINT_NAMES or len(angles) != len(message.name):
        return None
    if all(map(isfinite, angles)):
        return StampedAngles(stamp_of(message.header), angles)
    return None


def readings(message: JointState) -> StampedAngles | None:
    """
    Return the angle of each sensor, nan without a reading; None if they are not sensors'.

    Parameters
    ----------
    message : JointState
        A message on `readings`, with four to six sensors in the order of ALL_JOINT_NAMES.

    Returns
    -------
    StampedAngles or None
        The angles as they were read, rad.

    """
    count = len(message.name)
    is_sensors = count >= 4 and tuple(message.name) == ALL_JOINT_NAMES[:count]
    if not is_sensors or len(message.position) != count:
        return None
    return StampedAngles(stamp_of(message.header), tuple(message.position))


def one_joint(message: JointState) -> float | None:
    """
    Return the position of a message of one joint; None without a number.

    Parameters
    ----------
    message : JointState
        A message of the insertion (m) or of the gripper (rad).

    Returns
    -------
    float or None
        Its position in the message's unit.

    """
    if len(message.position) != 1 or not isfinite(message.position[0]):
        return None
    return float(message.position[0])


def dexterities(message: Float64MultiArray) -> tuple[float, float] | None:
    """
    Return the dexterity of three encoders and of all; None of another number of values.

    Parameters
    ----------
    message : Float64MultiArray
        A message on `dexterity`.

    Returns
    -------
    tuple of two float, or None
        Dexterity of the three motor encoders, and of all encoders (unit 1).

    """
    if len(message.data) != 2:
        return None
    three, every = message.data
    return three, every


def torque(message: WrenchStamped) -> tuple[float, float, float]:
    """
    Return the torque of a wrench, N m.

    Parameters
    ----------
    message : WrenchStamped
        A wrench in any frame; its force is left out.

    Returns
    -------
    tuple of 3 float
        x, y, z in the message's frame, N m.

    """
    vector = message.wrench.torque
    return vector.x, vector.y, vector.z


def orientation(message: QuaternionStamped) -> tuple[int, Quaternion[float]]:
    """Return the stamp, ns, and the quaternion x, y, z, w."""
    turn = message.quaternion
    return stamp_of(message.header), (turn.x, turn.y, turn.z, turn.w)


def calibration(text: str) -> Calibration | None:
    """
    Return the state of a calibration from its topic; None of other programs' words.

    Parameters
    ----------
    text : str
        JSON with `text` and `covered`, as calibrate publishes it on `calibration/coverage`.

    Returns
    -------
    Calibration or None
        Its shares are empty if the text has none: the calibration has ended.

    """
    try:
        found = json.loads(text)
        shares = {str(name): float(share) for name, share in found.get('covered', {}).items()}
        words = str(found.get('text', ''))
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        return None
    return Calibration(words, shares)


def ages(
    came: Sequence[float],
    now: float,
) -> tuple[float, ...]:
    """
    Return how long ago each reading came, s; nan of one that never came.

    Parameters
    ----------
    came : sequence of float
        Times at which readings came, s; nan: never.
    now : float
        Present time on the same clock, s.

    Returns
    -------
    tuple of float
        Ages, s.

    """
    return tuple(now - time if isfinite(time) else nan for time in came)
