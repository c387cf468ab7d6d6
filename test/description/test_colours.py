# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Colours that everybody can read: contrast as WCAG AA wants it, on white and on dark pages."""

from contrast import contrast, DARK_PAGE, WHITE_PAGE
import pytest
from spm_haptic_master.description import colours

# Least contrasts of text and of lines (WCAG 2.2, 1.4.3 and 1.4.11).
TEXT = 4.5
LINE = 3.0
QUANTITIES = (
    colours.THREE_ENCODERS,
    colours.ALL_ENCODERS,
    colours.WARNING_LIMIT,
    colours.ERROR_LIMIT,
    colours.COMMANDED,
    colours.RENDERED,
)


def test_the_contrast_is_that_of_wcag():
    """Its examples: black on white, and the greys at the limits of AA."""
    assert contrast('#000000', '#ffffff') == pytest.approx(21.0)
    assert contrast('#767676', '#ffffff') == pytest.approx(4.54, abs=0.005)
    assert contrast('#ffffff', '#949494') == pytest.approx(3.03, abs=0.005)


@pytest.mark.parametrize('ink', QUANTITIES)
def test_quantities_are_legible_on_both_pages(ink):
    assert contrast(ink.light, WHITE_PAGE) >= TEXT
    assert contrast(ink.dark, DARK_PAGE) >= TEXT


@pytest.mark.parametrize('ink', colours.LEG_INKS)
def test_the_lines_of_the_legs_are_seen_on_both_pages(ink):
    assert contrast(ink.light, WHITE_PAGE) >= LINE
    assert contrast(ink.dark, DARK_PAGE) >= LINE
