# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Measures how late a thread wakes beside busy programs, with the slice of the nodes and without.

The thread sleeps for a period, again and again, as that of a simulated driver does. Beside it run
programs of the same priority that compute for 3 ms and sleep for 1 ms, again and again. The two
slices are measured in turn.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
import os
from statistics import median
import subprocess
import sys
import time

import numpy as np
from spm_haptic_master.ros.realtime import DEFAULT_SLICE, set_time_slice, time_slice

# Time between two wakes, and length of a run (s).
PERIOD, LENGTH = 1e-3, 5.0
# Program that computes and sleeps in turn.
BUSY = """import time
while True:
    end = time.monotonic() + 0.003
    while time.monotonic() < end:
        pass
    time.sleep(0.001)
"""


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Run busy programs."""
    with ExitStack() as stack:
        for _ in range(count):
            program = stack.enter_context(subprocess.Popen([sys.executable, '-c', BUSY]))
            stack.callback(program.kill)
        yield


def lateness(slice_length: float) -> np.ndarray:
    """Return by how much a thread with a time slice, s, wakes too late (us)."""
    set_time_slice(0, slice_length)
    late = []
    end = time.monotonic() + LENGTH
    while (now := time.monotonic()) < end:
        time.sleep(PERIOD)
        late.append(time.monotonic() - now - PERIOD)
    return 1e6 * np.array(late)


def main(args: Sequence[str] | None = None) -> int:
    """Measure in turn, and print each run and the median ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--programs', type=int, default=2, help='busy ones, for each core (2)')
    options = parser.parse_args(args)
    own = time_slice(0)
    if not own:
        print('this kernel has no time slices; expected Linux 6.12 or newer', file=sys.stderr)
        return 1
    ratios = []
    with busy(options.programs * (os.cpu_count() or 1)):
        for number in range(1, options.rounds + 1):
            found = [np.percentile(lateness(each), (50, 90, 99)) for each in (own, DEFAULT_SLICE)]
            ratios.append(found[1] / found[0])
            print(f'round {number} of {options.rounds}: ' + '; '.join(
                f'{1e3 * each:g} ms: p50 {p50:.0f} p90 {p90:.0f} p99 {p99:.0f} us'
                for each, (p50, p90, p99) in zip((own, DEFAULT_SLICE), found, strict=True)),
                flush=True)
    print('lateness with the short slice over that with the slice of the system, median '
          '(least .. largest):')
    for name, values in zip(('p50', 'p90', 'p99'), zip(*ratios, strict=True), strict=True):
        print(f'  {name} {median(values):.2f} ({min(values):.2f} .. {max(values):.2f})')
    return 0


if __name__ == '__main__':
    sys.exit(main())
