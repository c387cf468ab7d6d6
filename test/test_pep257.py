# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Docstring conventions of every Python file, by ament_pep257."""

from pathlib import Path

import pytest

ament_pep257 = pytest.importorskip(
    'ament_pep257.main', reason='ament_pep257 is not installed (apt, or `make lint`)')


@pytest.mark.linter
@pytest.mark.pep257
def test_pep257(monkeypatch, capsys):
    monkeypatch.chdir(Path(__file__).resolve().parents[1])
    rc = ament_pep257.main(argv=['.', '--exclude', 'build', 'install', 'log', 'dist'])
    out, err = capsys.readouterr()
    lines = [line for line in (out + err).splitlines() if not line.startswith('checking ')]
    assert rc == 0, 'Found docstring errors or warnings:\n' + '\n'.join(lines)
