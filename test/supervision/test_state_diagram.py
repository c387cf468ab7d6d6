# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The diagram of the states in docs/safety.md: each drawn transition occurs, and no other."""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
import re

from device import encoders, joint_angles, motion, stamps
import numpy as np
import pytest
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.orientation_state import Condition
from spm_haptic_master.supervision.supervisor import make_supervisor

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'safety.md'
DIAGRAM = re.compile(r'```mermaid\nstateDiagram-v2\n(.*?)```', re.DOTALL)
NAME = re.compile(r'^ *state "([A-Z]+) - .*" as (\w+)$', re.MULTILINE)
ARROW = re.compile(r'^ *(\S+) --> (\S+)(?: : (.+))?$', re.MULTILINE)
# Of the runs.
RATE, SECONDS = 250.0, 2.0
PLACES = ('rest', 'singular', 'crossing', 'turning', 'sweep', 'rim')

Transition = tuple[str, str]
Run = tuple[str, np.ndarray, np.ndarray, dict[str, object]]


def drawn() -> tuple[str, dict[Transition, str]]:
    """Return the first state of the diagram, and its transitions with their conditions."""
    (diagram,) = DIAGRAM.findall(PAGE.read_text(encoding='utf-8'))
    states = {name: label for label, name in NAME.findall(diagram)}
    arrows = ARROW.findall(diagram)
    (first,) = (states[end] for begin, end, _ in arrows if begin == '[*]')
    return first, {(states[begin], states[end]): words
                   for begin, end, words in arrows if begin != '[*]'}


def disturbances(seeds: Iterable[int]) -> Iterator[Run]:
    """Yield interference, samples that are lost, clocks that are set."""
    for seed in seeds:
        rng = np.random.default_rng([2, seed])
        sensors, place = 4 + seed % 3, PLACES[seed % len(PLACES)]
        true = joint_angles(motion(place, SECONDS, RATE), sensors)
        n, begin = len(true), int(rng.choice([0, 2, 100, 300]))
        span = slice(begin, begin + int(rng.choice([3, 10, 40])))
        which = rng.choice(sensors, size=rng.integers(1, 3), replace=False)
        interference = encoders(true, seed=seed)
        interference[span, which] += np.radians(rng.choice([1.0, 3.0, 20.0]))
        spikes = encoders(true, seed=seed)
        spikes[begin:begin + 200:12, which[0]] += np.radians(5.0)
        missing = encoders(true, seed=seed)
        missing[span.start:span.stop + 100, which] = np.nan
        noisy = encoders(true, seed=seed)
        noisy[300:, which[0]] += np.radians(2.0) * rng.normal(size=n - 300)
        pause = stamps(n, RATE)
        pause[span.stop - 1:] += int(rng.choice([100_000_000, 600_000_000, -2_000_000_000]))
        times, short = stamps(n, RATE), {'recovery': 0.2}
        yield f'interference {seed}', times, interference, short
        yield f'interference and a pause {seed}', pause, interference, short
        yield f'spikes {seed}', times, spikes, short
        yield f'missing {seed}', times, missing, {}
        yield f'missing and a pause {seed}', pause, missing, {}
        yield f'noisy {seed}', times, noisy, {}
        yield f'checked first {seed}', pause, interference, {**short, 'start_checked': True}
        yield f'low alert limit {seed}', times, interference, {**short, 'alert_limit_deg': 0.4}
        # More consistent samples before an orientation than those that clear a fault.
        yield f'a long start {seed}', times, interference, {
            'recovery': 0.05, 'start_samples': 100}


def second_faults(seeds: Iterable[int]) -> Iterator[Run]:
    """Yield what meets a device that is degraded, or without an orientation yet."""
    for seed in seeds:
        true = joint_angles(motion(PLACES[seed], SECONDS, RATE), 6)
        times, short = stamps(len(true), RATE), {'recovery': 0.2}
        excluded = encoders(true, seed=seed)
        excluded[150:400, seed] += np.radians(4.0)
        two = excluded.copy()
        two[300:350, [(seed + 1) % 6, (seed + 3) % 6]] += np.radians([5.0, 3.0])
        yield f'two more faults {seed}', times, two, short
        lost = excluded.copy()
        lost[300:330] = np.nan
        yield f'no samples while degraded {seed}', times, lost, short
        wrong = encoders(true, seed=seed)[:, :4]
        wrong[200:230, seed % 4] = np.nan
        wrong[230:300, seed % 4] += np.radians(5.0)
        yield f'a sensor that comes back wrong {seed}', times, wrong, short
        early = encoders(true, seed=seed)[:, :4]
        early[100:110, :2] += np.radians(3.0)
        yield f'a fault before the first check {seed}', times, early, {
            **short, 'start_checked': True}


def made(runs: Iterator[Run], first: str) -> dict[Transition, str]:
    """Return the transitions that runs make, each with the label of a run."""
    found: dict[Transition, str] = {}
    for label, times, angles, parameters in runs:
        supervisor = make_supervisor(complete(
            FKM_SETTINGS, {'sensors': angles.shape[1], **parameters}))
        state = first
        for stamp, row in zip(times.tolist(), angles.tolist(), strict=True):
            announced, last = supervisor.take(stamp, tuple(row)).announced, state
            state = announced.condition.name
            if announced.condition is Condition.SILENT:
                state = 'FAULT' if supervisor.latch.symptom else 'SETTLING'
            if state != last:
                found.setdefault((last, state), f'{label}: {announced.text}')
    return found


@pytest.mark.parametrize('runs', [
    pytest.param(lambda: chain(disturbances((0, 1, 2)), second_faults((0, 1))), id='few'),
    pytest.param(lambda: chain(disturbances(range(20)), second_faults(range(6))), id='all',
                 marks=pytest.mark.evidence)])
def test_each_transition_of_the_diagram_occurs_with_its_condition_and_no_other(runs):
    first, transitions = drawn()
    assert first == 'STARTING' and all(transitions.values())
    found = made(runs(), first)
    assert {pair: label for pair, label in found.items() if pair not in transitions} == {}
    assert {pair: words for pair, words in transitions.items() if pair not in found} == {}
