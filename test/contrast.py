# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The contrast of two colours, by which tests judge whether everybody can read a text."""

# The pages on which they are.
WHITE_PAGE = '#ffffff'
DARK_PAGE = '#242424'


def contrast(one: str, other: str) -> float:
    """
    Return the contrast of two colours in CSS, from 1 to 21.

    WCAG 2.2, "contrast ratio" and "relative luminance".

    Parameters
    ----------
    one, other : str
        #rrggbb; their order does not matter.

    Returns
    -------
    float
        1 of equal colours, 21 of black and white.

    """
    lighter, darker = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (lighter + 0.05) / (darker + 0.05)


def _luminance(colour: str) -> float:
    """Return the relative luminance of a colour in CSS, 0 .. 1."""
    red, green, blue = (_linear(part / 255.0) for part in bytes.fromhex(colour[1:]))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _linear(part: float) -> float:
    """Return a part of a colour, 0 .. 1, without the gamma of sRGB."""
    if part <= 0.04045:
        return part / 12.92
    return float(((part + 0.055) / 1.055) ** 2.4)
