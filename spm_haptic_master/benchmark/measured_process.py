# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One process of the benchmark: python -m ... NAME DIRECTORY [--ros-args ...].

NAME is an executable of the package, a bare node or an observer, which writes into the directory.
`STACKS_SIGNAL` prints the stacks of all threads on standard error.
"""

from __future__ import annotations

import faulthandler
from importlib import import_module
from pathlib import Path
import signal
import sys

from spm_haptic_master.executables import EXECUTABLES

# Signal at which a process prints the stacks of its threads.
STACKS_SIGNAL = signal.SIGUSR1


def main() -> int:
    """Run the program that the command line names; return its exit code."""
    name, directory, *args = sys.argv[1:]
    faulthandler.register(STACKS_SIGNAL)
    if name in EXECUTABLES:
        code: int = import_module(f'spm_haptic_master.{EXECUTABLES[name][0]}').main([name, *args])
        return code
    if name.startswith('bare_'):
        from spm_haptic_master.benchmark import bare_nodes
        return bare_nodes.main(name, [name, *args])
    from spm_haptic_master.benchmark import observer
    return observer.main(name, Path(directory), [name, *args])


if __name__ == '__main__':
    sys.exit(main())
