# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Copyright and licence header of every source file, by ament_copyright."""

from pathlib import Path

import pytest

ament_copyright = pytest.importorskip(
    'ament_copyright.main', reason='ament_copyright is not installed (apt; not on PyPI)')


@pytest.mark.copyright
@pytest.mark.linter
def test_copyright(monkeypatch, capsys):
    monkeypatch.chdir(Path(__file__).resolve().parents[1])
    rc = ament_copyright.main(argv=['.', '--exclude', 'build', 'install', 'log', 'dist', '.venv'])
    out, err = capsys.readouterr()
    assert rc == 0, f'Found copyright errors:\n{out}{err}'
