# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The contributor's page shows the rooms and the targets that exist."""

from pathlib import Path
import re
from runpy import run_path

ROOT = Path(__file__).resolve().parents[1]


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
