# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plays a story: its steps when they are due, what is seen meanwhile, and its verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from spm_haptic_master.view.stories import (
    Observations,
    Story,
    StoryNews,
    verdict,
    VERDICT_TIME,
)


class StoryPlayer:
    """
    The story that is played, if any.

    Threads of the server may start another story; `tick` alone plays it.

    Parameters
    ----------
    steer : callable
        Leads the device to a self-rotation, deg, or lets it move by itself (None).
    fail : callable
        Asks for faults, as a text; empty: for none.

    Attributes
    ----------
    observed : Observations
        What was seen during the story; the caller adds to it.
    happened : list of str
        Beginnings and verdicts, in words; the caller empties it.
    is_playing : bool
        Whether a step of a story is played; False while its verdict is shown.

    """

    def __init__(
        self,
        steer: Callable[[float | None], None],
        fail: Callable[[str], None],
    ) -> None:
        self._steer = steer
        self._fail = fail
        self._playing: Iterator[StoryNews] = iter(())
        self._now = 0.0  # time of the latest tick, s
        self._sensors = 0
        self._number = 0
        self.observed = Observations()
        # Beginnings and verdicts, in words; the caller empties it.
        self.happened: list[str] = []
        # Whether a step of a story is played: its verdict is no longer.
        self.is_playing = False

    def play(self, story: Story) -> None:
        """Play a story from its beginning, in place of another one."""
        self._number += 1
        self._playing = self._steps(story, self._number)

    def stop(self) -> None:
        """End the story that is played, without a verdict."""
        self._playing = iter(())
        self.is_playing = False

    def tick(self, now: float, sensors: int) -> StoryNews | None:
        """
        Continue at a time, s, with a number of sensors; return what the page shows.

        Parameters
        ----------
        now : float
            Present time, s, monotonic.
        sensors : int
            Number of sensors of the device: the verdict names it.

        Returns
        -------
        StoryNews or None
            Sentence and progress of the story; None without a story.

        """
        self._now = now
        self._sensors = sensors
        return next(self._playing, None)

    def _steps(
        self,
        story: Story,
        number: int,
    ) -> Iterator[StoryNews]:
        """
        Do each step when it is due; yield the news at each tick until the story ends.

        Parameters
        ----------
        story : Story
            The story.
        number : int
            Its number, from 1, in the order in which stories are played.

        Yields
        ------
        StoryNews
            The step that is played; at the end the verdict, for VERDICT_TIME.

        """
        begun = self._now
        self.observed = Observations()
        self.is_playing = True
        self.happened.append(f'story: {story.name}')
        count = len(story.steps) + 1
        ends = [step.at for step in story.steps[1:]] + [story.end]
        for index, (step, end) in enumerate(zip(story.steps, ends, strict=True), start=1):
            if step.faults is not None:
                self._fail(step.faults)
            if step.phi is not None:
                self._steer(step.phi)
            news = StoryNews(
                name=story.name,
                view=story.view,
                words=step.words,
                step=index,
                steps=count,
                number=number,
            )
            yield from self._until(begun + end, news)
        self._steer(None)
        self.is_playing = False
        words = verdict(story, self._sensors, self.observed)
        self.happened.append(words)
        news = StoryNews(
            name=story.name,
            view=story.view,
            words=words,
            step=count,
            steps=count,
            number=number,
        )
        yield from self._until(begun + story.end + VERDICT_TIME, news)

    def _until(
        self,
        end: float,
        news: StoryNews,
    ) -> Iterator[StoryNews]:
        """Yield the news at each tick before a time, s."""
        while self._now < end:
            yield news
