# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The contributor's page shows what exists; recipes of the Makefile set what users need."""

import os
import re
from runpy import run_path
import subprocess

from harness import ROOT
import pytest

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


def test_rooms_are_those_of_test_house():
    text = (ROOT / 'CONTRIBUTING.md').read_text()
    generate = run_path(str(ROOT / 'docs' / 'generate_rooms.py'))['generated']
    assert generate(text) == text, 'CONTRIBUTING.md is out of date: run `make docs`'


def test_targets_are_those_of_the_makefile():
    makefile = (ROOT / 'Makefile').read_text()
    targets = set(re.findall(r'^([a-z-]+):', makefile, re.MULTILINE))
    phony = set(' '.join(re.findall(r'^\.PHONY: (.*)', makefile, re.MULTILINE)).split())
    header = set(re.findall(r'^# make ([a-z-]+)', makefile, re.MULTILINE))
    page = set(re.findall(r'`make ([a-z-]+)', (ROOT / 'CONTRIBUTING.md').read_text()))
    assert targets == phony == header == page


# A path in a code span; a name in a file.
PATH = re.compile(r'`([\w./]+/[\w./]*|[\w/]+\.(?:py|md|rst|xml|yaml))`')
NAME_IN = re.compile(r'`(\w+)`(?: \w+)? in\s+`([\w/]+\.py)`')


def test_recipes_name_files_that_exist_and_definitions_in_them():
    """Paths are below the root or the package."""
    _, _, after = (ROOT / 'CONTRIBUTING.md').read_text().partition('\n## Where to change\n')
    text = after.partition('\n## ')[0]
    found = {
        path: next(
            (base / path for base in (ROOT, ROOT / 'spm_haptic_master') if (base / path).exists()),
            None,
        )
        for path in PATH.findall(text)
    }
    assert len(found) > 20
    assert [path for path, file in found.items() if file is None] == ['config/NAME.yaml']
    names = NAME_IN.findall(text)
    assert len(names) > 10
    assert [
        (name, path)
        for name, path in names
        if not re.search(rf'\b{name}\b', found[path].read_text())
    ] == []


@pytest.mark.process
def test_make_run_installs_what_a_bus_between_processes_needs():
    """The first command of docs/bringup on udp_multicast works in the .venv of `make run`."""
    recipe = subprocess.run(
        ['make', '--dry-run', '--what-if', 'setup.py', '.venv/run.stamp'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    extras = [set(each.split(',')) for each in re.findall(r"--editable '\.\[(.*?)\]'", recipe)]
    assert extras and all({'ros', 'multicast'} <= each for each in extras), recipe


@pytest.mark.process
@pytest.mark.parametrize(('given', 'expected'), [({}, 'LOCALHOST'), ({RANGE: 'SUBNET'}, 'SUBNET')])
def test_recipes_stay_on_this_host_unless_the_user_says_otherwise(given, expected):
    environment = {name: value for name, value in os.environ.items() if name != RANGE} | given
    found = subprocess.run(
        ['make', '--silent', f'--eval=show: ; @echo "$${RANGE}"', 'show'],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == expected
