# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start an executable by name: python -m spm_haptic_master NAME [--ros-args ...]."""

from __future__ import annotations

from importlib import import_module
import signal
import sys

from spm_haptic_master.executables import EXECUTABLES


def main(argv: list[str] | None = None) -> int:
    """Run the executable that the first argument names; 2 if it names none."""
    argv = sys.argv if argv is None else argv
    if len(argv) < 2 or argv[1] not in EXECUTABLES:
        print('usage: python -m spm_haptic_master NAME [--ros-args ...], NAME one of\n'
              + '\n'.join(f'  {name:16}{what}' for name, (_, what) in EXECUTABLES.items()),
              file=sys.stderr)
        return 2
    # Until the program has handlers of its own a signal simply ends it: Python's KeyboardInterrupt
    # can be lost in the middle of an import. Also where a shell has SIGINT ignored by what it runs
    # in the background.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    module, _ = EXECUTABLES[argv[1]]
    return import_module(f'spm_haptic_master.{module}').main(argv[1:])


if __name__ == '__main__':
    sys.exit(main())
