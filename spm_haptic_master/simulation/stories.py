# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a simulated device plays and explains: what the fourth sensor is for, and the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import radians

from spm_haptic_master.joints import JOINT_NAMES, NUMBER_WORDS

# Self-rotation of the singularity at the workspace's centre (deg), how far a story goes to either
# side of it, clear of it, and where three encoders are on the wrong side still.
SINGULAR, AWAY, NEAR = 49.36, 15.0, 7.0


@dataclass(frozen=True, slots=True)
class Step:
    """
    What happens at a time.

    Attributes
    ----------
    at : float
        Time from the beginning, s.
    phi : float or None
        Self-rotation at the centre to which the device is led, deg; None: where it goes anyway.
    faults : str or None
        Faults that are present from then on; None: as before.

    """

    at: float
    phi: float | None = None
    faults: str | None = None


@dataclass(frozen=True, slots=True)
class Story:
    """Name, explanation and steps of a story, and when it ends (s)."""

    name: str
    words: str
    steps: tuple[Step, ...]
    end: float


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


class Player:
    """
    Plays a story.

    Parameters
    ----------
    steer : callable
        Called with tilt, azimuth and phi, rad, or with nothing to let the device go on by itself.
    fail : callable
        Called with the faults wanted, as a text.

    Attributes
    ----------
    words : str
        Explanation of what is played; empty: nothing is.

    """

    def __init__(self, steer: Callable[..., None], fail: Callable[[str], None]) -> None:
        self._steer, self._fail = steer, fail
        self._story: Story | None = None
        # When it began (s), None before the first tick, and how many of its steps are done.
        self._began: float | None = None
        self._done = 0
        self.words = ''

    def play(self, story: Story) -> None:
        """Begin a story at the next tick, in place of another one."""
        self._story, self._began, self._done, self.words = story, None, 0, story.words

    def stop(self) -> None:
        """End the story: the device is where it is."""
        self._story, self.words = None, ''

    def tick(self, now: float) -> None:
        """Do what is due at a time, s."""
        story = self._story
        if story is None:
            return
        if self._began is None:
            self._began = now
        elapsed = now - self._began
        while self._done < len(story.steps) and story.steps[self._done].at <= elapsed:
            step = story.steps[self._done]
            self._done += 1
            if step.faults is not None:
                self._fail(step.faults)
            if step.phi is not None:
                self._steer(0.0, 0.0, radians(step.phi))
        if elapsed >= story.end:
            self._steer()
            self.stop()
