# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texts of results against recorded ones: the same words, and numbers but for their rounding."""

import re

from harness import DATA
import numpy as np

NUMBER = re.compile(r'[-+]?\d+\.?\d*(?:e[-+]\d+)?')


def assert_recorded(name, text):
    """Compare a text with the recorded one in test/data; without one record it, and fail."""
    path = DATA / name
    if not path.exists():
        path.write_text(text, encoding='utf-8')
        raise AssertionError(f'{path}: recorded anew')
    recorded = path.read_text(encoding='utf-8')
    words, expected = (NUMBER.sub('#', ' '.join(each.split())) for each in (text, recorded))
    assert words == expected
    numbers, known = (np.array(NUMBER.findall(each), dtype=float) for each in (text, recorded))
    np.testing.assert_allclose(numbers, known, rtol=1e-4, atol=2e-4)
