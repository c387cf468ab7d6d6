# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""README and docs: links resolve, generated pages are current, quoted names exist."""

from pathlib import Path
import re
import sys

import pytest

from spm_haptic_master.executables import EXECUTABLES

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]
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


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_resolve(page):
    broken = []
    for link in LINK.findall(CODE_BLOCK.sub('', text_of(page))):
        if link.startswith(('http://', 'https://')):
            continue
        path, _, anchor = link.partition('#')
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken


def test_every_page_is_in_the_index():
    index = ROOT / 'docs' / 'README.md'
    named = {(index.parent / link.partition('#')[0]).resolve()
             for link in LINK.findall(text_of(index))}
    assert {page for page in PAGES[1:] if page != index} <= named


def test_readme_is_short():
    assert len(text_of(ROOT / 'README.md').splitlines()) <= README_LINES


def test_readme_names_the_executables():
    rows = re.findall(r'^\| `(\w+)` \| (.+) \|$',
                      text_of(ROOT / 'README.md').partition('## Programs')[2], re.MULTILINE)
    assert dict(rows) == {name: what for name, (_, what) in EXECUTABLES.items()}


def test_pictures_are_small():
    large = [path.name for path in (ROOT / 'docs' / 'figures').iterdir()
             if path.suffix in {'.png', '.svg'} and path.stat().st_size > 200_000]
    assert not large


def test_parameters_page_is_current(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    sys.modules.pop('docs', None)
    from docs.generate_parameters import OUTPUT, page

    assert OUTPUT.read_text(encoding='utf-8') == page(), 'run `make docs`'


def test_parameters_named_in_the_pages_exist():
    """A code span that begins with a prefix of the parameters names one of them."""
    known = set(re.findall(r'^\| `([\w.]+)` \|', text_of(ROOT / 'docs' / 'parameters.md'),
                           re.MULTILINE))
    pattern = re.compile(r'`((?:can|encoders|replay|sim|geometry|realtime)\.[a-z]\w*)')
    unknown = {f'{page.name}: {name}' for page in PAGES for name in pattern.findall(text_of(page))
               if name not in known and not name.endswith('.yaml')}
    assert not unknown


def test_reasons_of_silence_are_those_of_the_code():
    """Each reason in the table of docs/safety.md is a text of supervision or fkm."""
    table = text_of(ROOT / 'docs' / 'safety.md').partition('## Reasons and cures')[2]
    rows = re.findall(r'^\| (`.+?) \|', table.partition('\n## ')[0], re.MULTILINE)
    reasons = [reason.removeprefix('SENSOR ') for row in rows[1:]
               for reason in re.findall(r'`([^`]+)`', row)]
    assert len(reasons) > 10
    code = ''.join(path.read_text(encoding='utf-8')
                   for room in ('supervision', 'nodes')
                   for path in (ROOT / 'spm_haptic_master' / room).glob('*.py'))
    assert [reason for reason in reasons if reason not in code] == []
