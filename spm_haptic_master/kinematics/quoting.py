# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Values as error messages quote them: on one line, and not longer than a reader wants."""

from __future__ import annotations

# Longest quoted value (characters).
LONGEST = 160


def quoted(value: object) -> str:
    """Return the representation of any value on one line, shortened to `LONGEST` characters."""
    try:
        text = ' '.join(repr(value).split())
    except Exception:  # a foreign type may raise anything
        text = f'a value of type {type(value).__name__}'
    return text if len(text) <= LONGEST else f'{text[:LONGEST - 4]} ...'
