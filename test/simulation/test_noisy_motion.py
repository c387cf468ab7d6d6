# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the sensors of a simulated rig read, beside the inverse model of the true orientation."""

from math import pi, radians

from encoder_frames import values
import numpy as np
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import Geometry, inverse, matrix_from_quaternion
from spm_haptic_master.simulation.noisy_motion import make_motion, NoisyMotion
from spm_haptic_master.simulation.rig import Rig, SensorErrors
from spm_haptic_master.simulation.source_factory import make_source
from spm_haptic_master.simulation.trajectories import sweep

COUNT = 2.0 * pi / 16384
TIMES = np.arange(0.0, 30.0, 0.01)


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('working_mode', [(1, 1, 1), (1, -1, 1)])
def test_every_source_has_the_angles_of_the_legs(sensors, working_mode):
    checked = values(
        'sim',
        sensors=sensors,
        sim__noise_deg=0.0,
        sim__trajectory='sweep',
        working_mode=working_mode,
        sim__tilt_max_deg=5.0,
    )
    motion = make_motion(checked)
    source = make_source('sim', checked)
    for t in (0.0, 3.0, 11.0):
        true = inverse(matrix_from_quaternion(motion.orientation(t)), working_mode=working_mode)
        expected = [*true.theta1, true.theta3a, true.theta3b, true.theta3c][:sensors]
        np.testing.assert_allclose(motion.angles(t), expected, atol=1e-12)
        np.testing.assert_allclose(source.angles(t), expected, atol=COUNT / 2 + 1e-9)


def test_each_sensor_has_its_own_errors():
    play = radians(0.3)
    motion = NoisyMotion(
        sweep(radians(20.0)),
        Rig(
            Geometry(),
            (
                SensorErrors((0.01, -0.02), (0.003, 0.004)),
                SensorErrors(play=play),
                SensorErrors(delay=0.003, noise=0.0001),
                SensorErrors(resolution=0.005),
            ),
        ),
        1,
        (1, 1, 1),
    )
    found = np.array([motion.angles(t) for t in TIMES])
    true = np.array([motion.joints(t) for t in TIMES])
    a = true[:, 0]
    error = found - true
    np.testing.assert_allclose(
        error[:, 0],
        0.01 * np.cos(a) - 0.02 * np.sin(a) + 0.003 * np.cos(2.0 * a) + 0.004 * np.sin(2.0 * a),
        atol=1e-12,
    )
    # The encoder trails its joint by half the play at most; at a reversal it rests.
    trailing = [true[0, 1]]
    for joint in true[1:, 1]:
        trailing.append(min(max(trailing[-1], joint - 0.5 * play), joint + 0.5 * play))
    np.testing.assert_allclose(found[:, 1], trailing, atol=1e-12)
    late = error[:, 2] + 0.003 * np.gradient(true[:, 2], TIMES)
    assert late.std() == pytest.approx(0.0001, rel=0.1)
    steps = found[:, 3] / 0.005
    assert np.abs(steps - steps.round()).max() < 1e-9
    assert np.abs(error[:, 3]).max() == pytest.approx(0.0025, rel=0.02)


def test_play_follows_across_half_a_turn(monkeypatch):
    motion = NoisyMotion(
        sweep(0.0),
        Rig(Geometry(), (SensorErrors(play=0.01),)),
        1,
        (1, 1, 1),
    )
    monkeypatch.setattr(motion, 'joints', lambda t: (t,))
    found = [motion.angles(angle)[0] for angle in (pi - 0.001, -pi + 0.003, -pi + 0.02)]
    assert found == pytest.approx([pi - 0.001, -pi - 0.001, -pi + 0.015])


def test_a_motion_out_of_reach_is_refused(tmp_path):
    with pytest.raises(SettingError, match="'sim.pose_deg' .* expected a pose within reach"):
        make_motion(values('sim', sim__trajectory='fixed', sim__pose_deg=(0.0, 0.0, 0.0)))
    path = tmp_path / 'rig.json'
    path.write_text('{"alpha_deg": [39.3, 39.3, 31], "beta_deg": [34.1, 34.1, 26]}')
    make_motion(values('sim', sim__rig_file=str(path)))
    with pytest.raises(
        SettingError,
        match="'sim.trajectory' is 'sweep'; expected a motion within "
        'reach of the simulated mechanism',
    ):
        make_motion(values('sim', sim__trajectory='sweep', sim__rig_file=str(path)))
