# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures of the paper, of recordings and the page of `view` have one colour for one quantity."""

from spm_haptic_master.description.colours import ALL_ENCODERS, THREE_ENCODERS
from spm_haptic_master.validation import plot_style


def test_three_encoders_and_all_of_them_have_the_colours_of_the_page():
    assert plot_style.CLASSIC == THREE_ENCODERS.light
    assert plot_style.IMPROVED == ALL_ENCODERS.light
