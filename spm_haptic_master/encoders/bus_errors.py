# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of a CAN bus: which exceptions python-can's interfaces raise, and their text."""

from __future__ import annotations

import can

# Exceptions that python-can's interfaces raise if a bus cannot be opened or used.
BUS_ERRORS = (can.CanError, OSError, ValueError, ImportError)


# Remedies for errors of python-can that name none, by their text.
REMEDIES = {'msgpack not installed': 'sudo apt install python3-msgpack'}


def first_line(error: Exception) -> str:
    """
    Return the first line of an error's text, with a remedy if there is one.

    python-can's texts may contain a traceback.
    """
    line = (str(error) or type(error).__name__).splitlines()[0]
    return f'{line}: {REMEDIES[line]}' if line in REMEDIES else line
