# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of evidence: what its commands print, with day and machine."""

import os
import re
import subprocess
import sys
import tempfile

from benchmarks import evidence
from benchmarks.evidence import Measurer, Section, SECTIONS
from harness import ROOT
import pytest

SECTION = Section('Loss', 'Samples that are lost.', ('make bench-pipeline', 'make bench'))
PRINTED = {
    'make bench-pipeline': (
        'round 1 of 5, bare: p50\n| pipeline | p50 |\n|---|---|\n| bare | 404 |\n'
    ),
    'make bench': 'sample  712 math.sin\n\nwritten: build/x\n',
}


def test_a_section_has_its_commands_results_day_and_machine(monkeypatch, tmp_path):
    monkeypatch.setattr(evidence, 'machine', lambda: '2026-11-26, 2 x Xeon, Linux 6.18')
    page = Measurer(tmp_path / 'kept', run_command=PRINTED.__getitem__).page([SECTION])
    assert page.startswith('# Evidence\n\nWhat was measured')
    day = re.search(r'`make bench`, (\d{4}-\d\d-\d\d), 2 x Xeon, Linux 6.18:', page)[1]
    assert page.endswith(
        '## Loss\n\nSamples that are lost.\n\n'
        f'`make bench-pipeline`, {day}, 2 x Xeon, Linux 6.18:\n\n'
        '| pipeline | p50 |\n|---|---|\n| bare | 404 |\n\n'
        f'`make bench`, {day}, 2 x Xeon, Linux 6.18:\n\n'
        '```\nsample  712 math.sin\n```\n'
    )


@pytest.mark.parametrize(
    ('printed', 'result'),
    [
        pytest.param("make[1]: Entering directory '/home/user/checkout'", [], id='make'),
        pytest.param('.venv/bin/python -m benchmarks.soak', [], id='command'),
        pytest.param('rootdir: /home/user/checkout', [], id='pytest'),
        pytest.param('test/force/test_energy.py ...      [  8%]', [], id='progress'),
        pytest.param('== test session starts ==', [], id='heading'),
        pytest.param('== 174 passed in 926.33s ==', ['== 174 passed in 926.33s =='], id='sum'),
        pytest.param(
            f'{tempfile.gettempdir()}/pytest-of-user/book0/calibration.yaml: written',
            ['calibration.yaml: written'],
            id='temporary file',
        ),
    ],
)
def test_a_result_names_no_folder_of_the_machine(printed, result):
    assert evidence.results(printed) == result


def test_a_measurement_that_was_interrupted_goes_on_where_it_ended(tmp_path):
    kept = tmp_path / 'build' / 'kept'
    first, second = SECTION.commands
    with pytest.raises(KeyError):
        Measurer(kept, run_command={first: PRINTED[first]}.__getitem__).page([SECTION])
    # The first command is not run again, unless nobody asks to go on.
    rest = {second: PRINTED[second]}.__getitem__
    resumed = Measurer(kept, resume=True, run_command=rest)
    assert '404' in resumed.page([SECTION])
    assert '712 math.sin' in resumed.page([SECTION])
    with pytest.raises(KeyError):
        Measurer(kept, run_command=rest).page([SECTION])


def test_a_command_that_fails_leaves_the_page_as_it_was(monkeypatch, tmp_path):
    monkeypatch.setattr(evidence, 'PAGE', tmp_path / 'evidence.md')
    monkeypatch.setattr(evidence, 'KEPT', tmp_path / 'build' / 'evidence.json')
    monkeypatch.setattr(evidence, 'SECTIONS', [Section('A', 'b', ('exit 3',))])
    with pytest.raises(SystemExit, match='exit code 3; nothing was written'):
        evidence.main(['--write'])
    assert not (tmp_path / 'evidence.md').exists()


def test_every_command_of_the_page_exists():
    makefile = (ROOT / 'Makefile').read_text()
    for command in (command for section in SECTIONS for command in section.commands):
        program, name, *_ = command.split()
        if program == 'make':
            assert f'\n{name}:' in makefile
        else:
            module = command.split()[2]
            path = next((word for word in command.split() if word.startswith('test')), None)
            assert (ROOT / (path or module.replace('.', '/') + '.py')).exists(), command


def test_a_make_within_make_gets_no_arguments_of_the_outer_one(tmp_path):
    """`make evidence ARGS=--write` is not `make bench-pipeline ARGS=--write`."""
    makefile = tmp_path / 'Makefile'
    inner = f'make -s -f {makefile} inner'
    command = f'from benchmarks.evidence import run; run({inner!r})'
    makefile.write_text(
        f'outer:\n\t{sys.executable} -c "{command}"\ninner:\n\t@echo "<$(ARGS)>"\n'
    )
    outer = ['make', '-f', str(makefile), 'outer', 'ARGS=--write']
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    printed = subprocess.run(outer, env=environment, cwd=ROOT, capture_output=True, text=True)
    assert '<>' in printed.stdout, printed
