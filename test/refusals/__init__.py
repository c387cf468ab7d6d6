# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the programs refuse at their start: the cases of test_refusals, and the table in refused.md.

Values outside the range of a parameter are refused as well; they are in docs/parameters.md.
"""

from refusals.command_line import COMMAND_LINE
from refusals.encoders import ENCODERS
from refusals.force import FORCE_FEEDBACK
from refusals.nodes import NODES
from refusals.sources import SOURCES
from refusals.tools import TOOLS

REFUSALS = (*COMMAND_LINE, *ENCODERS, *SOURCES, *NODES, *TOOLS, *FORCE_FEEDBACK)
