# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The guard of the pages: a verdict that is not the committed one fails, by its row's name."""

import re

from harness import ROOT
import pytest

pytest.importorskip('matplotlib')
pytest.importorskip('mujoco')

from paper import __main__ as command  # noqa: E402, I100
from paper import solve_times, verdicts  # noqa: E402
from paper.figure_entry import Entry, Verdict  # noqa: E402

TOPICS = (
    'geometry_figures',
    'dexterity_maps',
    'mode_branches',
    'sensor_placement',
    'scenarios',
    'rig_figures',
)


@pytest.fixture
def paper(tmp_path, monkeypatch):
    """Return what runs `make paper` with one figure of a verdict, and the committed page."""
    committed = tmp_path / 'committed'
    monkeypatch.setattr(command, 'DEFAULT_OUTPUT', committed)

    def run(found, *args):
        for number, name in enumerate(reversed(TOPICS), start=25):
            monkeypatch.setattr(
                f'paper.{name}.entries',
                lambda out, number=number: [
                    Entry(
                        (number,),
                        'what',
                        'a',
                        'b',
                        found if number == 27 else Verdict.AGREES,
                    )
                ],
            )
        monkeypatch.setattr(
            solve_times, 'entries', lambda: [Entry((), 'times', 'a', 'b', Verdict.PARTLY)]
        )
        return command.main([*args])

    assert run(Verdict.AGREES, '--accept') == 0
    return run, committed / 'README.md'


def test_the_page_is_in_the_order_of_the_paper(paper):
    _, committed = paper
    assert re.findall(r'^## (.+): ', committed.read_text(), re.MULTILINE) == [
        'Fig. 25',
        'Fig. 26',
        'Fig. 27',
        'Fig. 28',
        'Fig. 29',
        'Fig. 30',
        'Section 5',
    ]


def test_a_verdict_that_changes_fails_by_its_row_and_leaves_the_page(paper, tmp_path, capsys):
    run, committed = paper
    before = committed.read_bytes()
    capsys.readouterr()
    assert run(Verdict.DIFFERS) == 1
    out, err = capsys.readouterr()
    assert [line[:5] for line in out.splitlines()[:7]] == [f'[{n}/7]' for n in range(1, 8)]
    change, hint = err.splitlines()
    assert change == "paper: At a glance: Fig. 27: committed 'agrees', found 'differs'"
    assert '--accept' in hint
    # A page elsewhere is held against the committed one.
    assert run(Verdict.DIFFERS, '-o', str(tmp_path / 'elsewhere')) == 1
    assert 'differs' in (tmp_path / 'elsewhere' / 'README.md').read_text()
    assert committed.read_bytes() == before


def test_a_verdict_that_was_accepted_is_the_one_that_is_expected(paper):
    run, _ = paper
    assert run(Verdict.DIFFERS, '--accept') == 0
    assert run(Verdict.DIFFERS) == 0
    assert run(Verdict.AGREES) == 1


def test_a_page_that_cannot_be_written_is_one_line(paper, tmp_path, capsys):
    run, _ = paper
    (tmp_path / 'file').write_text('')
    capsys.readouterr()
    assert run(Verdict.AGREES, '-o', str(tmp_path / 'file' / 'below')) == 1
    err = capsys.readouterr().err
    assert err.startswith('paper: ')
    assert err.count('\n') == 1
    assert 'cannot be written' in err


def test_rows_that_come_and_go_are_changes(tmp_path):
    committed = tmp_path / 'page.md'
    committed.write_text(
        '## One\n\n| fault | n | verdict |\n|---|---|---|\n'
        '| [step](#a) | 3 | late |\n| ramp | 4 | fine |\n'
    )
    new = (
        '## One\n\n| fault | n | verdict |\n|---|---|---|\n| step | 5 | late |\n'
        '| noise | 6 | fine |\n\n| fault | n |\n|---|---|\n| step | 9 |\n'
    )
    assert verdicts.changes(committed, new) == [
        "One: ramp: committed 'fine', found no such row",
        "One: noise: committed no such row, found 'fine'",
    ]


@pytest.mark.parametrize('name', ['paper', 'sensors', 'force'])
def test_a_page_in_the_repository_has_verdicts_small_pictures_and_no_place_of_a_machine(name):
    page = ROOT / 'docs' / name / 'README.md'
    text = page.read_text(encoding='utf-8')
    found = verdicts.read(text)
    assert len(found) > 10
    assert Verdict.DIFFERS.value not in found.values()
    sizes = {path.name: path.stat().st_size for path in page.parent.glob('*.png')}
    assert set(sizes) == set(re.findall(r'\]\((\S+\.png)\)', text))
    assert max(sizes.values()) <= 200_000
    assert sum(sizes.values()) < 4_000_000
    assert not re.search(r'/(home|work|tmp|root|usr)/', text)
