# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig that is not perfect on a CAN bus: its counts, and its truth beside them."""

from math import pi
import time

import can
from encoder_frames import decoder, LAYOUTS, values
from harness import DATA, SIMULATED
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.encoders import canopen
from spm_haptic_master.kinematics import Geometry, inverse, matrix_from_quaternion
from spm_haptic_master.simulation.bus_runner import BusRunner
from spm_haptic_master.simulation.rig_file import read_rig
from spm_haptic_master.simulation.settings import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.validation import recordings

RIG = DATA / 'rig' / 'rig.json'
COUNT = 2.0 * pi / 16384
PATIENCE = 60.0


def expected(rig, quaternions):
    """Return what the sensors of a rig read without noise, rad, (n, 4)."""
    joints = inverse(matrix_from_quaternion(quaternions), rig.geometry)
    return np.array([
        [sensor.with_harmonics(angle) for sensor, angle in zip(rig.sensors, row, strict=True)]
        for row in np.column_stack([joints.theta1, joints.theta3a])])


def test_frames_are_those_of_the_rig_with_the_configured_zero_counts():
    truth, samples, taker = [], [], decoder()
    motion = make_motion(values('sim', sim__rig_file=str(RIG), sim__noise_deg=0.0,
                                sim__trajectory='sweep'))
    with can.Bus(interface='virtual', channel='imperfect') as bus, \
            can.Bus(interface='virtual', channel='imperfect') as master:
        runner = BusRunner(bus, SimulatedBus(LAYOUTS, None, motion, (), 60.0, 1), 0x80, None,
                           record=lambda stamp, q: truth.append((stamp, q)))
        for _ in range(100):
            sync = canopen.frame(0x80)
            sync.timestamp = time.time()
            master.send(sync)
            runner.step()
            answers = [*iter(lambda: master.recv(0.0), None)]
            for message in answers:
                # As on a bus: a machine that is busy would take the answers for late ones.
                message.timestamp = sync.timestamp + 1e-4
            for message in (sync, *answers):
                if (sample := taker.feed(message)) is not None:
                    samples.append(sample)
            time.sleep(0.002)
    assert len(samples) == len(truth) == runner.cycles == 100
    error = np.array([sample.angles for sample in samples]) \
        - expected(motion.rig, [q for _, q in truth])
    assert np.abs(error).max() <= COUNT / 2 + 1e-9
    late = [stamp - sample.stamp for (stamp, _), sample in zip(truth, samples, strict=True)]
    assert 0 <= np.median(late) < 1_000_000


@pytest.mark.process
def test_sim_bus_writes_the_truth_beside_a_recording(start, bus_channel, tmp_path):
    bus = ('-p', 'can.interface:=udp_multicast', '-p', f'can.channel:={bus_channel}',
           '-p', 'rate:=100.0')
    program = start('sim_bus', *bus, '-p', f'sim.rig_file:={RIG}', '--ground-truth', tmp_path)
    assert wait_until(lambda: 'four encoders' in program.stdout, PATIENCE), program.stderr
    recorder = start('recorder', '-p', f'directory:={tmp_path}')
    driver = start('encoder_driver', *bus, '-p', 'source:=can', '-p', 'can.sync:=produce',
                   '-p', 'can.timeout:=0.5', '-p', 'encoders.window:=0.02', *SIMULATED)
    path = tmp_path / 'measured_js.csv'
    assert wait_until(lambda: path.exists() and path.stat().st_size > 20_000, PATIENCE), \
        driver.stderr + recorder.stderr
    for each in (driver, recorder, program):
        each.stop()
    assert all(line.startswith('[INFO] ') for line in recorder.stderr.splitlines())
    truth = recordings.read_orientation(tmp_path / 'ground_truth.csv', '')
    joints = recordings.read_joints(path, '')
    # One SYNC has two times: where it was sent, and where it was received.
    times = joints.time[(joints.time > truth.time[0]) & (joints.time < truth.time[-1] - 0.01)]
    nearest = np.abs(truth.time[:, None] - times).argmin(0)
    assert len(times) > 200
    readings = joints.values[np.isin(joints.time, times)]
    rig = read_rig(tmp_path / 'rig.json', Geometry(), 0.0)
    assert np.allclose(rig.geometry.alphas, read_rig(RIG, Geometry(), 0.0).geometry.alphas)
    noise = np.hypot(0.04, np.degrees(COUNT) / 12**0.5)
    error = np.degrees(readings - expected(rig, truth.values[nearest]))
    assert error.std(0) == pytest.approx([noise] * 4, rel=0.25)
    assert np.abs(error.mean(0)).max() < 0.02
    drawn = inverse(matrix_from_quaternion(truth.values[nearest]))
    off = np.degrees(readings - np.column_stack([drawn.theta1, drawn.theta3a]))
    assert np.abs(off.mean(0)).max() > 0.2


@pytest.mark.process
@pytest.mark.parametrize(('directory', 'words'), [
    ('', 'rig.json: already exists'), ('file', 'cannot be written')])
def test_a_truth_that_cannot_be_written_ends_in_one_line(start, directory, words, tmp_path):
    for name in ('rig.json', 'file'):
        (tmp_path / name).write_text('precious')
    program = start('sim_bus', '-p', 'can.interface:=virtual', '--seconds', '1',
                    '--ground-truth', tmp_path / directory)
    assert program.wait(PATIENCE) == 1
    assert program.stderr.startswith('sim_bus: ') and words in program.stderr
    assert program.stderr.count('\n') == 1
    assert (tmp_path / 'rig.json').read_text() == 'precious'
