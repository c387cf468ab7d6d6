# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of rigs of which nothing is known: what comes out, its file, and what is refused."""

from dataclasses import replace
from math import degrees, pi, radians, tau

from free_motions import calibrated, SHORT
from mechanism import turn
import numpy as np
import pytest
from rclpy.parameter import parameter_dict_from_yaml_file
from simulated_hand import deviations_of, hand_motion, joint_angles, readings
from spm_haptic_master.calibration.calibration_file import write_text
from spm_haptic_master.calibration.motion.error_bound import WORKSPACE
from spm_haptic_master.calibration.motion.file import motion_text, Origin, Verdict, zero_counts
from spm_haptic_master.calibration.motion.free_motion import calibrate_motion, Guide
from spm_haptic_master.calibration.motion.mechanism_parameters import Layout
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.calibration.motion.outside_reference import mounted
from spm_haptic_master.encoders.decoder_factory import make_harmonics
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import Geometry, matrix_from_zxz
from spm_haptic_master.parameters.files import read_sections
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.ros.resolver import read_parameters
from spm_haptic_master.ros.source_factory import MECHANISM_SETTINGS, SOURCE_SETTINGS
from spm_haptic_master.simulation.rig import random_rig
from spm_haptic_master.simulation.rig import Tolerances as Deviations
from spm_haptic_master.tools import command_line
from spm_haptic_master.validation.alignment import constant_frames, rotation_vectors
import yaml

pytestmark = pytest.mark.slow

RIG = random_rig(12, Deviations(radians(0.3), radians(0.3), radians(0.12), radians(0.015)))
SEED = 41
ORIGIN = Origin('2026-01-02T03:04:05+00:00', 'motion.log', 'ab12', '1.2.3', (16384,) * 4,
                {'can.channel': 'can1', 'source': 'can', 'encoders.id': (1, 2, 3, 4)})
VERDICT = Verdict(0.5, 0.9987, 0.04, 0.031, WORKSPACE)


@pytest.fixture(scope='module')
def motion():
    """Return stamps, raw readings, true directions and zeros of a motion."""
    return readings(RIG, SHORT, SEED)


@pytest.fixture(scope='module')
def calibration(motion):
    """Return the calibration from it."""
    stamps, raw, _, _ = motion
    return calibrate_motion(Layout(4), stamps, raw)


def exact(seed, count=200):
    """Return orientations of another motion, and readings without noise by their directions."""
    poses = hand_motion(RIG, replace(SHORT, seconds=10.0), seed)
    poses = poses[::len(poses) // count]
    angles = joint_angles(poses, RIG)
    return poses, angles + deviations_of(RIG, angles)


def test_directions_and_zeros_are_found(calibration, motion):
    _, _, direction, zeros = motion
    assert calibration.direction == tuple(direction)
    off = np.angle(np.exp(1j * (calibration.vector[:4] - zeros)))
    assert (np.abs(off) < 4.0 * calibration.deviations[:4]).all()


def test_orientations_of_another_motion_are_right(calibration, motion):
    poses, read = exact(77)
    model = MotionModel(calibration.layout, calibration.noise)
    found = model.orientations(read + motion[3], calibration.vector)
    base, body = constant_frames(poses, found, False)
    errors = np.linalg.norm(rotation_vectors(
        base @ found @ body @ poses.swapaxes(1, 2)), axis=1)
    rms = degrees(float(np.sqrt(np.mean(errors ** 2))))
    print(f'{rms:.4f} deg rms, predicted {degrees(calibration.error):.4f}')
    assert rms < 3.0 * degrees(calibration.error) and rms < 0.1
    before = model.orientations(read + motion[3], np.concatenate(
        [calibration.vector[:4], np.zeros(calibration.layout.count - 4)]))
    base, body = constant_frames(poses, before, False)
    assert rms < 0.3 * degrees(float(np.sqrt(np.mean(np.sum(rotation_vectors(
        base @ before @ body @ poses.swapaxes(1, 2)) ** 2, axis=1)))))


def test_noise_and_bias_are_those_of_the_sensors(calibration):
    assert np.allclose(np.degrees(calibration.noise), 0.0405, rtol=0.05)
    assert (calibration.bias > 0.0).all() and (calibration.bias < radians(0.6)).all()
    assert degrees(float(np.sqrt(np.nanmean(calibration.parity ** 2)))) < 0.05
    assert np.nanstd(calibration.parity_before) > 2.0 * np.nanstd(calibration.parity)


def test_the_same_motion_gives_the_same_calibration(calibration, motion):
    again = calibrate_motion(Layout(4), *motion[:2])
    assert np.array_equal(again.vector, calibration.vector)
    assert np.array_equal(again.covariance, calibration.covariance)


def test_directions_that_are_given_are_verified(motion):
    stamps, raw, direction, _ = motion
    wrong = list(direction)
    wrong[2] = -wrong[2]
    with pytest.raises(CalibrationError, match=(
            rf'^joint_1c turns with direction \{direction[2]:+d}, encoders.direction has '
            rf'\{-direction[2]:+d}$')):
        calibrate_motion(Layout(4), stamps, raw, wrong)


def test_two_encoders_that_are_swapped_are_named(motion):
    stamps, raw, _, _ = motion
    swapped = raw[:, [0, 2, 1, 3]]
    with pytest.raises(CalibrationError, match='^joint_1b and joint_1c are swapped: '):
        calibrate_motion(Layout(4), stamps, swapped)


def test_a_motion_that_hardly_moves_is_refused_with_what_is_missing(motion):
    small = replace(SHORT, tilt=1.5, turn_from=44.0, turn_to=48.0)
    stamps, raw, _, _ = readings(RIG, small, SEED)
    with pytest.raises(CalibrationError, match='tilt the handle|turn the handle'):
        calibrate_motion(Layout(4), stamps, raw)


def test_readings_of_another_mechanism_are_refused(motion):
    stamps, raw, _, _ = motion
    torn = raw.copy()
    # One encoder turns with another shaft.
    torn[:, 1] = np.roll(raw[:, 1], 5000)
    with pytest.raises(CalibrationError, match='no zeros and directions of the encoders explain|'
                       'the motion does not determine the zeros: many'):
        calibrate_motion(Layout(4), stamps, torn)


def test_an_encoder_that_slips_during_the_motion_is_named(motion):
    stamps, raw, direction, _ = motion
    slipped = raw.copy()
    slipped[len(raw) // 2:, 1] += direction[1] * radians(0.4)
    with pytest.raises(CalibrationError, match='^joint_1b slipped by .* during the motion'):
        calibrate_motion(Layout(4), stamps, slipped)


def test_what_is_far_from_the_drawing_is_named(calibration, motion):
    assert not calibration.unusual
    stamps, raw, _, _ = motion
    drawn = Geometry(radians(41.5), radians(34.1), radians(18.2))
    found = calibrate_motion(Layout(4, drawn), stamps, raw)
    assert any(name.startswith('proximal link') for name in found.unusual)


def test_the_file_is_what_was_found(calibration, tmp_path):
    path = tmp_path / 'calibration.yaml'
    write_text(path, motion_text(calibration, ORIGIN, VERDICT))
    values = read_parameters(path)
    geometry = geometry_from(command_line.checked(
        {name: value for name, value in values.items() if name.startswith('geometry.')},
        MECHANISM_SETTINGS))
    expected = calibration.layout.geometry(calibration.vector)
    assert np.allclose(geometry.base_axes, expected.base_axes, atol=1e-9)
    assert np.allclose(geometry.platform_axes, expected.platform_axes, atol=1e-9)
    assert np.allclose([geometry.alphas, geometry.betas], [expected.alphas, expected.betas],
                       atol=1e-7)
    assert values['can.channel'] == 'can1' and values['encoders.id'] == [1, 2, 3, 4]
    # Counts become the joint angles of the model: whole zero counts, table and harmonics.
    checked = command_line.checked(
        values | {'can.channel': 'vcan0'}, SOURCE_SETTINGS['can'], 'can')
    _, read = exact(78)
    zeros, _ = zero_counts(calibration, (16384,) * 4)
    turned = read + calibration.vector[:4]
    for sensor, harmonics in enumerate(make_harmonics(checked)):
        whole = calibration.direction[sensor] * zeros[sensor] * tau / 16384.0
        angle = harmonics.angles(turned[:, sensor] - whole)
        first, second = calibration.layout.harmonics(calibration.vector)
        reading = angle + first[sensor] @ [np.cos(angle), np.sin(angle)] \
            + second[sensor] @ [np.cos(2.0 * angle), np.sin(2.0 * angle)] \
            + calibration.vector[sensor]
        difference = (reading - turned[:, sensor] + pi) % tau - pi
        assert np.abs(difference).max() < 1e-6
    assert parameter_dict_from_yaml_file(str(path), True, [])


def test_the_record_has_origin_and_figures_as_data(calibration, tmp_path):
    path = tmp_path / 'calibration.yaml'
    write_text(path, motion_text(calibration, ORIGIN, VERDICT))
    record = yaml.safe_load(path.read_text())['calibration_record']['ros__parameters']
    assert {name: record[name] for name in ('method', 'date', 'recording', 'checksum', 'version')
            } == {'method': 'motion', 'date': '2026-01-02T03:04:05+00:00',
                  'recording': 'motion.log', 'checksum': 'ab12', 'version': '1.2.3'}
    assert record['parameters'] == list(calibration.layout.names)
    assert record['values_deg'] == pytest.approx(np.degrees(calibration.vector), abs=1e-6)
    assert record['deviations_deg'] == pytest.approx(np.degrees(calibration.deviations), abs=1e-6)
    assert (record['target_deg'], record['alert_limit_deg']) == (0.04, 0.5)
    assert record['region_error_deg'] == pytest.approx(degrees(calibration.region_error), abs=1e-6)
    assert (record['region_tilt_deg'], record['region_phi_deg']) == (16.0, [0.0, 80.0])
    head = path.read_text().partition('/**')[0]
    assert 'alert limit of 0.5 deg or more, over the workspace' in head
    assert '0.031 deg rms over the region, target 0.04 deg reached' in head


@pytest.mark.parametrize('name', ['a "b": \\ # c.log', '1e5', 'y', 'line\nbreak', '0x1f', 'größe'])
def test_any_name_of_a_log_can_be_read_back(calibration, tmp_path, name):
    path = tmp_path / 'calibration.yaml'
    write_text(path, motion_text(calibration, replace(ORIGIN, recording=name), VERDICT))
    assert yaml.safe_load(path.read_text())['calibration_record']['ros__parameters'][
        'recording'] == name
    assert {section.values['recording'] for section in read_sections(path)
            if section.nodes == '/calibration_record'} == {name}
    assert parameter_dict_from_yaml_file(str(path), True, [])


def test_poses_of_a_jig_give_the_mounting_of_the_base(calibration, motion):
    poses, read = exact(79, 40)
    true = matrix_from_zxz(0.3, 0.2, -0.5)
    model = MotionModel(calibration.layout, calibration.noise)
    found = mounted(calibration, (read + motion[3])[:1], true @ poses[:1], radians(0.05))
    assert np.array_equal(found.handle, np.eye(3)) and not found.handle_deviations.any()
    # A jig's pose in the frames of the rig: the calibration's differ by less than a degree.
    assert degrees(float(np.linalg.norm(rotation_vectors((found.base @ true.T)[None])))) < 1.5
    at = model.orientations((read + motion[3])[:1], found.calibration.vector)
    assert np.allclose(found.base @ at[0], true @ poses[0], atol=1e-6)


def test_a_capture_gives_both_mountings_and_improves_the_mechanism(calibration, motion):
    poses, read = exact(80, 100)
    base, handle = matrix_from_zxz(0.3, 0.2, -0.5), matrix_from_zxz(1.0, 0.4, 2.0)
    sigma = radians(0.05)
    noise = sigma * np.random.default_rng(5).normal(size=(len(poses), 3))
    outside = np.stack([turn(each) for each in noise]) @ base @ poses @ handle
    found = mounted(calibration, read + motion[3], outside, sigma)
    assert found.rms < 1.3 * sigma
    assert found.calibration.error < calibration.error
    assert (found.base_deviations > 0.0).all() and (found.handle_deviations > 0.0).all()
    with pytest.raises(CalibrationError, match='contradict the motion'):
        mounted(calibration, read + motion[3], outside[::-1], sigma)


def test_the_guide_says_how_to_go_on_until_it_is_enough(motion):
    stamps, raw, _, _ = motion
    guide = Guide(Layout(4))
    first = guide.evaluate(stamps[:2500], raw[:2500])
    assert first.error is None and 'tilt the handle in all directions' in first.text
    assert min(first.covered.values()) < 1.0
    half, more = (guide.evaluate(stamps[:count], raw[:count]) for count in (16000, 24000))
    assert half.error is not None and more.error <= half.error
    whole = guide.evaluate(stamps, raw)
    assert 'predicted error' in whole.text and 'the handle farther' in whole.text
    # The instruction is of the motion that has most left to give; the more there is, the less.
    assert whole.text.endswith(min(whole.covered, key=whole.covered.get))
    assert all(0.0 < share <= 1.0 for share in whole.covered.values())
    assert np.mean(list(half.covered.values())) < np.mean(list(whole.covered.values()))


def test_groups_that_are_confirmed_together_only_are_estimated():
    """One alone takes the place of the others; without any, the rest looked like a slip."""
    rig = random_rig(11, Deviations(radians(0.3), radians(0.3), radians(0.12), radians(0.015)))
    found = calibrated(*readings(rig, replace(SHORT, seconds=30.0), 1107))
    assert not found.left and not found.misfit


def test_five_and_six_sensors_are_calibrated_too(motion):
    rig = random_rig(12, Deviations(radians(0.3), radians(0.3), radians(0.12), radians(0.015)),
                     sensors=6)
    stamps, raw, direction, zeros = readings(rig, SHORT, SEED)
    found = calibrate_motion(Layout(6), stamps, raw)
    assert found.direction == tuple(direction)
    off = np.angle(np.exp(1j * (found.vector[:6] - zeros)))
    assert (np.abs(off) < 4.0 * found.deviations[:6]).all()
    assert found.error < radians(0.03)
