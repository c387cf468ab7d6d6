# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Code style of every Python file, by ament_flake8 with its own configuration."""

from pathlib import Path

import pytest

ament_flake8 = pytest.importorskip(
    'ament_flake8.main', reason='ament_flake8 is not installed (apt, or `make lint`)')


@pytest.mark.flake8
@pytest.mark.linter
def test_flake8(monkeypatch):
    monkeypatch.chdir(Path(__file__).resolve().parents[1])
    rc, errors = ament_flake8.main_with_errors(
        argv=['.', '--exclude', 'build', 'install', 'log', 'dist'])
    assert rc == 0, f'Found {len(errors)} code style errors or warnings:\n' + '\n'.join(errors)
