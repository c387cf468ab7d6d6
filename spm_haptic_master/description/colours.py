# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The colours of the mechanism's parts and of quantities: URDF, page of `view`, and pictures.

A colour has one meaning everywhere: three encoders alone are violet, all encoders petrol.
"""

from __future__ import annotations

from dataclasses import dataclass

# Colours, red, green, blue in 0 .. 1: of the base, the legs A, B, C, the platform, the encoders.
COLOURS = {
    'base': (0.78, 0.80, 0.83),
    'leg_a': (0.12, 0.47, 0.71),
    'leg_b': (0.84, 0.37, 0.10),
    'leg_c': (0.17, 0.58, 0.30),
    'platform': (0.28, 0.31, 0.36),
    'encoder': (0.93, 0.67, 0.05),
}


@dataclass(frozen=True, slots=True)
class Ink:
    """
    Colour of a quantity as CSS has it: on a white page, and on a dark one.

    Attributes
    ----------
    light, dark : str
        #rrggbb, for a page of #ffffff and for one of #242424.

    """

    light: str
    dark: str


def css(name: str) -> str:
    """
    Return the colour of a part as CSS and matplotlib have it.

    Parameters
    ----------
    name : str
        Name of a part in COLOURS.

    Returns
    -------
    str
        #rrggbb.

    """
    return f'#{bytes(round(255 * part) for part in COLOURS[name]).hex()}'


# Colours of the legs A, B, C.
LEGS = tuple(css(f'leg_{leg}') for leg in 'abc')
# Colours of quantities. Each has a contrast of 4.5 and more to its page, as text needs by WCAG AA.
THREE_ENCODERS = Ink('#a3308f', '#e58fd6')
ALL_ENCODERS = Ink('#00687a', '#5cc8dc')
WARNING_LIMIT = Ink('#8f5200', '#f0b45c')
ERROR_LIMIT = Ink('#b42318', '#ff8f80')
COMMANDED = Ink('#5a5a5a', '#b8b8b8')
RENDERED = Ink('#6a4a9c', '#b79cf0')
# Colours of the legs as lines of plots, whose contrast is at least 3.
LEG_INKS = (
    Ink(LEGS[0], '#5aa9e6'),
    Ink(LEGS[1], '#f08a4b'),
    Ink(LEGS[2], '#5cc27c'),
)
