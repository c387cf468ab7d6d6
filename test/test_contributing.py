# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The contributor's page shows what exists; recipes of the Makefile set what users need."""

import os
import re
from runpy import run_path
import subprocess

from encoder_frames import make_layouts, values
from harness import ROOT
import pytest
import yaml

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
    assert phony == targets, 'Makefile: .PHONY and its targets differ'
    assert header == targets, 'Makefile: its first comment and its targets differ'
    assert page == targets, 'CONTRIBUTING.md, "Targets", and the targets of the Makefile differ'


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
    missing = [path for path, file in found.items() if file is None]
    assert missing == ['config/NAME.yaml'], 'CONTRIBUTING.md names files that do not exist'
    names = NAME_IN.findall(text)
    assert len(names) > 10
    missing = [
        f'{name} in {path}'
        for name, path in names
        if not re.search(rf'\b{name}\b', found[path].read_text())
    ]
    assert not missing, f'CONTRIBUTING.md, "Where to change": there is no {missing}'


def test_the_frame_layout_of_the_recipe_is_the_one_that_it_describes():
    """A status bit first, then 20 bits of counts from bit 12 to the last of four bytes."""
    block = re.search(r'```yaml\n(.*?)```', (ROOT / 'CONTRIBUTING.md').read_text(), re.DOTALL)
    given = yaml.safe_load(block[1])
    layouts = make_layouts(values(**{f'encoders__{name}': value for name, value in given.items()}))
    bits = '1' + 11 * '0' + f'{0xABCDE:020b}'
    good = int(bits, 2).to_bytes(4, 'big')
    bad = int('0' + bits[1:], 2).to_bytes(4, 'big')
    for layout in layouts:
        assert layout.counts(good) == 0xABCDE
        assert layout.healthy(good)
        assert not layout.healthy(bad)


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
