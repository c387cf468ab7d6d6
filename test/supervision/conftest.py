# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated device beside these tests can be imported."""

from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).parent))
