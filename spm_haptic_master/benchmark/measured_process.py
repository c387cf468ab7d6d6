# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One process of the benchmark: python -m ... NAME DIRECTORY [--ros-args ...].

NAME is an executable of the package, a bare node or an observer. The times of its garbage
collections are written into the directory at the end. `STACKS_SIGNAL` prints the stacks of all
threads on standard error.
"""

from __future__ import annotations

import faulthandler
import gc
from importlib import import_module
import json
from pathlib import Path
import signal
import sys
import time

from spm_haptic_master.executables import EXECUTABLES

# Signal at which a process prints the stacks of its threads.
STACKS_SIGNAL = signal.SIGUSR1
# Observers, and whether each subscribes to all outputs of `fkm`, and records the commands.
OBSERVERS = {'observer': (False, False), 'observer_of_all': (True, False),
             'observer_of_commands': (False, True)}
# Executables of `bare_nodes`.
BARE = ('bare_driver', 'bare_relay', 'bare_listener', 'bare_master')


class GarbageWatch:
    """
    Records every garbage collection from its construction on.

    Attributes
    ----------
    pauses : list of (int, int)
        Beginning of each collection (ns since the Unix epoch) and its length (ns).

    """

    def __init__(self) -> None:
        self.pauses: list[tuple[int, int]] = []
        self._began = 0
        gc.callbacks.append(self._on_collection)

    def _on_collection(self, phase: str, _: dict[str, int]) -> None:
        now = time.time_ns()
        if phase == 'start':
            self._began = now
        else:
            self.pauses.append((self._began, now - self._began))


def pauses_file(name: str) -> str:
    """Return the name of the file with the garbage collections of the process `name`."""
    return f'{name}.pauses.json'


def main() -> int:
    """Run the program that the command line names; return its exit code."""
    name, directory, *args = sys.argv[1:]
    args = [name, *args]
    faulthandler.register(STACKS_SIGNAL)
    watch = GarbageWatch()
    if name in OBSERVERS:
        from spm_haptic_master.benchmark import observer
        code = observer.main(Path(directory), *OBSERVERS[name], args)
    elif name in BARE:
        from spm_haptic_master.benchmark import bare_nodes
        code = bare_nodes.main(name, args)
    else:
        code = import_module(f'spm_haptic_master.{EXECUTABLES[name][0]}').main(args)
    Path(directory, pauses_file(name)).write_text(json.dumps(watch.pauses))
    return code


if __name__ == '__main__':
    sys.exit(main())
