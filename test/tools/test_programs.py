# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command-line programs as an engineer runs them, on a live bus between processes."""

import os
import re
import signal
import subprocess
import sys
import time

from disturbance import BESIDE_OTHERS, Disturbance
from harness import ROOT, SIM, SIMULATED, start_command, start_program
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import executable, wait_until
from spm_haptic_master.kinematics import inverse, matrix_from_zxz
from spm_haptic_master.parameters.resolver import read_parameters

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 120.0
# What a recorder logs when it begins.
BEGUN = r'\[INFO\] \[[\d.]+\] \[recorder\]: writes into .*, until Ctrl-C\n'
CALIBRATED = ('-p', 'encoders.zero_count:=[100, 200, 8000, 9000]',
              '-p', 'encoders.direction:=[1, 1, 1, -1]')


def bus(channel):
    return '-p', 'can.interface:=udp_multicast', '-p', f'can.channel:={channel}'


def run(name, *args):
    """Return exit code, stdout and stderr of a program that ends by itself."""
    program = start_program(name, *map(str, args))
    return program.wait(PATIENCE), program.stdout, program.stderr


@pytest.fixture
def encoders(start, bus_channel):
    """Start a simulated bus and wait until it is up."""
    def begin(*options):
        program = start('sim_bus', *bus(bus_channel), *map(str, options))
        assert wait_until(lambda: 'four encoders' in program.stdout, PATIENCE), program.stderr
        return program
    return begin


def test_the_tools_need_no_ros():
    """Neither is rclpy imported, nor anything that imports it."""
    code = ('import sys\nfor name in ("can_scan", "calibrate", "sim_bus"):\n'
            '    __import__(f"spm_haptic_master.tools.{name}")\n'
            'print([name for name in sys.modules if name.split(".")[0] in ("rclpy", "sensor_msgs")'
            ' or name.startswith("spm_haptic_master.nodes")])')
    program = start_command([sys.executable, '-c', code])
    assert program.wait(PATIENCE) == 0, program.stderr
    assert program.stdout.strip() == '[]'


@pytest.mark.parametrize('master', [True, False], ids=['master', 'no master'])
def test_the_lines_of_a_scan_are_a_rig_file(encoders, start, observer, bus_channel, tmp_path,
                                            master):
    """Odd node ids and another rate: scanned, pasted, and all programs run on the lines."""
    odd = ('-p', 'encoders.node_id:=[44, 3, 90, 17]',
           '-p', 'encoders.id:=[0x1AC, 0x183, 0x1DA, 0x191]')
    encoders('-p', 'rate:=50.0', *odd, *(['--sync'] if master else []))
    with Disturbance(BESIDE_OTHERS) as machine:
        code, out, err = run('can_scan', *bus(bus_channel), '--start', '--seconds', 2,
                             *([] if master else ['-p', 'rate:=50.0']))
    assert code == 1, out  # the defaults are nodes 1 to 4
    assert ('no SYNC on the bus' in err) != master
    path = tmp_path / 'rig.yaml'
    path.write_text(out.partition('lines for rig.yaml')[2].partition('\n')[2])
    found = read_parameters(path)
    assert found['encoders.node_id'] == [3, 17, 44, 90]
    machine.expect(found['rate'] == 50.0, found['rate'])
    assert found['can.sync'] == ('consume' if master else 'produce')

    code, out, err = run('can_scan', '--params-file', path, '--start', '--seconds', 2)
    assert code == 0, out + err
    code, out, err = run('can_setup', '--params-file', path)
    assert 'joint_1a, node 3: ' in out and 'joint_3a, node 90: ' in out, out + err
    samples = observer.collect(JointState, 'measured_js')
    driver = start('encoder_driver', '--params-file', str(path), *SIMULATED, '-p',
                   'can.timeout:=0.5')
    assert observer.spin_until(lambda: len(samples) > 20, PATIENCE), driver.stderr


def test_a_scan_reads_a_pipe_once(bus_channel, tmp_path):
    """A file from process substitution can be read once: the second time hung."""
    path = tmp_path / 'pipe'
    os.mkfifo(path)
    program = start_program('can_scan', '--params-file', str(path), '--passive',
                            '--seconds', '0.1')
    path.write_text('/**: {ros__parameters: {can.interface: udp_multicast, '
                    f"can.channel: '{bus_channel}'}}}}\n")
    assert program.wait(PATIENCE) == 1
    assert 'not as configured' in program.stdout, program.stderr


def test_from_two_poses_of_a_jig_to_angles(encoders, start, observer, bus_channel, tmp_path):
    """Calibrate asks for one pose after the other; Enter confirms each; the driver runs on it."""
    path = tmp_path / 'rig.yaml'
    fixed = ('-p', 'sim.trajectory:=fixed', '-p', 'rate:=250.0', *CALIBRATED)
    poses = [(135.0, 54.7356, 0.0), (130.0, 50.0, 10.0)]
    command = executable('calibrate', *bus(bus_channel), '-p', 'rate:=250.0', '-o', str(path),
                         '--seconds', '1.2', '--jig-error', '0.1',
                         *(str(word) for pose in poses for word in ('--pose', *pose)))
    lines = []
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, cwd=ROOT) as program:
        held = None
        for number, pose in enumerate(poses, start=1):
            # It asks for a pose once it has read the one before.
            while f'pose {number} of 2: hold the device at psi theta phi' \
                    not in (line := program.stderr.readline()):
                lines.append(line)
                assert line, lines
            if held is not None:
                held.stop(signal.SIGINT)
            held = encoders('--sync', '-p', f'sim.pose_deg:={list(pose)}', *fixed)
            program.stdin.write('\n')
            program.stdin.flush()
        out, err = program.communicate(timeout=PATIENCE)
    held.stop(signal.SIGINT)
    assert program.returncode == 0, err
    assert out.count('(verified)') == 4
    written = read_parameters(path)
    assert written['encoders.zero_count'] == pytest.approx([100, 200, 8000, 9000], abs=2)
    assert written['encoders.direction'] == [1, 1, 1, -1]
    assert written['sigma_deg'] == pytest.approx([0.041] * 4, rel=0.3)
    assert all(0.05 < each < 0.5 for each in written['bias_deg'])
    # At another pose every angle is the simulation's own.
    encoders('--sync', '-p', 'sim.pose_deg:=[140.0, 60.0, 20.0]', *fixed,
             '-p', 'sim.noise_deg:=0.0')
    samples = observer.collect(JointState, 'measured_js')
    driver = start('encoder_driver', '--params-file', str(path), '-p', 'rate:=250.0',
                   '-p', 'source:=can', *bus(bus_channel))
    assert observer.spin_until(lambda: len(samples) > 20, PATIENCE), driver.stderr
    joints = inverse(matrix_from_zxz(*np.radians([140.0, 60.0, 20.0])))
    true = [*map(float, joints.theta1), float(joints.theta3a)]
    assert samples[-1][1].position.tolist() == pytest.approx(true, abs=2e-3)


def test_sim_bus_ends_well(encoders):
    program = encoders('--sync', '--seconds', 0.5)
    assert program.wait(PATIENCE) == 0
    assert re.search(r'\d+ cycles answered, \d+ deadlines missed', program.stdout)
    assert program.stderr == ''
    assert encoders().stop(signal.SIGTERM) == 130


def test_a_long_log_without_sets_ends_at_a_signal(start, tmp_path):
    """At once, without being read to its end, which takes a minute and more."""
    path = tmp_path / 'a.log'
    with open(path, 'w', encoding='utf-8') as file:
        file.writelines(f'({0.001 * step:.6f}) can0 701#05\n' for step in range(3_000_000))
    program = start('encoder_driver', '-p', 'source:=replay', '-p', f'replay.path:={path}',
                    *SIMULATED)
    # Once it reads, its entry names the frames without a set.
    assert wait_until(lambda: re.search(r'no set of four encoders in \d+ frames',
                                        program.stderr), PATIENCE), program.stderr
    with Disturbance(BESIDE_OTHERS) as machine:
        began = time.monotonic()
        assert program.stop(signal.SIGINT, PATIENCE) == 0, program.stderr[-600:]
        took = time.monotonic() - began
    machine.expect(took < 9.0, took)


def test_a_recording_on_a_full_disk_ends_in_one_line(start, tmp_path):
    """As on a full disk, files cannot grow any more: not when written, nor when closed."""
    command = executable('recorder', parameters={'directory': str(tmp_path)})
    recorder = start_command(['bash', '-c', 'ulimit -f 128; exec "$@"', 'bash', *command])
    try:
        start('master', parameters=SIM)
        assert recorder.wait(PATIENCE) == 1
        # Without figures of a table that is not as it says.
        assert re.fullmatch(BEGUN + rf'recorder: {tmp_path}/\w+.csv: cannot be written: '
                            r'\[Errno 27\] File too large\n', recorder.stderr), recorder.stderr
    finally:
        recorder.kill()
