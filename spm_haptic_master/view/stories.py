# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stories of a simulated device, in steps: what each does, and the sentence that explains it."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, nan

from spm_haptic_master.kinematics.joints import JOINT_NAMES, NUMBER_WORDS

# Self-rotation of the singularity at the workspace's centre; distances from it at which a story is
# clear of it, and three encoders are still on the wrong side (deg).
SINGULAR = 49.36
AWAY = 15.0
NEAR = 7.0
# Time for which the verdict of a story stays (s).
VERDICT_TIME = 12.0
# Name of the story with which a newcomer begins: where three encoders lose the handle.
SINGULARITY_STORY = 'cross the singularity'
# Views of the page.
GHOST_VIEW = 'ghost'
FRONT_VIEW = 'front'


@dataclass(frozen=True, slots=True)
class Step:
    """What happens at a time of a story."""

    at: float  # time from the beginning, s
    words: str  # what there is to see
    # Self-rotation at the centre to which the device is led, deg; None: unchanged.
    phi: float | None = None
    faults: str | None = None  # faults from then on; None: unchanged


@dataclass(frozen=True, slots=True)
class Story:
    """
    A sequence of steps; it ends at a time, s, and its verdict follows.

    Attributes
    ----------
    name : str
        Text on the story's button.
    view : str
        Name of the view in which it is seen best.
    steps : tuple of Step
        Steps in the order of their times.
    end : float
        Time from the beginning at which the last step ends, s.

    """

    name: str
    view: str  # the view of the page in which it is seen best
    steps: tuple[Step, ...]
    end: float


@dataclass(frozen=True, slots=True)
class StoryNews:
    """
    What the page shows of a story: a sentence, and how far it is.

    Attributes
    ----------
    name, view : str
        Name and view of the story.
    words : str
        Sentence of the step, or the verdict.
    step, steps : int
        Number of the step, from 1, and of all steps with the verdict.
    number : int
        Number of the story, from 1, in the order in which they are played.

    """

    name: str
    view: str
    words: str
    step: int  # from 1; the verdict is the last one
    steps: int
    number: int  # of the story, so that a page notices another one


@dataclass(slots=True)
class Observations:
    """What was seen of the device during a story; errors in rad."""

    three: float = nan  # largest error of three encoders alone
    device: float = nan  # largest error of the published orientation
    silent: float = 0.0  # time without an orientation, s

    def add(
        self,
        seconds: float,
        alive: bool,
        three: float,
        device: float,
    ) -> None:
        """
        Add what was seen for some seconds; nan: an error is not known.

        Parameters
        ----------
        seconds : float
            Time since the last call, s.
        alive : bool
            Whether the page shows the present pose.
        three : float
            Error of three encoders alone, rad.
        device : float
            Error of the published orientation, rad.

        """
        if not alive:
            self.silent += seconds
        # The larger one, or the one that is a number.
        if not self.three >= three and three == three:
            self.three = three
        else:
            self.three = self.three
        if not self.device >= device and device == device:
            self.device = device
        else:
            self.device = self.device


def verdict(
    story: Story,
    sensors: int,
    seen: Observations,
) -> str:
    """
    Return the last sentence of a story: what came out, in measured numbers.

    Parameters
    ----------
    story : Story
        The story that has ended.
    sensors : int
        Number of sensors of the device, 4 to 6.
    seen : Observations
        What was seen meanwhile.

    Returns
    -------
    str
        Largest errors, deg, and for a story with a fault the time of silence, s, if it was above
        half a second.

    """
    number = NUMBER_WORDS[sensors]
    if story.view == GHOST_VIEW:
        three, device = (_degrees(error) for error in (seen.three, seen.device))
        return f'Three encoders: up to {three} wrong. The {number} of the device: {device}.'
    device = _degrees(seen.device)
    if seen.silent > 0.5:
        return (
            f'The device was silent for {seen.silent:.0f} s: a slave stops. '
            f'What it published was at most {device} wrong.'
        )
    return f'The device never fell silent, and was at most {device} wrong.'


def _degrees(angle: float) -> str:
    """Return an angle, rad, in words."""
    return 'an unknown angle' if angle != angle else f'{degrees(angle):.1f}\u00b0'


def stories(sensors: int) -> tuple[Story, ...]:
    """
    Return the stories of a device with a number of sensors.

    Parameters
    ----------
    sensors : int
        Number of sensors, 4 to 6: with four, what fails makes the device silent.

    Returns
    -------
    tuple of Story
        Three stories, in the order of their buttons.

    """
    with_four = sensors == len(JOINT_NAMES)
    return (
        _crossing(),
        _frozen_with_four() if with_four else _frozen_with_more(),
        _unplugged_of_four() if with_four else _unplugged_of_more(NUMBER_WORDS[sensors]),
    )


def _crossing() -> Story:
    """Return the story of the singularity: three encoders lose the handle, all do not."""
    return Story(
        name=SINGULARITY_STORY,
        view=GHOST_VIEW,
        steps=(
            Step(
                0.0,
                'The handle turns to where three motor encoders still know it.',
                SINGULAR - AWAY,
                '',
            ),
            Step(
                3.0,
                'It turns onto the singularity, the red line on the dome: there three motor '
                'encoders lose it.',
                SINGULAR,
            ),
            Step(
                6.0,
                'It is past the line. Violet is what three encoders alone would report, if that '
                'is another pose.',
                SINGULAR + NEAR,
            ),
            Step(10.0, 'Clear of the singularity, on its other side.', SINGULAR + AWAY),
            Step(13.0, 'Back through the singularity.', SINGULAR - AWAY),
        ),
        end=17.0,
    )


def _frozen_with_four() -> Story:
    """Return the story of th3A frozen where no other encoder checks it."""
    return Story(
        name='break th3A there',
        view=FRONT_VIEW,
        steps=(
            Step(
                0.0,
                'The handle turns onto the singularity. There th3A alone knows the self-rotation: '
                'its chip becomes amber.',
                SINGULAR,
                '',
            ),
            Step(
                5.0,
                'th3A freezes. No other encoder can see that.',
                None,
                'stuck:joint_3a',
            ),
            Step(
                7.0,
                'The handle moves. The stillness of th3A gives it away: the device is silent.',
                SINGULAR - AWAY,
            ),
            Step(14.0, 'th3A is repaired, and the device returns.', None, ''),
        ),
        end=16.0,
    )


def _frozen_with_more() -> Story:
    """Return the story of th3A frozen where th3B checks it."""
    return Story(
        name='break th3A there',
        view=FRONT_VIEW,
        steps=(
            Step(0.0, 'The handle turns onto the singularity.', SINGULAR, ''),
            Step(
                5.0,
                'th3A freezes. The others check it even here.',
                None,
                'stuck:joint_3a',
            ),
            Step(
                7.0,
                'The handle moves: th3A is excluded, the device continues without it.',
                SINGULAR - AWAY,
            ),
            Step(14.0, 'th3A is repaired.', None, ''),
        ),
        end=16.0,
    )


def _unplugged_of_four() -> Story:
    """Return the story of a missing encoder of four: silence."""
    return Story(
        name='unplug one of four',
        view=FRONT_VIEW,
        steps=(
            Step(0.0, 'All four encoders answer.', None, ''),
            Step(
                2.0,
                'th1B is unplugged. Of four none may be missing: the device is silent. With six '
                'it continues: start it with -p sensors:=6.',
                None,
                'dropout:joint_1b',
            ),
            Step(9.0, 'th1B is back, and the device returns.', None, ''),
        ),
        end=11.0,
    )


def _unplugged_of_more(number: str) -> Story:
    """Return the story of a missing encoder of five or six: degraded."""
    return Story(
        name=f'unplug one of {number}',
        view=FRONT_VIEW,
        steps=(
            Step(0.0, f'All {number} encoders answer.', None, ''),
            Step(
                2.0,
                'th1B is unplugged: its chip is black. The device continues with the others.',
                None,
                'dropout:joint_1b',
            ),
            Step(9.0, 'th1B is back.', None, ''),
        ),
        end=11.0,
    )
