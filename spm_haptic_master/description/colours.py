# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The colours of the mechanism's parts: in the URDF, on the page of `view` and in pictures."""

from __future__ import annotations

# Colours, red, green, blue in 0 .. 1: of the base, the legs A, B, C, the platform, the encoders.
COLOURS = {
    'base': (0.78, 0.80, 0.83),
    'leg_a': (0.12, 0.47, 0.71),
    'leg_b': (0.84, 0.37, 0.10),
    'leg_c': (0.17, 0.58, 0.30),
    'platform': (0.28, 0.31, 0.36),
    'encoder': (0.93, 0.67, 0.05),
}


def css(name: str) -> str:
    """Return the colour of a part as CSS and matplotlib have it."""
    return f'#{bytes(round(255 * part) for part in COLOURS[name]).hex()}'


# Colours of the legs A, B, C.
LEGS = tuple(css(f'leg_{leg}') for leg in 'abc')
