# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""README and docs: links resolve, generated pages are current, quoted names exist."""

from pathlib import Path
import re
from runpy import run_path
import sys

from benchmarks.evidence import Measurer, SECTIONS
from docs.__main__ import changed, contents
from harness import ROOT
import pytest
from spm_haptic_master.parameters.encoders import CAN_SETTINGS
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.nodes import TELEOP_SETTINGS
from spm_haptic_master.supervision.symptom import Reason
from test_house import NOT_INSTALLED, OUTSIDE
import yaml

PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]
# Pages beside README that are not in the index.
BESIDE = [ROOT / name for name in ('CONTRIBUTING.md', 'QUALITY_DECLARATION.md', 'SECURITY.md')]
README_LINES = 150
LINK = re.compile(r'!?\[[^\]]*\]\(([^)\s]+)\)')
CODE_BLOCK = re.compile(r'^```.*?^```', re.MULTILINE | re.DOTALL)


def text_of(page: Path) -> str:
    return page.read_text(encoding='utf-8')


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub makes of a page's headings."""
    found = set()
    for heading in re.findall(r'^#+ (.*)$', CODE_BLOCK.sub('', text_of(page)), re.MULTILINE):
        kept = ''.join(c for c in heading.lower() if c.isalnum() or c in ' -_')
        found.add(kept.replace(' ', '-'))
    return found


@pytest.mark.parametrize(
    'page',
    [*PAGES, *BESIDE],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_relative_links_resolve(page):
    broken = []
    for link in LINK.findall(CODE_BLOCK.sub('', text_of(page))):
        if link.startswith(('http://', 'https://')):
            continue
        path, _, anchor = link.partition('#')
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken, f'{page.name}: links to files or headings that do not exist: {broken}'


@pytest.mark.parametrize(
    'page',
    [*PAGES, *BESIDE],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_a_page_ends_with_one_newline_and_no_line_with_a_space(page):
    """As pre-commit asks of each file that a commit changes."""
    lines = text_of(page).split('\n')
    spaced = [number for number, line in enumerate(lines, 1) if line != line.rstrip()]
    assert not spaced, f'{page.name}: spaces at the end of lines {spaced}'
    assert lines[-1] == '' and lines[-2], f'{page.name}: expected one newline at the end'


def test_every_page_is_in_the_index():
    index = ROOT / 'docs' / 'README.md'
    named = {
        (index.parent / link.partition('#')[0]).resolve() for link in LINK.findall(text_of(index))
    }
    missing = {page for page in PAGES[1:] if page != index} - named
    assert not missing, f'docs/README.md needs a link to {missing}'


def test_generated_texts_are_current(monkeypatch):
    """And README keeps to its length."""
    monkeypatch.syspath_prepend(str(ROOT))
    from docs import generate_executables, generate_refusals

    readme = text_of(generate_executables.README)
    assert generate_executables.table() in readme, 'run `make docs`'
    is_current = generate_refusals.page() == text_of(generate_refusals.PAGE)
    assert is_current, 'docs/refused.md: run `make docs`'
    assert len(readme.splitlines()) <= README_LINES


def test_parameters_named_in_the_pages_exist():
    """A code span that begins with a prefix of the parameters names one of them."""
    known = set(
        re.findall(r'^\| `([\w.]+)` \|', text_of(ROOT / 'docs' / 'parameters.md'), re.MULTILINE)
    )
    pattern = re.compile(
        r'`((?:can|encoders|force|replay|sim|geometry|mounting|realtime|teleop|gripper|slave)'
        r'(?:\.[a-z]\w*)+)'
    )
    unknown = {
        f'{page.name}: {name}'
        for page in PAGES
        for name in pattern.findall(text_of(page))
        if name not in known and not name.endswith(('.yaml', '.launch.py'))
    }
    assert not unknown, f'no parameters: {unknown}; see docs/parameters.md, or run `make docs`'


def test_the_recipe_of_limits_has_values_that_the_nodes_take():
    """Each column of docs/bringup is a set of parameters, of the types that they have."""
    section = text_of(ROOT / 'docs' / 'bringup.md').partition('## Limits: from the task')[2]
    rows = re.findall(
        r'^\| `([\w.]+)` \| (\S+) \| (\S+) \| (\S+) \| .+ \|$',
        section.partition('\n## ')[0],
        re.MULTILINE,
    )
    assert {'alert_limit_deg', 'unchecked_limit', 'degraded', 'start_checked'} <= {
        name for name, *_ in rows
    }
    settings = {each.name: each for each in (*FKM_SETTINGS, *TELEOP_SETTINGS, *CAN_SETTINGS)}
    for name, *texts in rows:
        for value in map(yaml.safe_load, texts):
            assert settings[name].check(value) == value


def section_of(page: str, heading: str) -> str:
    """Return the text below a heading of a page in docs/."""
    return text_of(ROOT / 'docs' / page).partition(f'## {heading}\n')[2].partition('\n## ')[0]


def test_every_page_is_in_the_documentation_that_rosdoc2_builds():
    listed = set(re.findall(r'^   ([\w/]+)$', text_of(ROOT / 'docs' / 'index.rst'), re.MULTILINE))
    pages = {str(page.relative_to(ROOT / 'docs').with_suffix('')) for page in PAGES[1:]}
    assert listed - {'modules'} == pages, 'docs/index.rst and the pages of docs/ differ'


def test_rosdoc2_imports_the_package_without_the_libraries_of_its_rooms(monkeypatch):
    """All but numpy are mocked; the package is found from a file below the checkout."""
    monkeypatch.setattr(sys, 'path', ['elsewhere', *sys.path])
    configuration = run_path(str(ROOT / 'docs' / 'conf.py'))
    assert sys.path[:2] == [str(ROOT), 'elsewhere']
    libraries = {
        library
        for room, names in OUTSIDE.items()
        if room not in NOT_INSTALLED
        for library in names
    }
    assert libraries - {'numpy'} <= set(configuration['MOCKED'])


# What of a message differs from one to the next: names, numbers, what the system reports.
VARIABLE = re.compile(
    r'^SENSOR |\.\.\.|socketcan can0|/measured_js|joint_3a|0x\w+|\[Errno.*|'
    r'Network is down|Transmit buffer full|\d+|[():,]'
)


@pytest.mark.parametrize(
    ('page', 'heading', 'rooms'),
    [
        ('safety.md', 'Reasons and cures', ('supervision', 'nodes', 'ros')),
        ('rig.md', "The driver's entry on `/diagnostics`", ('encoders', 'nodes', 'ros')),
    ],
)
def test_messages_of_a_page_are_those_of_the_code(page, heading, rooms):
    """The messages are in the first column of the page's table."""
    code = ''.join(
        text_of(path)
        for room in rooms
        for path in (ROOT / 'spm_haptic_master' / room).rglob('*.py')
    )
    rows = re.findall(r'^\| (`.+?) \|', section_of(page, heading), re.MULTILINE)
    assert len(rows) > 10
    words = [
        part.strip()
        for row in rows[1:]
        for span in re.findall(r'`([^`]+)`', row)
        for part in VARIABLE.split(span)
    ]
    unknown = [each for each in words if each not in code]
    assert not unknown, f'docs/{page}, "{heading}": messages that no code has: {unknown}'


def test_each_topic_and_each_reason_of_silence_is_in_its_page():
    recordings = ''.join(map(text_of, sorted((ROOT / 'test' / 'data' / 'sessions').glob('*.txt'))))
    topics = set(re.findall(r'^topic ([\w/]+)$', recordings, re.MULTILINE))
    pages = ''.join(
        text_of(ROOT / 'docs' / name) for name in ('interfaces.md', 'slave.md', 'diagnostics.md')
    )
    assert len(topics) > 20
    missing = [each for each in topics if f'{each}`' not in pages]
    assert not missing, f'docs/interfaces.md, table "Topics": no row of {missing}'
    cures = section_of('safety.md', 'Reasons and cures')
    missing = [
        each.value for each in Reason if each.value not in cures and each is not Reason.STARTING
    ]
    assert not missing, f'docs/safety.md, table "Reasons and cures": no row of {missing}'


@pytest.mark.parametrize('page', ['as it is', 'as make evidence writes it'])
def test_commands_of_the_evidence_exist(page, tmp_path):
    """Each section has the day and a command: a target, module, test or measurement."""
    if page == 'as it is':
        text = text_of(ROOT / 'docs' / 'evidence.md')
    else:
        text = Measurer(tmp_path / 'kept', run_command=str.upper).page(SECTIONS)
    _, *sections = text.split('\n## ')
    makefile = text_of(ROOT / 'Makefile')
    for section in sections:
        assert re.search(r'\b20\d\d-\d\d-\d\d\b', section), section[:40]
        found = [
            *(f'\n{each}:' in makefile for each in re.findall(r'`make ([\w-]+)', section)),
            *(
                (ROOT / f'{each.replace(".", "/")}.py').is_file()
                for each in re.findall(r'`python -m (benchmarks\.\w+)', section)
            ),
            *(
                (ROOT / each).is_file()
                for each in re.findall(r'`python -m pytest (?:-s )?(test/[\w/.]+)', section)
            ),
        ]
        assert found and all(found), section[:40]


# A test: its module, with or without folder and suffix, and its name.
TEST = re.compile(r'`([\w/]+?)(?:\.py)?::(\w+)`')


def known_tests():
    """Return the name of each test behind that of its file."""
    found = []
    for path in (ROOT / 'test').rglob('test_*.py'):
        file = path.relative_to(ROOT).with_suffix('')
        for name in re.findall(r'^def (test_\w+)', text_of(path), re.MULTILINE):
            found.append(f'/{file}::{name}')
    return found


def hazards():
    """Return the header and the rows of the table of hazards."""
    lines = section_of('safety.md', 'Hazards').splitlines()
    rows = [line.strip('|').split('|') for line in lines if line.startswith('|')]
    header, _, *rows = [[cell.strip() for cell in row] for row in rows]
    return header, rows


def test_each_hazard_has_all_of_its_cells_and_tests_alone_in_the_last():
    header, rows = hazards()
    assert header[-1] == 'held by'
    assert len(rows) >= 15
    for row in rows:
        assert len(row) == len(header), row
        assert all(row), row
        assert TEST.search(row[-1]), row
        assert not TEST.sub('', row[-1]).strip(' ,'), row


def test_each_hazard_is_held_by_tests_that_exist():
    known = known_tests()
    _, rows = hazards()
    for row in rows:
        for test in map('::'.join, TEST.findall(row[-1])):
            assert any(each.endswith(f'/{test}') for each in known), f'{row[0]}: no {test}'


def test_make_docs_names_the_files_that_it_changes():
    before = {'README.md': 'a', 'docs/refused.md': 'b', 'docs/gone.md': 'c'}
    after = {'README.md': 'a', 'docs/refused.md': 'x', 'docs/new.md': 'd'}
    assert changed(before, after) == ['docs/gone.md', 'docs/new.md', 'docs/refused.md']
    assert 'docs/parameters.md' in contents()
