# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""`make faults` on a small part of its rows: its verdicts, and the guard on its pages."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial

from benchmarks import fault_matrix, integrity, integrity_runs
from benchmarks.integrity import fault_verdict, healthy_verdict, isolation_verdict, Outcome
from paper import verdicts
import pytest

GOOD = Outcome(0.3, 0.0, True, 0.0, '')


@pytest.fixture
def faults(tmp_path, monkeypatch):
    """Return what runs a few of the simulated rows, each computed once, and the page."""
    committed = tmp_path / 'simulated.md'
    few = ((0.04, 14, 100.0),)
    for module, name, value in (
        # One thread: no other process has the changes.
        (integrity, 'ProcessPoolExecutor', partial(ThreadPoolExecutor, 1)),
        (integrity, 'PAGE', committed),
        (integrity, 'PLACES', {'centre': 'rest'}),
        (
            integrity,
            'CONDITIONS',
            [replace(row, kinds=('tremor',)) for row in integrity.CONDITIONS if row.rate == 100.0],
        ),
        (integrity, 'DISTURBED', (integrity.DISTURBED[0], *integrity.DISTURBED[7::2])),
        (integrity, 'jump_rows', lambda runner: ()),
        (integrity, 'coverage_rows', lambda: ()),
        (integrity, 'attack_rows', lambda found: ()),
        (integrity, 'long_rows', lambda seconds, runner: ()),
        (integrity_runs, 'DISTURBED_RUNS', 1),
        (integrity_runs, 'ENCODERS', few),
        (integrity_runs, 'MORE_ENCODERS', few),
        (integrity, 'cases', lambda sensors: [('step', 5.0, 'deg', 0)]),
        *(
            (integrity, name, cache(getattr(integrity_runs, name)))
            for name in ('healthy', 'disturbances', 'faulty')
        ),
    ):
        monkeypatch.setattr(module, name, value)

    def run(*args):
        return integrity.main([*args, str(committed)])

    assert run('--accept') == 0
    return run, committed


def test_the_rows_have_verdicts(faults, monkeypatch):
    run, committed = faults
    found = verdicts.read(committed.read_text())
    assert found['Faults: step 5 deg, joint_1a'] == 'silent'
    assert found['Faults with 6 sensors: step 5 deg'] == 'isolated'
    assert found['Healthy sensors by condition: 100 Hz'] == 'published within its level'
    disturbed = [verdict for row, verdict in found.items() if 'end stops' in row]
    assert disturbed == ['published within its level'] * 4
    computed = integrity.disturbances

    def withheld(task):
        records = computed(task)
        records[0].samples['published'][300] = False
        return records

    # One sample withheld is another verdict; of four sensors the share of `PUBLISHED` suffices.
    monkeypatch.setattr(integrity, 'disturbances', withheld)
    assert run('--accept') == 0
    found = verdicts.read(committed.read_text())
    row = 'Healthy sensors at end stops and under vibrations: vibration, {} sensors, 17 bits'
    assert found[row.format(4)] == 'published within its level'
    assert found[row.format(5)] == found[row.format(6)] == 'withheld'


LATE = GOOD._replace(undeclared=1.01)
LOUD = GOOD._replace(silent=False)


@pytest.mark.parametrize(
    ('verdict', 'given', 'found'),
    [
        (fault_verdict, ([GOOD, GOOD],), 'silent'),
        (fault_verdict, ([GOOD, LATE],), 'too late'),
        (fault_verdict, ([GOOD, LOUD],), 'within the level or declared, silent in part'),
        (fault_verdict, ([LOUD, LOUD],), 'within the level or declared'),
        (isolation_verdict, ([GOOD, GOOD], 2, 0), 'isolated'),
        (isolation_verdict, ([GOOD, GOOD], 1, 0), 'isolated in part'),
        (isolation_verdict, ([GOOD, GOOD], 1, 1), 'another sensor excluded'),
        (isolation_verdict, ([GOOD, LATE], 2, 0), 'too late'),
        (isolation_verdict, ([GOOD, GOOD], 0, 0), 'silent'),
        (isolation_verdict, ([GOOD, LOUD], 0, 0), 'within the level'),
        (healthy_verdict, (1.0, 0.5), 'published within its level'),
        (healthy_verdict, (0.98, 0.5), 'withheld'),
        (healthy_verdict, (1.0, 1.01), 'beyond its level'),
    ],
)
def test_runs_have_a_verdict(verdict, given, found):
    assert verdict(*given) == found


def test_a_violation_fails_although_it_is_accepted(faults, monkeypatch, capsys):
    run, _ = faults
    worst = [f'| fault | {verdicts.COLUMN} |', '|---|---|', '| step | beyond its level |']
    monkeypatch.setattr(integrity, 'attack_rows', lambda found: worst)
    assert run('--accept') == 1
    assert 'violation, whatever is committed: Directed search: step' in capsys.readouterr().err


@pytest.mark.parametrize('page', [integrity.PAGE, fault_matrix.PAGE])
def test_the_committed_pages_have_verdicts(page):
    found = verdicts.read(page.read_text(encoding='utf-8'))
    assert found
    assert not set(integrity.VIOLATIONS) & set(found.values())
