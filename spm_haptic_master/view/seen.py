# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is known of a device now, as the page shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import nan

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.view.messages import Calibration
from spm_haptic_master.view.status import Banner, SensorState
from spm_haptic_master.view.stories import StoryNews


@dataclass(frozen=True, slots=True)
class Settings:
    """
    Settings of fkm that the page shows.

    Until fkm has answered they are the defaults.
    """

    sensors: int = 4  # number of them
    alert_limit: float = nan  # largest protection level of a published orientation, deg
    calibration: str = ''  # name of the calibration; empty: none


@dataclass(slots=True)
class Seen:
    """
    State of a device; a past one if the banner is not alive.

    The device writes it field by field; the page reads it four times a second.
    """

    banner: Banner
    settings: Settings = field(default_factory=Settings)
    states: list[SensorState] = field(default_factory=list)
    source: str = ''  # where the joint angles come from; empty: not known
    force: str = ''  # state of the force feedback; empty: not known
    teleop: str = ''  # state of the slave's lead; empty: no teleop
    crtk: str = ''  # CRTK operating state; empty: not known
    angles: Sequence[float] | None = None  # of all nine joints, rad
    orientation: Quaternion[float] | None = None  # of the platform in the base frame
    dexterities: tuple[float, float] | None = None  # of three encoders, and of all
    ghost: float | None = None  # error of three encoders alone, rad
    # Angle of each encoder as read, rad, and its age, s; nan without one.
    readings: Sequence[float] = ()
    ages: Sequence[float] = ()
    # Torques commanded and rendered, N m; nan without force feedback.
    torques: tuple[float, float] = (nan, nan)
    # Positions of the encoders that are in no set: insertion, m, gripper, rad; None: no reading.
    further: dict[str, float | None] = field(default_factory=dict)
    pace: float = 0.0  # poses drawn per second
    story: StoryNews | None = None  # what the simulation plays
    happened: Sequence[str] = ()  # events since the last time
    calibration: Calibration | None = None  # one that is being recorded

    def present(self) -> Seen:
        """
        Return what is known of the present pose: nothing of the pose if it is a past one.

        Returns
        -------
        Seen
            The same object while the banner is alive, otherwise a copy without the pose and what
            follows from it.

        """
        if self.banner.alive:
            return self
        return replace(
            self,
            angles=None,
            orientation=None,
            dexterities=None,
            ghost=None,
        )
