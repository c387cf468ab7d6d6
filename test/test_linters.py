# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Copyright, style and docstrings of every Python file, by the linters of ament."""

import pytest
from test_house import ROOT

HOLDER = 'The spm_haptic_master maintainers'
HEADER = [f'# Copyright 2026 {HOLDER}', '# SPDX-License-Identifier: Apache-2.0']
FOLDERS = ('spm_haptic_master', 'paper', 'study', 'benchmarks', 'docs', 'launch', 'test',
           'examples', 'release')
EVERYTHING = ['.', '--exclude', 'build', 'install', 'log', 'dist']
ABSENT = '{} is not installed (apt, or `make lint`)'


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
def test_copyright():
    # Its command would also refuse the licence: it knows licence texts, not SPDX identifiers.
    parser = pytest.importorskip(
        'ament_copyright.parser', reason=ABSENT.format('ament_copyright'))
    violations = [str(path.relative_to(ROOT)) for path in files()
                  if [found.name for found in parser.parse_file(str(path)).copyrights] != [HOLDER]]
    assert not violations, '\n'.join(violations)


@pytest.mark.linter
@pytest.mark.parametrize('name', [
    pytest.param('ament_flake8', marks=pytest.mark.flake8),
    pytest.param('ament_pep257', marks=pytest.mark.pep257)])
def test_style_and_docstrings(monkeypatch, capsys, name):
    linter = pytest.importorskip(f'{name}.main', reason=ABSENT.format(name))
    monkeypatch.chdir(ROOT)
    code = linter.main(argv=EVERYTHING)
    out, err = capsys.readouterr()
    assert code == 0, '\n'.join(line for line in (out + err).splitlines()
                                if not line.startswith('checking '))
