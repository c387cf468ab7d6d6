# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The file in which a live `calibrate --motion` keeps the motion, however that ends."""

from contextlib import closing
import re
import signal

import pytest
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.calibration.recording import raw_counts, read_log
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.simulation.source_factory import make_replay
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.calibrate import main

pytestmark = pytest.mark.process

# Longest time for a program on a busy machine (s), and sets that make a file worth keeping.
PATIENCE, SETS = 60.0, 150
RATE = 100.0


@pytest.fixture
def calibrating(start, bus_channel, tmp_path):
    """Start simulated encoders at rest and a calibration from them, into a directory."""
    bus = {'can.interface': 'udp_multicast', 'can.channel': bus_channel, 'rate': RATE}
    start('sim_bus', parameters={**bus, 'sim.trajectory': 'fixed'})
    arguments = [part for name, value in (bus | {'can.sync': 'produce'}).items()
                 for part in ('-p', f'{name}:={value}')]
    return lambda: start('calibrate', '--motion', '-o', str(tmp_path / 'c.yaml'), *arguments)


def sets(text):
    """Return how many sets the progress of a calibration reports."""
    found = re.findall(r', (\d+) sets', text)
    return int(found[-1]) if found else 0


def recorded(path):
    """Return the number of sets in a file that was kept."""
    values = command_line.checked(
        raw_counts(4) | {'encoders.direction_verified': (True,) * 4, 'rate': RATE,
                         'replay.path': str(path)}, SOURCE_SETTINGS['replay'], 'replay')
    with closing(make_replay(values)) as source:
        (stamps, _), _ = read_log(source)
        return len(stamps)


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT])
def test_the_motion_can_be_used_again_however_the_program_ends(
        calibrating, tmp_path, capsys, number):
    (tmp_path / 'c_motion.log').write_text('mine')
    program = calibrating()
    assert wait_until(lambda: sets(program.stderr) > SETS, PATIENCE), program.stderr
    before = sets(program.stderr)
    program.stop(number, PATIENCE)
    # An earlier motion is not overwritten.
    path = tmp_path / 'c_motion_2.log'
    assert (tmp_path / 'c_motion.log').read_text() == 'mine'
    assert f'the motion is kept in {path}; from it again: -p source:=replay -p ' \
        f'replay.path:={path}' in program.stderr
    # Refused as too short or at rest, after Ctrl-C; a kill loses the last tenth of a second.
    assert not (tmp_path / 'c.yaml').exists() and 'Traceback' not in program.stderr
    assert recorded(path) >= before - 0.3 * RATE
    # `calibrate` takes it, and says of this motion what it would have said of the live one.
    assert main(['calibrate', '--motion', '-o', str(tmp_path / 'd.yaml'), '-p', 'source:=replay',
                 '-p', f'replay.path:={path}', '-p', f'rate:={RATE}']) == 1
    # Of sets that come slowly on a busy machine there are too few.
    refused = re.compile(r'^calibrate: (the motion lasts|joint_1a moved by|\d+ sets of four) .*',
                         re.MULTILINE)
    assert refused.search(capsys.readouterr().err)
    assert number == signal.SIGKILL or refused.search(program.stderr), program.stderr
