# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What to do about a reason of silence, for people: no program reads these words."""

from __future__ import annotations

# Remedies by the reason behind `silent: `.
REMEDIES = {
    'no orientation fits': "the calibration may be another rig's, or no longer hold: "
    'calibrate --motion --check calibration.yaml',
}


def with_remedy(state: str) -> str:
    """Return a text of `state` with what to do about it, if that is known."""
    remedy = REMEDIES.get(state.removeprefix('silent: '))
    return f'{state}: {remedy}' if remedy else state
