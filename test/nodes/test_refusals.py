# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a program refuses ends it at its start, in one line that names it and what is expected."""

from importlib import import_module
import re

from in_process import exit_code
import pytest
from refusals import REFUSALS
from spm_haptic_master.executables import EXECUTABLES


@pytest.mark.parametrize(
    'case',
    REFUSALS,
    ids=[f'{each.program} {each.what} {each.refused}' for each in REFUSALS],
)
def test_one_line_and_the_end(case, capfd, monkeypatch, tmp_path):
    """On the file descriptor: what rcl prints counts, too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr('spm_haptic_master.ros.duplicate_publishers.LOOK', 0.0)
    for path, content in case.files.items():
        (tmp_path / path).write_text(content)
    main = import_module(f'spm_haptic_master.{EXECUTABLES[case.program][0]}').main
    code = exit_code(main, case.program, *map(str, case.arguments))
    stderr = capfd.readouterr().err
    assert code == 1
    line = f'{case.program}: {case.message}'
    pattern = re.escape(line).replace(r'\.\.\.', '.*')
    assert re.fullmatch(pattern + '\n', stderr), f'{stderr}expected: {line}'
