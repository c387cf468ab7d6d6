# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Measure what docs/evidence.md states, and write the page: python -m benchmarks.evidence --write.

Every figure of the page is the output of a command, printed as it came, with the day and the
machine. The page is written only after all commands have succeeded. What has been measured until
then is kept in build/evidence.json: `--resume` goes on behind it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import date
import json
import os
from pathlib import Path
import re
import subprocess
import sys
import tempfile
import textwrap

from benchmarks.pipeline.comparison import machine

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'evidence.md'
# What has been measured, by command.
KEPT = ROOT / 'build' / 'evidence.json'
# Lines of progress, of make and of pytest that are no result.
NO_RESULT = re.compile(
    r'^(round \d+ of|written: |skipped because|\(viser\)'  # progress
    r'|calibrate: ( *\d+ %|\d+ sets read)'
    r'|make\[\d+\]: |\.venv/bin/python '  # make, and what it runs
    r'|=+ (?!\d+ \w+)|=+$|_+|-+ Captured|[.sx]+ +\[| +\[|test/\S+\.py( |$)'  # pytest
    r'|(platform|rootdir|configfile|plugins|collected)\b)'
)
# A folder that a test has made for itself.
TEMPORARY = re.compile(rf'{re.escape(tempfile.gettempdir())}/\S*/')
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
class Measurement:
    """What a command printed, on which day and machine."""

    day: str
    machine: str
    output: str


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
        'Insertion and gripper',
        'CPU time for a cycle of the bus with four encoders, and with six frames: to decode, to '
        'receive, and of the whole process.',
        ('python -m benchmarks.bus_decoding',),
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
        ('make soak ARGS="--minutes 10"',),
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
    lines = [TEMPORARY.sub('', line.rstrip()) for line in output.splitlines()]
    return [line for line in lines if line and not NO_RESULT.match(line)]


def wrapped(text: str) -> str:
    """Return a paragraph of the page, in lines."""
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def section_text(section: Section, measurements: Sequence[Measurement]) -> str:
    """
    Return a section of the page in Markdown.

    Parameters
    ----------
    section : Section
        What was measured.
    measurements : sequence of Measurement
        What each of its commands printed.

    Returns
    -------
    str
        Heading, text, and for each command its results: tables as they are, the rest verbatim.

    """
    parts = [f'## {section.title}', wrapped(section.text)]
    for command, measured in zip(section.commands, measurements, strict=True):
        lines = results(measured.output)
        tables = [line for line in lines if line.startswith('|')]
        others = [line for line in lines if not line.startswith('|')]
        parts.append(f'`{command}`, {measured.day}, {measured.machine}:')
        if tables:
            parts.append('\n'.join(tables))
        if others:
            parts.append('\n'.join(['```', *others, '```']))
    return '\n\n'.join(parts) + '\n'


def own_environment() -> dict[str, str]:
    """Return the environment without what `make evidence ARGS=...` hands to a make within it."""
    of_make = 'ARGS', 'MAKEFLAGS', 'MAKEOVERRIDES', 'MFLAGS'
    return {name: value for name, value in os.environ.items() if name not in of_make}


def run(command: str) -> str:
    """Run a command of the page; return its output; SystemExit if it fails."""
    words = (
        command.replace('python ', f'{sys.executable} ', 1) if command[:6] == 'python' else command
    )
    print(f'evidence: {command}', file=sys.stderr, flush=True)
    done = subprocess.run(
        words,
        shell=True,
        cwd=ROOT,
        env=own_environment(),
        stdout=subprocess.PIPE,
        text=True,
    )
    print(done.stdout, flush=True)
    if done.returncode:
        raise SystemExit(f'evidence: {command}: exit code {done.returncode}; nothing was written')
    return done.stdout


class Measurer:
    """
    Runs commands, and keeps what they print in a file as soon as it is known.

    Parameters
    ----------
    kept : Path
        The file.
    resume : bool
        Whether what is in it is not measured again.
    run_command : callable
        Runs a command and returns its output.

    """

    def __init__(
        self,
        kept: Path,
        resume: bool = False,
        run_command: Callable[[str], str] = run,
    ):
        self._kept = kept
        self._run = run_command
        self._machine = machine().partition(', ')[2]
        self._measured: dict[str, Measurement] = {}
        if resume and kept.exists():
            for command, values in json.loads(kept.read_text(encoding='utf-8')).items():
                self._measured[command] = Measurement(**values)

    def measure(self, command: str) -> Measurement:
        """Return what a command prints, or has printed before."""
        if command not in self._measured:
            output = self._run(command)
            day = date.today().isoformat()
            self._measured[command] = Measurement(day, self._machine, output)
            values = {name: asdict(measured) for name, measured in self._measured.items()}
            self._kept.parent.mkdir(exist_ok=True)
            self._kept.write_text(json.dumps(values, indent=1), encoding='utf-8')
        return self._measured[command]

    def page(self, sections: Sequence[Section]) -> str:
        """Run the commands of the sections; return the page."""
        texts = [
            section_text(section, [self.measure(command) for command in section.commands])
            for section in sections
        ]
        return '\n'.join([f'# Evidence\n\n{wrapped(BEGIN)}\n', *texts])


def main(args: Sequence[str] | None = None) -> int:
    """Run the long tests alone, or everything and write the page."""
    parser = argparse.ArgumentParser(prog='evidence', description=__doc__)
    parser.add_argument('--write', action='store_true', help='measure all and write the page')
    parser.add_argument(
        '--resume', action='store_true', help='with --write: go on where the last one ended'
    )
    options = parser.parse_args(args)
    if not options.write:
        run(SECTIONS[0].commands[0])
        return 0
    page = Measurer(KEPT, options.resume).page(SECTIONS)
    PAGE.write_text(page, encoding='utf-8')
    print(f'evidence: written: {PAGE.relative_to(ROOT)}', file=sys.stderr)
    return 0


if __name__ == '__main__':
    sys.exit(main())
