# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Copyright of every Python file; style and docstrings by the linters of ament."""

from importlib import import_module
from importlib.util import find_spec

import pytest
from test_house import ROOT

HEADER = (
    '# Copyright 2026 The spm_haptic_master maintainers\n# SPDX-License-Identifier: Apache-2.0\n'
)
FOLDERS = (
    'spm_haptic_master',
    'paper',
    'study',
    'benchmarks',
    'docs',
    'launch',
    'test',
    'examples',
    'release',
)


def files():
    """Return every Python file of the project."""
    return [
        ROOT / 'setup.py',
        *(path for folder in FOLDERS for path in sorted((ROOT / folder).rglob('*.py'))),
    ]


def test_every_file_begins_with_copyright_and_licence():
    violations = [
        str(path.relative_to(ROOT)) for path in files() if not path.read_text().startswith(HEADER)
    ]
    assert not violations, '\n'.join(violations)


@pytest.mark.linter
@pytest.mark.parametrize(
    'name',
    [
        pytest.param('ament_flake8', marks=pytest.mark.flake8),
        pytest.param('ament_pep257', marks=pytest.mark.pep257),
    ],
)
def test_style_and_docstrings(monkeypatch, capsys, name):
    # Where it is installed without what it needs, that is an error.
    if find_spec(name) is None:
        pytest.skip(f'{name} is not installed (apt, or `make lint`)')
    linter = import_module(f'{name}.main')
    monkeypatch.chdir(ROOT)
    config = ['--config', 'test/ament_flake8.ini'] if name == 'ament_flake8' else []
    code = linter.main(argv=['.', '--exclude', 'build', 'install', 'log', 'dist', *config])
    out, err = capsys.readouterr()
    assert code == 0, '\n'.join(
        line for line in (out + err).splitlines() if not line.startswith('checking ')
    )
