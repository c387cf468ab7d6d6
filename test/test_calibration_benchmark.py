# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the calibration can be interrupted, and repeats no rig."""

from benchmarks import calibration
import pytest

pytestmark = pytest.mark.slow


def test_a_rig_is_a_line_of_the_results_and_is_not_repeated(tmp_path, monkeypatch, capsys):
    results = tmp_path / 'results.jsonl'
    monkeypatch.setattr('sys.argv', ['calibration', '--condition', '9', '--rigs', '1',
                                     '--workers', '1', '--results', str(results)])
    assert calibration.main() == 0
    first = capsys.readouterr()
    assert results.read_text().splitlines() == first.err.splitlines()
    assert first.out.splitlines()[-1].startswith('| poor: 15 s | 1 | 1 | 0 | 0 | 0.')
    assert calibration.main() == 0
    assert capsys.readouterr() == (first.out, '')
