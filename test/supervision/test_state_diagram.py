# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The diagram of the states in docs/safety.md: each drawn transition occurs, and no other."""

from math import nan
from pathlib import Path
import re

import numpy as np
import pytest
from rig import MS, NAMES, Rig

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'safety.md'
DIAGRAM = re.compile(r'```mermaid\nstateDiagram-v2\n(.*?)```', re.DOTALL)
NAME = re.compile(r'^ *state "([A-Z]+) - .*" as (\w+)$', re.MULTILINE)
ARROW = re.compile(r'^ *(\S+) --> (\S+)(?: : (.+))?$', re.MULTILINE)
# Of the devices, in turn. With `start_samples` more are due at the start than after a fault.
SETTINGS = (
    {'recovery': 1.0},
    {'recovery': 0.05, 'start_samples': 100},
    {'start_checked': True},
    {'alert_limit_deg': 0.4},
    {},
)


def drawn():
    """Return the transitions of the diagram with their conditions; its begin is '[*]'."""
    (diagram,) = DIAGRAM.findall(PAGE.read_text(encoding='utf-8'))
    states = {'[*]': '[*]'}
    for label, name in NAME.findall(diagram):
        states[name] = label
    transitions = {}
    for begin, end, words in ARROW.findall(diagram):
        transitions[states[begin], states[end]] = words
    return transitions


def state(rig):
    """Return the state of a rig as the diagram names it."""
    name = rig.verdict.announced.condition.name
    if name != 'SILENT':
        return name
    return 'FAULT' if rig.supervisor.latch.fault else 'SETTLING'


def made(seed):
    """Yield the transitions of a device with faults, lost readings, gaps, clocks set back."""
    rng = np.random.default_rng(seed)
    rig = Rig(4 + seed % 3, healthy=False, **{'recovery': 0.1} | SETTINGS[seed % 5])
    last = '[*]'
    pauses = [0, 0, 0, 0, 0, 7, 99, 699, -2001]
    for _ in range(40):
        rig.now += int(rng.choice(pauses)) * MS
        count = rng.integers(0, 3)
        which = rng.choice(NAMES[: rig.sensors], size=count, replace=False)
        moved = {name: rng.choice([5.0, -3.0, 1.0, nan, 20.0]) for name in which}
        for _ in range(rng.choice([1, 2, 4, 30, 130])):
            rig.sample(**moved)
            if state(rig) != last:
                yield last, state(rig)
                last = state(rig)


@pytest.mark.parametrize(
    'seeds',
    [
        pytest.param((0, 2, 6, 13, 22, 32, 44), id='few'),
        pytest.param(range(120), id='all', marks=pytest.mark.evidence),
    ],
)
def test_each_transition_of_the_diagram_occurs_with_its_condition_and_no_other(seeds):
    expected = drawn()
    for (begin, _), words in expected.items():
        assert words or begin == '[*]'
    occurred = set()
    for seed in seeds:
        occurred.update(made(seed))
    assert occurred == set(expected)
