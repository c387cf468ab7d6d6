# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start an executable by name: python -m spm_haptic_master NAME [--ros-args ...]."""

from __future__ import annotations

import sys

from spm_haptic_master.entry_points import start
from spm_haptic_master.executables import EXECUTABLES


def main(argv: list[str] | None = None) -> int:
    """Run the executable that the first argument names; return its exit code, 2 without one."""
    argv = sys.argv if argv is None else argv
    if len(argv) < 2 or argv[1] not in EXECUTABLES:
        lines = [f'  {name:16}{description}' for name, (_, description) in EXECUTABLES.items()]
        print('usage: python -m spm_haptic_master NAME [--ros-args ...], NAME one of',
              *lines, sep='\n', file=sys.stderr)
        return 2
    return start(argv[1], argv[1:])


if __name__ == '__main__':
    sys.exit(main())
