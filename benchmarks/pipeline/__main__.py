# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure the real nodes beside a bare relay, as separate processes and composed in one."""

from __future__ import annotations

from pathlib import Path
import sys

from benchmarks.command_line import measurement_parser, run
from benchmarks.pipeline.comparison import compare
from spm_haptic_master.parameters.arguments import positive


def main(args: list[str] | None = None) -> int:
    """Compare the pipelines; return the exit code."""
    parser = measurement_parser('bench-pipeline', __doc__)
    parser.add_argument('--seconds', type=positive, default=20.0, help='of a run (20)')
    parser.add_argument('--rounds', type=int, default=5, help='of all pipelines in turn (5)')
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('build/bench-pipeline'),
        metavar='DIR',
        help='for runs.csv (build/bench-pipeline)',
    )
    return run(
        parser,
        lambda given, parameters: compare(
            given.seconds, given.rounds, given.rate, parameters, given.output
        ),
        args,
    )


if __name__ == '__main__':
    sys.exit(main())
