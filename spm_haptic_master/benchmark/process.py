# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One process of the benchmark: python -m ... NAME DIRECTORY [--ros-args ...].

NAME is an executable of the package, a bare one or an observer. Garbage collections are noted and
written into the directory at the end.
"""

from __future__ import annotations

import gc
from importlib import import_module
import json
from pathlib import Path
import sys
import time

from spm_haptic_master.executables import EXECUTABLES

OBSERVERS = {'observer': False, 'observer_of_all': True}
BARE = ('bare_driver', 'bare_relay', 'bare_listener', 'bare_master')


class GarbageWatch:
    """Notes when each collection began (ns since the Unix epoch) and how long it took (ns)."""

    def __init__(self):
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
    """Return the name of the file with the collections of the process `name`."""
    return f'{name}.pauses.json'


def main() -> int:
    """Run what the command line names."""
    name, directory, *args = sys.argv[1:]
    args = [name, *args]
    watch = GarbageWatch()
    if name in OBSERVERS:
        from spm_haptic_master.benchmark import observer
        code = observer.main(Path(directory), OBSERVERS[name], args)
    elif name in BARE:
        from spm_haptic_master.benchmark import bare_nodes
        code = bare_nodes.main(name, args)
    else:
        code = import_module(f'spm_haptic_master.{EXECUTABLES[name][0]}').main(args)
    Path(directory, pauses_file(name)).write_text(json.dumps(watch.pauses))
    return code


if __name__ == '__main__':
    sys.exit(main())
