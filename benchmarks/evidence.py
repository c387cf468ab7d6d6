# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Measure what docs/evidence.md states, and write the page: python -m benchmarks.evidence --write.

Every figure of the page is the output of a command, printed as it came, with the day and the
machine. The page is written only after all commands have succeeded.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
import re
import subprocess
import sys
import textwrap

from benchmarks.pipeline.comparison import machine

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'evidence.md'
# Lines of progress and of pytest that are no result.
NO_RESULT = re.compile(r'^(round \d+ of|=+|_+|[.sx]+ +\[|-+ Captured|written: |skipped because)')
BEGIN = (
    'What was measured, when, by which command, on which machine. `make evidence ARGS=--write` '
    'runs all of it and writes this page. Times are those of that machine. Further results are on '
    'generated pages, whose verdicts their commands compare: [faults](faults/README.md) '
    '(`make faults`), [sensors](sensors/README.md) (`make study`), [paper](paper/README.md) '
    '(`make paper`), [force](force/README.md) (`make force`).'
)
# Columns of the page's text.
WIDTH = 128


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the page: what is measured, and by which commands."""

    title: str
    text: str  # what the figures mean
    commands: tuple[str, ...]  # as one types them: `make TARGET` or `python -m MODULE ...`


SECTIONS = (
    Section(
        'The long tests',
        'Tests that take minutes, and print what they measure: `make evidence`.',
        ('python -m pytest -rfEsP -m evidence test',),
    ),
    Section(
        'Cost of a sample',
        'Time of each function of the kinematics, of a supervised sample and of one of force '
        'feedback, in units of one `math.sin` of the same run, and the limits.',
        ('make bench',),
    ),
    Section(
        'Latency, loss and CPU',
        'Latency from sample stamp to observer. A bare relay is an rclpy node that passes the '
        'same messages on and computes nothing. A run is *disturbed* where other programs '
        'took a fifth of a core, or the control thread was late.',
        ('make bench-pipeline',),
    ),
    Section(
        'From a wrench to the motors',
        'From the publication of a wrench to the torque frame on the bus, simulated encoders '
        'and drives, beside a bare subscription of the same wrench.',
        (
            'python -m benchmarks.force_latency --rate 500',
            'python -m benchmarks.force_latency --rate 250',
        ),
    ),
    Section(
        'A slave stops',
        'Time of the last command after a process of the chain was stopped or killed.',
        ('python -m benchmarks.teleop_stops',),
    ),
    Section(
        'Soak',
        'The nodes with `sim_bus` at 1 kHz, a `recorder`, every 30 s a subscriber to all '
        'outputs that leaves by Ctrl-C or SIGKILL, and every 5 minutes a bus-off or a loss of '
        'power for 5 s.',
        ('make soak ARGS="--minutes 30"',),
    ),
    Section(
        'Calibration of simulated rigs',
        'Rigs of which nothing is known, links and axes 0.3 deg off, first harmonics 0.12 '
        'deg, second ones 0.015 deg, for the default alert limit. *Wrong* counts calibrations '
        'that were written with a wrong zero or direction, with an orientation error on '
        'another motion of more than 3.5 times the predicted one, or with an error of a '
        'sensor of more than 1.3 times its `bias_deg` at any pose of their region. Figures '
        'include refused calibrations: what a larger alert limit would write. The squared '
        'error is the mean over all parameters; the predicted deviations cover it where it is '
        '1 or less.',
        ('python -m benchmarks.calibration',),
    ),
    Section(
        'Accuracy of the models',
        'The covariance of `estimate` is of first order: rms of the rotation error over the '
        'stated one, and the share of errors beyond the limit that one in a thousand should '
        'exceed, 20,000 samples a row. The models beside each other over the whole workspace: '
        '[Figs. 13, 14](paper/README.md#figs-13-14-the-same-over-the-whole-workspace).',
        ('python -m pytest -s test/kinematics/test_covariance_limits.py',),
    ),
)


def results(output: str) -> list[str]:
    """Return the lines of a command's output that are results."""
    lines = [line.rstrip() for line in output.splitlines()]
    return [line for line in lines if line and not NO_RESULT.match(line)]


def wrapped(text: str) -> str:
    """Return a paragraph of the page, in lines."""
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def section_text(section: Section, outputs: Sequence[str], day: str, where: str) -> str:
    """
    Return a section of the page in Markdown.

    Parameters
    ----------
    section : Section
        What was measured.
    outputs : sequence of str
        What each of its commands printed.
    day, where : str
        The day, and the machine in one line.

    Returns
    -------
    str
        Heading, text, and for each command its results: tables as they are, the rest verbatim.

    """
    parts = [f'## {section.title}', wrapped(section.text)]
    for command, output in zip(section.commands, outputs, strict=True):
        lines = results(output)
        is_table = [line.startswith('|') for line in lines]
        tables = [line for line, known in zip(lines, is_table, strict=True) if known]
        others = [line for line, known in zip(lines, is_table, strict=True) if not known]
        parts.append(f'`{command}`, {day}, {where}:')
        if tables:
            parts.append('\n'.join(tables))
        if others:
            parts.append('\n'.join(['```', *others, '```']))
    return '\n\n'.join(parts) + '\n'


def run(command: str) -> str:
    """Run a command of the page; return its output; SystemExit if it fails."""
    words = (
        command.replace('python ', f'{sys.executable} ', 1) if command[:6] == 'python' else command
    )
    print(f'evidence: {command}', file=sys.stderr, flush=True)
    done = subprocess.run(words, shell=True, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    print(done.stdout, flush=True)
    if done.returncode:
        raise SystemExit(f'evidence: {command}: exit code {done.returncode}; nothing was written')
    return done.stdout


def measure(sections: Sequence[Section], runs: Callable[[str], str] = run) -> str:
    """Run the commands of the sections; return the page."""
    where = machine().partition(', ')[2]
    day = date.today().isoformat()
    texts = [
        section_text(section, [runs(command) for command in section.commands], day, where)
        for section in sections
    ]
    return '\n'.join([f'# Evidence\n\n{wrapped(BEGIN)}\n', *texts])


def main(args: Sequence[str] | None = None) -> int:
    """Run the long tests alone, or everything and write the page."""
    parser = argparse.ArgumentParser(prog='evidence', description=__doc__)
    parser.add_argument('--write', action='store_true', help='measure all and write the page')
    if not parser.parse_args(args).write:
        run(SECTIONS[0].commands[0])
        return 0
    page = measure(SECTIONS)
    PAGE.write_text(page, encoding='utf-8')
    print(f'evidence: written: {PAGE.relative_to(ROOT)}', file=sys.stderr)
    return 0


if __name__ == '__main__':
    sys.exit(main())
