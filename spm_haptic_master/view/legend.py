# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the page explains: its line of introduction, and the legend of signs and colours."""

from __future__ import annotations

from dataclasses import dataclass

from spm_haptic_master.description.colours import (
    ALL_ENCODERS,
    COMMANDED,
    Ink,
    RENDERED,
    THREE_ENCODERS,
)
from spm_haptic_master.view.dome import SINGULAR, TRACE_COLOUR
from spm_haptic_master.view.status import Light, SensorState
from spm_haptic_master.view.stories import SINGULARITY_STORY

# The line under the title; the story to try, by its button, is for a simulated device alone.
INTRODUCTION = {
    'text': (
        'A surgeon\u2019s handle on three legs. Three motor encoders (th1A, th1B, th1C) lose it '
        'at the red line on the dome; the fourth encoder, th3A, does not.'
    ),
    'story': SINGULARITY_STORY,
}
# Colour of the dome, where three encoders are good.
BLUE = '#145fa0'


@dataclass(frozen=True, slots=True)
class Entry:
    """
    One line of the legend: a sign in a colour, and what it means.

    Attributes
    ----------
    sign : str
        One or a few characters, drawn in the colour.
    ink : Ink
        Colour on a white page and on a dark one.
    text : str
        Meaning, in one sentence.

    """

    sign: str
    ink: Ink
    text: str


def legend() -> list[Entry]:
    """
    Return the legend, from what hits the eye to the figures.

    Returns
    -------
    list of Entry
        Entries of the picture, then of the encoders' chips, then of the figures.

    """
    return [*_of_picture(), *_of_chips(), *_of_figures()]


def _of_picture() -> list[Entry]:
    """Return what there is in the picture."""
    plain = Ink('#444444', '#cccccc')
    return [
        _entry(
            '\u25cf',
            BLUE,
            'Dome: the workspace, in the colours of three encoders\u2019 dexterity.',
        ),
        _entry('\u25cf', SINGULAR, 'Dark red line on the dome: singularities of three encoders.'),
        Entry('\u2014', Ink(TRACE_COLOUR, '#dddddd'), 'Black line: where the handle pointed.'),
        Entry(
            '\u25e2',
            THREE_ENCODERS,
            'Violet: the pose that three encoders alone would report.',
        ),
        Entry(
            '\u25bd',
            ALL_ENCODERS,
            'Cone about the handle: the protection level, ten times as wide, at most 20\u00b0.',
        ),
        Entry('A B C', plain, 'The legs; O, the centre of all rotation.'),
        Entry('\u2192', COMMANDED, 'Arrow: the torque commanded to the handle.'),
        Entry('\u2192', RENDERED, 'Arrow: the torque that the motors render.'),
    ]


def _of_chips() -> list[Entry]:
    """Return the signs of the chips, and of the names in the picture."""
    meanings = {
        SensorState.HEALTHY: 'Encoder healthy: the others check it.',
        SensorState.UNCHECKED: 'Encoder not checked by the others: they could not see it fail.',
        SensorState.EXCLUDED: 'Encoder faulty, excluded.',
        SensorState.MISSING: 'Encoder without a reading.',
    }
    return [_entry(state.sign, state.colour, text) for state, text in meanings.items()]


def _of_figures() -> list[Entry]:
    """Return the quantities of rows and plots."""
    plain = Ink('#444444', '#cccccc')
    return [
        Entry(
            '\u03c8 \u03b8 \u03c6',
            plain,
            'Orientation: ZXZ angles; \u03c6 is the self-rotation.',
        ),
        Entry(
            '\u03b7',
            plain,
            'Dexterity: 0 at a singularity, 1 if all directions are known alike.',
        ),
        Entry(
            '\u03c3',
            plain,
            'Parity: how far the encoders disagree, in standard deviations; of noise mostly '
            'below 3.',
        ),
        Entry(
            '\u2264',
            ALL_ENCODERS,
            'Protection level: bound of the orientation\u2019s error, even if an encoder fails.',
        ),
        _entry(Light.RED.sign, Light.RED.colour, 'Banner: silent. A slave stops.'),
    ]


def _entry(
    sign: str,
    colour: str,
    text: str,
) -> Entry:
    """Return a line in one colour, a lighter one on a dark page."""
    return Entry(sign, Ink(colour, _LIGHTER.get(colour, '#bbbbbb')), text)


# Colours that are too dark for a dark page, and what they are there.
_LIGHTER = {
    BLUE: '#6cb4f0',
    SINGULAR: '#ff8f80',
    Light.GREEN.colour: '#5cc27c',
    Light.AMBER.colour: '#f0b45c',
    Light.RED.colour: '#ff8f80',
}
