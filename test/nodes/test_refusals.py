# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a program refuses ends it at its start, in one line that names it and what is expected."""

import json

from harness import SIM, start_command
import pytest
from refusals import CAN, Refusal, REFUSALS, REPLAY
from spm_haptic_master.benchmark.child_process import executable, parameter_arguments

pytestmark = pytest.mark.process

# Time that a busy machine may need for all programs (s).
PATIENCE = 300.0
# Values of the wrong kind or out of range: those of docs/parameters.md.
WRONG = [
    ('encoder_driver', {'source': 'serial'}, ["'source'", "'serial'", 'can, replay, sim']),
    ('encoder_driver', {'source': 7}, ["'source'", '7', 'can, replay, sim']),
    ('encoder_driver', {**SIM, 'rate': 0}, ["'rate'", '0', 'from 1 to 10000']),
    ('encoder_driver', {**SIM, 'rate': '.nan'}, ["'rate'", 'nan', 'a number']),
    ('encoder_driver', {**SIM, 'rate': 'fast'}, ["'rate'", "'fast'", 'a number']),
    ('encoder_driver', {**SIM, 'sim.trajectory': 'figure8'},
     ["'sim.trajectory'", 'fig9, perturbed, sweep, hand, tour, fixed']),
    ('encoder_driver', {**SIM, 'sim.pose_deg': [0.0, 1.0]}, ["'sim.pose_deg'", 'a list of 3']),
    ('encoder_driver', {**REPLAY, 'replay.rate': 0}, ["'replay.rate'", '0', 'from 0.01']),
    ('encoder_driver', {**CAN, 'encoders.counts_per_turn': [16384, 0, 16384, 16384]},
     ["'encoders.counts_per_turn'", '0', 'of 4']),
    ('encoder_driver', {**CAN, 'encoders.id': [385, 386, 387]},
     ["'encoders.id'", 'a list of 4']),
    ('fkm', {'solver': 'newton'}, ["'solver'", 'newton', 'estimate, theta3a, classic']),
    ('fkm', {'geometry.alpha_deg': 0.0}, ["'geometry.alpha_deg'", '0.0']),
    ('fkm', {'max_age': 0.0}, ["'max_age'", '0.0']),
    ('fkm', {'sigma_deg': [0.04, 0.04, 0.0, 0.04]}, ["'sigma_deg'", '0.0']),
    ('diagnostics', {'dexterity_rate': 0.0}, ["'dexterity_rate'", '0.0']),
    ('diagnostics', {'working_mode': [1, 1, 2]}, ["'working_mode'", '2', '1, -1']),
    ('master', {'source': 'serial'}, ["'source'", "'serial'"]),
]
CASES = [*REFUSALS, *(
    Refusal(node, parameter_arguments(parameters), list(parameters)[-1], '', '',
            ('parameter ', *words)) for node, parameters, words in WRONG)]
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
    """Exit code and stderr of every refusal; from one process, because rclpy loads slowly."""
    cases = [(each.program, [*map(str, each.arguments)], dict(each.files)) for each in CASES]
    program = start_command([executable('')[0], '-c', ONE_AFTER_THE_OTHER, json.dumps(cases)])
    assert program.wait(PATIENCE) == 0, program.stderr
    return [json.loads(line) for line in program.stdout.splitlines() if line.startswith('[')]


@pytest.mark.parametrize('index', range(len(CASES)), ids=[
    f'{each.program} {each.what} {each.refused}' for each in CASES])
def test_one_line_and_the_end(outcomes, index):
    case, (code, stderr) = CASES[index], outcomes[index]
    assert code == 1
    assert stderr.count('\n') == 1, stderr
    assert stderr.startswith(f'{case.program}: ')
    for word in case.words:
        assert word in stderr, stderr
