# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a simulated device plays and explains: what the fourth sensor is for, and the others."""

from __future__ import annotations

from typing import NamedTuple

from spm_haptic_master.kinematics.joints import JOINT_NAMES, NUMBER_WORDS

# Self-rotation of the singularity at the workspace's centre (deg), how far a story goes to either
# side of it, clear of it, and where three encoders are on the wrong side still.
SINGULAR, AWAY, NEAR = 49.36, 15.0, 7.0


class Step(NamedTuple):
    """What happens at a time."""

    at: float  # time from the beginning, s
    # Self-rotation at the centre to which the device is led, deg; None: where it goes anyway.
    phi: float | None = None
    faults: str | None = None  # faults that are present from then on; None: as before


class Story(NamedTuple):
    """A sequence of steps, and its explanation."""

    name: str
    words: str
    steps: tuple[Step, ...]
    end: float  # when it ends, s


def stories(sensors: int) -> tuple[Story, ...]:
    """Return the stories of a device with a number of sensors."""
    four = sensors == len(JOINT_NAMES)
    number = NUMBER_WORDS[sensors]
    return (
        Story('cross the singularity',
              'Three encoders lose the handle at the singularity: the violet ghost is what they '
              f'would report. The device has {number} and goes through as if nothing were there.',
              (Step(0.0, SINGULAR - AWAY, ''), Step(3.0, SINGULAR), Step(6.0, SINGULAR + NEAR),
               Step(10.0, SINGULAR + AWAY), Step(13.0, SINGULAR - AWAY)), 17.0),
        Story('break th3A there',
              'Here th3A alone knows the self-rotation and no other encoder checks it: its chip '
              'is amber. It freezes, its own stillness gives it away, and the device is silent.'
              if four else
              f'With {number} encoders the others check th3A even at the singularity. It freezes, '
              'is excluded, and the device continues without it.',
              (Step(0.0, SINGULAR, ''), Step(5.0, None, 'stuck:joint_3a'),
               Step(7.0, SINGULAR - AWAY), Step(14.0, None, '')), 16.0),
        Story(f'unplug one of {number}',
              'With four encoders none may be missing: without th1B the device is silent. With '
              'six it continues: start it with -p sensors:=6.' if four else
              f'One of {number} encoders does not answer: its chip is black, and the state says '
              'so. The device continues with the others.',
              (Step(0.0, None, ''), Step(2.0, None, 'dropout:joint_1b'), Step(9.0, None, '')),
              11.0))
