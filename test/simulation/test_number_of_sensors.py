# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated rigs of five and six sensors: angles, errors, files, faults."""

from math import radians

from encoder_frames import decoder, feed, sync, T0, values
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import Geometry, inverse, matrix_from_quaternion
from spm_haptic_master.nodes.source_factory import make_source
from spm_haptic_master.simulation.fault_injection import parse_fault
from spm_haptic_master.simulation.rig import random_rig, Tolerances
from spm_haptic_master.simulation.rig_file import read_rig, rig_text
from spm_haptic_master.simulation.settings import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus

COUNT = 2.0 * np.pi / 16384
TOLERANCES = Tolerances(0.004, 0.003, 0.002, 0.001)


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('working_mode', [(1, 1, 1), (1, -1, 1)])
def test_every_source_has_the_angles_of_the_legs(sensors, working_mode):
    checked = values('sim', sensors=sensors, sim__noise_deg=0.0, sim__trajectory='sweep',
                     working_mode=working_mode, sim__tilt_max_deg=5.0)
    motion = make_motion(checked)
    source = make_source('sim', checked)
    for t in (0.0, 3.0, 11.0):
        true = inverse(matrix_from_quaternion(motion.orientation(t)), working_mode=working_mode)
        expected = [*true.theta1, true.theta3a, true.theta3b, true.theta3c][:sensors]
        np.testing.assert_allclose(motion.angles(t), expected, atol=1e-12)
        np.testing.assert_allclose(source.angles(t), expected, atol=COUNT / 2 + 1e-9)


def test_more_sensors_leave_a_random_rig_as_it_is():
    four, six = (random_rig(3, TOLERANCES, noise=0.001, sensors=count) for count in (4, 6))
    assert six.geometry == four.geometry
    assert six.sensors[:4] == four.sensors
    assert len({each.first_harmonic for each in six.sensors}) == 6


def test_the_file_of_a_rig_has_all_sensors(tmp_path):
    rig = random_rig(5, TOLERANCES, noise=0.001, sensors=6)
    path = tmp_path / 'rig.json'
    path.write_text(rig_text(rig))
    again = read_rig(path, Geometry(), 0.0, sensors=6)
    for here, there in zip(rig.sensors, again.sensors, strict=True):
        np.testing.assert_allclose(here.first_harmonic, there.first_harmonic)
    with pytest.raises(InputError, match=r"key '\w+' is .*; expected a list of 4"):
        read_rig(path, Geometry(), 0.0)


def test_faults_are_of_the_sensors_that_there_are():
    fault = parse_fault('offset:joint_3c@0=1.5', sensors=6)
    assert fault.joint == 5
    with pytest.raises(InputError, match="joint 'joint_3c'; expected one of .*joint_3b$"):
        parse_fault('offset:joint_3c@0=1.5', sensors=5)
    taker = decoder(sensors=6)
    motion = make_motion(values('sim', sensors=6, sim__noise_deg=0.0, sim__trajectory='fixed'))
    bus = SimulatedBus(tuple(each.layout for each in taker.encoders), None, motion, (fault,),
                       60.0, 1)
    bus.boot()
    answers = bus.cycle(1.0)
    for number, message in enumerate(answers):
        message.timestamp = T0 + 1e-4 * (number + 1)
    (sample,) = feed(taker, [sync(T0), *answers])
    error = np.array(sample.angles) - motion.joints(0.0)
    np.testing.assert_allclose(error, [0.0] * 5 + [radians(1.5)], atol=COUNT)
