# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The layout of Foxglove and Lichtblick for the arm of a namespace."""

from __future__ import annotations

import re

# What the namespace is put behind: the slash of a topic, but the one of all nodes; what is before
# the name of a node on that; before the base frame; and before the prefix of all links.
BEFORE = re.compile(
    r'"/(?!diagnostics["\.])|\{name==\\"|"(?=spm_base")|"framePrefix": "')


def foxglove_layout(template: str, namespace: str) -> str:
    """
    Return the layout for the arm of a namespace.

    Parameters
    ----------
    template : str
        The layout without namespace, `config/foxglove_layout.json`.
    namespace : str
        Namespace without slashes at its ends; empty: none.

    """
    return BEFORE.sub(lambda match: f'{match[0]}{namespace}/', template) \
        if namespace else template
