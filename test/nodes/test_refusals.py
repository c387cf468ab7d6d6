# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a program refuses ends it at its start, in one line that names it and what is expected."""

import json
import re

from harness import DATA, start_command
import pytest
from refusals import REFUSALS
from spm_haptic_master.benchmark.child_process import executable

pytestmark = pytest.mark.process

# The line of each refusal, in which `...` is what depends on the machine.
LINES = DATA / 'refusals.txt'
# Time that a busy machine may need for all programs (s).
PATIENCE = 300.0
# Runs one executable after the other, each in a directory with its files, and prints the exit code
# and stderr of each. What writes to the file descriptor counts, too: rcl does.
ONE_AFTER_THE_OTHER = """
import importlib, json, os, sys, tempfile
from spm_haptic_master.executables import EXECUTABLES
kept = os.dup(2)
for name, arguments, files in json.loads(sys.argv[1]):
    main = importlib.import_module(f'spm_haptic_master.{EXECUTABLES[name][0]}').main
    with tempfile.TemporaryDirectory() as directory, tempfile.TemporaryFile('w+') as stderr:
        os.chdir(directory)
        for path, content in files.items():
            with open(path, 'w') as file:
                file.write(content)
        os.dup2(stderr.fileno(), 2)
        try:
            code = main([name, *arguments])
        except SystemExit as end:
            code = end.code
        sys.stderr.flush()
        os.dup2(kept, 2)
        os.chdir('/')
        stderr.seek(0)
        print(json.dumps([code, stderr.read()]), flush=True)
"""


@pytest.fixture(scope='module')
def outcomes():
    """Exit code, stderr and line of each refusal; from one process: rclpy loads slowly."""
    cases = [(each.program, [*map(str, each.arguments)], dict(each.files)) for each in REFUSALS]
    program = start_command([executable('')[0], '-c', ONE_AFTER_THE_OTHER, json.dumps(cases)])
    assert program.wait(PATIENCE) == 0, program.stderr
    found = [json.loads(line) for line in program.stdout.splitlines() if line.startswith('[')]
    return [*zip(found, LINES.read_text(encoding='utf-8').splitlines(), strict=True)]


@pytest.mark.parametrize('index', range(len(REFUSALS)), ids=[
    f'{each.program} {each.what} {each.refused}' for each in REFUSALS])
def test_one_line_and_the_end(outcomes, index):
    (code, stderr), line = outcomes[index]
    assert code == 1
    assert re.fullmatch(re.escape(line).replace(r'\.\.\.', '.*') + '\n', stderr), \
        f'{stderr}expected: {line}'
