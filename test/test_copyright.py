# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Copyright and licence in the first two lines of every Python file."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HOLDER = 'The spm_haptic_master maintainers'
HEADER = [f'# Copyright 2026 {HOLDER}', '# SPDX-License-Identifier: Apache-2.0']
FOLDERS = ('spm_haptic_master', 'paper', 'study', 'benchmarks', 'docs', 'launch', 'test',
           'examples', 'release')


def files():
    """Return every Python file of the project."""
    return [ROOT / 'setup.py',
            *(path for folder in FOLDERS for path in sorted((ROOT / folder).rglob('*.py')))]


def test_every_file_begins_with_copyright_and_licence():
    violations = [str(path.relative_to(ROOT)) for path in files()
                  if path.read_text().splitlines()[:2] != HEADER]
    assert not violations, '\n'.join(violations)


@pytest.mark.copyright
@pytest.mark.linter
def test_ament_copyright_finds_the_holder():
    # Its command would also refuse the licence: it knows licence texts, not SPDX identifiers.
    parser = pytest.importorskip(
        'ament_copyright.parser', reason='ament_copyright is not installed (apt; not on PyPI)')
    violations = [str(path.relative_to(ROOT)) for path in files()
                  if [found.name for found in parser.parse_file(str(path)).copyrights] != [HOLDER]]
    assert not violations, '\n'.join(violations)
