# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of rigs of which nothing is known: what comes out, its file, and what is refused."""

from dataclasses import replace
from functools import cache
from math import degrees, radians, tau
import re
from types import SimpleNamespace

import free_motions
from free_motions import DEVIATIONS, RIG, SEED, SHORT, short_motion
import numpy as np
import pytest
from rclpy.parameter import parameter_dict_from_yaml_file
from recorded_text import assert_recorded
from simulated_hand import deviations_of, hand_motion, joint_angles, readings
from spm_haptic_master.calibration.calibration_file import file_text, write_text
from spm_haptic_master.calibration.motion import coverage, free_motion, zero_search
from spm_haptic_master.calibration.motion import motion_file as results
from spm_haptic_master.calibration.motion.coverage import Region
from spm_haptic_master.calibration.motion.free_motion import calibrate_motion
from spm_haptic_master.calibration.motion.model import Layout
from spm_haptic_master.calibration.motion.outside_reference import mounted
from spm_haptic_master.encoders.decoder_factory import make_harmonics
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import matrix_from_zxz
from spm_haptic_master.kinematics.rotations import matrix_from_vector, wrapped
from spm_haptic_master.parameters.files import read_sections
from spm_haptic_master.parameters.geometry import geometry_from, MECHANISM_SETTINGS
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.simulation.rig import random_rig
from spm_haptic_master.tools import command_line
from spm_haptic_master.validation.alignment import constant_frames, rotation_vectors

PER_TURN = (16384, 16384, 4096, 65536)
ORIGIN = results.Origin(
    date='2026-03-01T10:00:00+01:00',
    recording='hand | motion.log',
    checksum='ab' * 32,
    version='1.2.3',
    counts_per_turn=PER_TURN,
    settings={
        'can.channel': 'can1',
        'source': 'can',
        'encoders.id': (1, 2, 3, 4),
    },
)
CHECKED = results.Checked(
    alert_limit_deg=1.0,
    share=(0.93, 0.91, 0.9, 0.0),
    least_limit_deg=1.42,
)


def fifth_of_short_motion():
    """Return stamps, raw readings and true directions of the short motion, every fifth set."""
    stamps, raw, direction, _ = short_motion()
    return stamps[::5], raw[::5], direction


@pytest.fixture
def calibration():
    return free_motions.short_calibration()


@cache
def exact(seed, count=200):
    """Return orientations of another motion, and readings without noise by their directions."""
    poses = hand_motion(RIG, replace(SHORT, seconds=10.0), seed)
    poses = poses[:: len(poses) // count]
    angles = joint_angles(poses, RIG)
    return poses, angles + deviations_of(RIG, angles)


def error_deg(
    found,
    vector,
    zeros,
):
    """Return the error of another motion's orientations, up to the frames, deg rms."""
    poses, read = exact(77)
    orientations = found.model.orientations(read + zeros, vector)
    base, body = constant_frames(poses, orientations, False)
    vectors = rotation_vectors(base @ orientations @ body @ poses.swapaxes(1, 2))
    squares = np.sum(vectors**2, axis=1)
    return degrees(float(np.sqrt(np.mean(squares))))


def check(found):
    """Check directions, zeros, orientations of another motion, noise, bias and parity."""
    _, _, direction, zeros = short_motion()
    assert found.direction == tuple(direction)
    off = np.abs(wrapped(found.vector[:4] - zeros))
    assert (off < 4.0 * found.deviations[:4]).all()
    error = error_deg(found, found.vector, zeros)
    assert 0.2 * degrees(found.error) < error < min(2.0 * degrees(found.error), 0.1)
    zeros_alone = np.zeros(found.layout.count - 4)
    alone = np.concatenate([found.vector[:4], zeros_alone])
    assert error < 0.3 * error_deg(found, alone, zeros)
    assert not found.unusual
    assert not found.cautions
    check_sensors(found, zeros)


def check_sensors(found, zeros):
    """Check noise, bias and parity of the sensors."""
    assert np.allclose(np.degrees(found.readings.noise), 0.0405, rtol=0.05)
    # No sensor is off by more than its bound, which is no more than needed.
    assert (free_motions.sensor_errors(found, RIG, zeros) < found.bias).all()
    assert (found.bias < radians(0.6)).all()
    # The parity is that of white noise, of as many means.
    white = np.sqrt(np.mean(found.readings.sigma**2))
    assert np.nanstd(found.parity) == pytest.approx(white, rel=0.1)
    assert np.nanstd(found.parity_before) > 2.0 * white


def test_a_motion_with_known_zeros_determines_the_rig(calibration):
    check(calibration)
    assert set(calibration.left) <= {'second harmonics'}
    assert 0.5 * calibration.error < calibration.region_error < 1.5 * calibration.error


def hardly_a_motion():
    """Return the raw readings of a motion of some degrees."""
    small = replace(
        SHORT,
        tilt=1.5,
        turn_from=44.0,
        turn_to=48.0,
    )
    _, raw, _, _ = readings(RIG, small, SEED)
    return raw


@pytest.mark.slow
def test_nothing_is_known_and_the_directions_that_are_given_are_verified():
    stamps, raw, direction = fifth_of_short_motion()
    check(calibrate_motion(Layout(4), stamps, raw, direction.tolist()))


@pytest.mark.usefixtures('few_guesses')
def test_a_direction_that_the_motion_contradicts_is_refused():
    stamps, raw, direction = fifth_of_short_motion()
    wrong = list(direction)
    wrong[2] = -wrong[2]
    with pytest.raises(
        CalibrationError,
        match=(
            rf'^joint_1c turns with direction \{direction[2]:+d}, encoders.direction has '
            rf'\{-direction[2]:+d}$'
        ),
    ):
        calibrate_motion(Layout(4), stamps, raw, wrong)


@pytest.mark.slow
@pytest.mark.usefixtures('few_guesses')
@pytest.mark.parametrize(
    'change, words',
    [
        (lambda raw: raw[:, [2, 1, 0, 3]], '^joint_1a and joint_1c are swapped: '),
        # A motion that hardly moves is refused with what is missing.
        (
            lambda raw: hardly_a_motion()[::5],
            'tilt the handle|turn the handle',
        ),
    ],
)
def test_readings_of_another_mechanism_or_hardly_a_motion_are_refused(change, words):
    stamps, raw, _ = fifth_of_short_motion()
    with pytest.raises(CalibrationError, match=words):
        calibrate_motion(Layout(4), stamps, change(raw))


def test_the_file_is_what_was_found(calibration, tmp_path):
    path = tmp_path / 'calibration.yaml'
    part = replace(calibration, region=Region(14.0, 5.0, 75.0))
    write_text(
        path,
        results.motion_text(
            results.Verdict(
                part,
                ORIGIN,
                0.5,
                0.9987,
                0.04,
                CHECKED,
            )
        ),
    )
    assert_recorded('calibration/short.yaml', path.read_text())
    assert 'CAUTION: with alert_limit_deg 1 nothing checks joint_3a anywhere' in path.read_text()
    values = read_parameters(path)
    geometry = geometry_from(
        command_line.checked(
            {name: value for name, value in values.items() if name.startswith('geometry.')},
            MECHANISM_SETTINGS,
        )
    )
    expected = calibration.layout.geometry(calibration.vector)
    for name in ('base_axes', 'platform_axes', 'alphas', 'betas'):
        assert np.allclose(getattr(geometry, name), getattr(expected, name), atol=1e-7)
    # Counts become the joint angles of the model: whole zero counts, table and harmonics.
    checked = command_line.checked(
        values | {'can.channel': 'vcan0'},
        SOURCE_SETTINGS['can'],
        'can',
    )
    turned = exact(77)[1] + calibration.vector[:4]
    zeros = np.multiply(calibration.direction, values['encoders.zero_count']) * tau / PER_TURN
    for sensor, harmonics in enumerate(make_harmonics(checked)):
        angle = harmonics.angles(turned[:, sensor] - zeros[sensor])
        first, second = calibration.layout.harmonics(calibration.vector)
        reading = (
            angle
            + first[sensor] @ [np.cos(angle), np.sin(angle)]
            + second[sensor] @ [np.cos(2.0 * angle), np.sin(2.0 * angle)]
            + calibration.vector[sensor]
        )
        assert np.abs(wrapped(reading - turned[:, sensor])).max() < 1e-6
    # A millionth of a degree is enough for all but axes.
    assert not re.search(r'^(?!.*_axes).*\.\d{7}', path.read_text(), re.MULTILINE)


def test_the_record_of_a_file_has_few_digits(calibration, tmp_path):
    """Tenths of seconds, hundredths of per cent, thousandths of a degree: a person reads it."""
    seconds = calibration.readings.seconds.copy()
    seconds[-1] = 23.4567
    part = replace(
        calibration,
        kept=np.arange(len(calibration.kept)) >= 7,
        readings=replace(calibration.readings, seconds=seconds),
        left={'links': 'no reason', 'base axes': 'none either'},
    )
    checked = results.Checked(
        1.0,
        (0.98765, 0.5, 0.1234, 1.0),
        0.45678,
    )
    path = tmp_path / 'calibration.yaml'
    verdict = results.Verdict(
        part,
        ORIGIN,
        0.5,
        0.9987654,
        0.04,
        checked,
    )
    path.write_text(results.motion_text(verdict))
    assert not re.search(r'\.\d{13}', path.read_text())
    record = read_sections(path)[1].values
    percent = 100.0 * 7.0 / len(calibration.kept)
    assert record['cut_percent'] == round(percent, 2) != round(percent, 3)
    assert record['seconds'] == 23.5
    assert record['checked_percent'] == [98.8, 50.0, 12.3, 100.0]
    assert record['all_checked_limit_deg'] == 0.457
    assert record['published_percent'] == 99.88
    assert record['left_as_drawn'] == 'links: no reason; base axes: none either'
    assert (record['region_tilt_deg'], record['region_phi_deg']) == (16.0, [0.0, 80.0])


@pytest.mark.parametrize(('target_deg', 'verb'), [(0.101, 'reached'), (0.099, 'NOT reached')])
def test_a_verdict_says_where_and_whether_the_target_is_reached(
    calibration,
    target_deg,
    verb,
):
    part = replace(calibration)
    part.__dict__['region_error'] = radians(0.1)
    checked = results.Checked(1.0, (0.9, 0.0, 0.8, 0.0), 1.42)
    found = results.Verdict(
        part,
        ORIGIN,
        0.5,
        1.0,
        target_deg,
        checked,
    )
    assert found.text == (
        'Good for an alert limit of 0.5 deg or more, over the workspace: tilt to 16 deg, '
        'self-rotation 0 to 80 deg.'
    )
    assert found.reached == (
        'Predicted error of the orientation: 0.100 deg rms over the region, target '
        f'{target_deg:g} deg {verb}.'
    )
    small = replace(found, calibration=replace(part, region=Region(9.0, 0.0, 80.0)))
    assert ', ONLY for the region moved: tilt to 9 deg' in small.text
    (caution,) = found.cautions
    assert caution.startswith('with alert_limit_deg 1 nothing checks joint_1b, joint_3a anywhere')
    assert checked.lines[0] == 'joint_1a is checked in 90 % of the region'
    everywhere = replace(checked, share=(0.9, 0.1, 0.8, 0.2))
    assert replace(found, checked=everywhere).cautions == ()


@pytest.mark.parametrize('name', ['a "b": \\ # c.log', '1e5', 'y', 'line\nbreak', '0x1f', 'größe'])
def test_any_name_of_a_log_can_be_read_back(tmp_path, name):
    path = tmp_path / 'calibration.yaml'
    text = file_text(['a comment'], {'calibration': 'motion'}, {'recording': name})
    write_text(path, text)
    assert [section.values for section in read_sections(path)] == [
        {'calibration': 'motion'},
        {'recording': name},
    ]
    assert parameter_dict_from_yaml_file(str(path), True, [])


# Mountings of the base and of the handle, and the noise of a pose from outside (rad).
BASE = matrix_from_zxz(0.3, 0.2, -0.5)
HANDLE = matrix_from_zxz(1.0, 0.4, 2.0)
OUTSIDE_SIGMA = radians(0.05)


def off_by(found, expected):
    """Return how far a mounting is off, which is also by what the frames differ, rad."""
    return np.linalg.norm(rotation_vectors((found @ expected.T)[None]))


def poses_of_a_jig(calibration, count):
    """Return the mounting that some exact poses of a jig give."""
    poses, read = exact(77, 100)
    turned = read[:count] + short_motion()[3]
    return mounted(calibration, turned, BASE @ poses[:count], OUTSIDE_SIGMA)


def test_one_pose_of_a_jig_gives_the_mounting_of_the_base(calibration):
    one = poses_of_a_jig(calibration, 1)
    poses, read = exact(77, 100)
    turned = read[:1] + short_motion()[3]
    at = calibration.model.orientations(turned, one.calibration.vector)
    assert np.allclose(one.base @ at[0], BASE @ poses[0], atol=1e-6)
    assert off_by(one.base, BASE) < radians(1.0)
    assert (one.base_deviations >= OUTSIDE_SIGMA).all()
    assert one.rms < 1e-9
    assert np.array_equal(one.handle, np.eye(3))
    assert not one.handle_deviations.any()


def test_two_poses_of_a_jig_say_more_of_the_base_and_nothing_of_the_handle(calibration):
    one = poses_of_a_jig(calibration, 1)
    two = poses_of_a_jig(calibration, 2)
    assert (two.base_deviations < one.base_deviations).all()
    assert two.rms < 0.3 * OUTSIDE_SIGMA
    assert np.array_equal(two.handle, np.eye(3))
    assert not two.handle_deviations.any()


def captured():
    """Return readings, and noisy poses from outside, of a motion that is captured."""
    poses, read = exact(77, 100)
    noise = OUTSIDE_SIGMA * np.random.default_rng(5).normal(size=(len(poses), 3))
    outside = matrix_from_vector(noise) @ BASE @ poses @ HANDLE
    return read + short_motion()[3], outside


def test_a_capture_gives_both_mountings_and_improves_the_mechanism(calibration):
    turned, outside = captured()
    found = mounted(calibration, turned, outside, OUTSIDE_SIGMA)
    assert 0.8 * OUTSIDE_SIGMA < found.rms < 1.3 * OUTSIDE_SIGMA
    assert found.calibration.error < calibration.error
    assert off_by(found.base, BASE) < radians(1.0)
    assert off_by(found.handle, HANDLE) < radians(1.0)
    for deviations in (found.base_deviations, found.handle_deviations):
        assert (deviations > 0.1 * OUTSIDE_SIGMA).all()
        assert (deviations < radians(0.5)).all()


def test_a_capture_of_another_motion_is_refused(calibration):
    turned, outside = captured()
    with pytest.raises(CalibrationError, match='contradict the motion'):
        mounted(calibration, turned, outside[::-1], OUTSIDE_SIGMA)


def test_cautions_name_what_an_engineer_should_look_at(calibration):
    assert calibration.cautions == ()
    c = calibration
    vector = calibration.vector.copy()
    vector[c.layout.names.index('distal link B')] = 3.6 * radians(0.5)
    spiked = np.arange(c.readings.sets) % 500 == 0
    found = replace(
        c,
        vector=vector,
        contradiction=3.1,
        readings=replace(c.readings, spiked=spiked),
        kept=np.arange(len(c.kept)) % 100 > 0,
    )
    assert [caution[:60] for caution in found.cautions] == [
        'farther from the drawing than 3.5 tolerances: distal link B;',
        'halves of the motion contradict each other (3.1 times the va',
        '0.2 % of the sets have a spike; fkm withholds ten orientatio',
        '1.0 % of the samples do not fit the others and were cut: an ',
    ]
    vector[c.layout.names.index('distal link B')] = -3.4 * radians(0.5)
    assert (
        replace(
            found,
            vector=vector,
            contradiction=2.9,
            kept=np.arange(len(c.kept)) % 250 > 0,
            readings=c.readings,
        ).cautions
        == ()
    )


@pytest.mark.slow
@pytest.mark.usefixtures('few_guesses')
def test_an_encoder_that_turns_with_another_shaft_is_refused():
    """Exchanged encoders, which do not explain it either, are another refusal's subject."""
    stamps, raw, _ = fifth_of_short_motion()
    raw = np.column_stack([raw[:, 0], np.roll(raw[:, 1], 1000), raw[:, 2:]])
    with pytest.raises(CalibrationError, match='no zeros and directions of the encoders explain'):
        calibrate_motion(Layout(4), stamps, raw, swaps=False)


@pytest.mark.slow
def test_groups_that_are_confirmed_together_only_are_estimated():
    """One alone takes the place of the others; without any, the rest looked like a slip."""
    found = free_motions.calibrated(
        *readings(random_rig(11, DEVIATIONS), replace(SHORT, seconds=30.0), 1107)
    )
    assert not found.left
    assert not found.misfit


@pytest.mark.slow
@pytest.mark.usefixtures('few_guesses')
def test_five_and_six_sensors_are_calibrated_too():
    six = random_rig(12, DEVIATIONS, sensors=6)
    stamps, raw, direction, zeros = readings(six, SHORT, SEED)
    found = calibrate_motion(Layout(6), stamps[::5], raw[::5])
    assert found.direction == tuple(direction)
    off = np.abs(wrapped(found.vector[:6] - zeros))
    assert (off < 4.0 * found.deviations[:6]).all()
    assert found.error < radians(0.03)


@pytest.mark.parametrize(
    'begin, end, words',
    [
        (0.0, 1.5, '1.5.* more than 4 s'),
        (0.0, 3.9, '3.9.* more than 4 s'),
        (7.0, 9.5, '2.5.* more than 4 s'),
        (0.0, 9.9, '.* without a long pause'),
    ],
)
def test_a_motion_without_a_part_that_confirms_the_rest_is_refused(
    begin,
    end,
    words,
):
    stamps, raw, _, _ = short_motion()
    since = (stamps - stamps[0]) * 1e-9
    rows = (since >= begin) & (since < end)
    rows &= (since < 3.9) | (since > 6.1)
    with pytest.raises(CalibrationError, match=f'the motion lasts {words}'):
        calibrate_motion(Layout(4), stamps[rows], raw[rows])


@pytest.mark.usefixtures('few_guesses')
def test_guidance_is_the_recorded_one(monkeypatch):
    """Of the beginnings of a motion, with the zeros: the first search for them finds none."""

    def found(*given, **options):
        lines.append('search')
        if lines.count('search') == 1:
            raise CalibrationError('several explain the motion')
        start = zero_search.find_start(*given, **options)
        lines.append(f'{start.direction}, {np.degrees(start.vector[:4]).round(4).tolist()}')
        return start

    monkeypatch.setattr(free_motion, 'find_start', found)
    stamps, raw, _, _ = short_motion()
    guide = free_motion.Guide(Layout(4))
    lines = []
    for count in (1500, 2500, 10000, 14000, 16000):
        guidance = guide.evaluate(stamps[:count:8], raw[:count:8])
        lines += [
            f'{count} sets: {guidance.text}',
            *(f'    {name}: {share:.4f}' for name, share in guidance.covered.items()),
        ]
    assert_recorded('calibration/guidance.txt', '\n'.join(lines))


@pytest.mark.parametrize(
    ('change', 'caution'),
    [
        ({'spiked': np.arange(10_000) < 10}, ''),
        ({'spiked': np.arange(10_000) < 15}, '0.1 % of the sets have a spike'),
        ({'kept': np.arange(10_000) >= 49}, ''),
        ({'kept': np.arange(10_000) >= 70}, '0.7 % of the samples do not fit the others'),
        ({'contradiction': 3.0}, ''),
        ({'contradiction': 3.01}, 'halves of the motion contradict each other (3.0 times'),
        ({'noisy': 1.09}, ''),
        ({'noisy': 1.12}, 'the sets come at irregular times: differences of the readings of joi'),
    ],
)
def test_a_caution_begins_where_its_limit_is_exceeded(
    calibration,
    change,
    caution,
):
    c = calibration
    noise = c.noise.copy()
    if 'noisy' in change:
        noise[2] *= change.pop('noisy')
    spiked = change.pop('spiked', np.zeros(10_000, dtype=bool))
    readings_of = replace(c.readings, spiked=spiked, noise=noise)
    cautions = replace(c, readings=readings_of, **change).cautions
    assert [each[: len(caution)] for each in cautions] == ([caution] if caution else [])
    if 'irregular' in caution:
        assert 'joint_1c look like a noise of' in cautions[0]


def test_irregular_times_are_named_by_the_sensor_that_looks_too_noisy_for_itself(calibration):
    """Of the least noise of all, and even so below the others."""
    c = calibration
    quiet = replace(c, model=replace(c.model, sigma=c.model.sigma * [1.0, 1.0, 0.5, 1.0]))
    looks = quiet.noise * [1.0, 1.0, 1.2, 1.0]
    found = replace(quiet, readings=replace(c.readings, noise=looks))
    assert 'joint_1c look like a noise of' in found.irregular


def cures_of(
    calibration,
    of_zeros,
    of_rest,
):
    """Return the cures where the motion has these informations, 1/rad^2, of each parameter."""
    information = np.diag([of_zeros] * 4 + [of_rest] * 28)
    found = replace(
        calibration,
        information=information,
        advice='turn it',
        advice_gain=6.25,
    )
    cures = found.cures
    assert list(cures) == [
        'a larger motion (turn it)',
        'a motion twice as long',
        'half of --mechanism-tolerance and --harmonic-tolerance, if the workshop guarantees that,',
    ]
    return list(cures.values())


def test_cures_say_by_what_they_divide_the_error(calibration):
    """What the motion determines gets better with its length, the rest with the tolerances."""
    assert cures_of(calibration, 1e9, 1e9) == pytest.approx([2.5, 2.0**0.5, 1.0], rel=1e-2)
    assert cures_of(calibration, 1e12, 1e-3) == pytest.approx([2.5, 1.0, 2.0], rel=1e-2)


@pytest.mark.parametrize(('error_deg', 'refused'), [(0.19, False), (0.21, True)])
def test_zeros_that_leave_a_fifth_of_a_degree_are_not_determined(
    monkeypatch,
    error_deg,
    refused,
):
    """As the whole motion has it, of which the fit has half of the samples."""
    model = free_motions.model_of()
    vector = np.zeros(model.layout.count)
    # The error of the zeros alone goes with the root of the information.
    poses = coverage.WORKSPACE.poses(model, vector)
    changes = coverage.aligned_changes(model, poses, vector)[:, :, :4]
    of_one = coverage.orientation_error(changes, np.eye(4))
    information = 0.5 * np.eye(4) * (of_one / radians(error_deg)) ** 2
    first = SimpleNamespace(vector=vector, normal=SimpleNamespace(matrix=information))
    if not refused:
        free_motion._check_zeros(
            model,
            first,
            2.0,
            'turn it',
        )
        return
    words = (
        '^the motion does not determine the zeros: they leave a predicted error of 0.21 deg, '
        'limit 0.2 deg; turn it$'
    )
    with pytest.raises(CalibrationError, match=words):
        free_motion._check_zeros(
            model,
            first,
            2.0,
            'turn it',
        )


def test_a_motion_that_leaves_the_zeros_open_is_refused_before_more_is_fitted(monkeypatch):
    monkeypatch.setattr(free_motion, 'ZEROS_LIMIT', radians(1e-4))
    monkeypatch.setattr(free_motion.fit, 'choose', None)
    stamps, raw, direction, zeros = short_motion()
    with pytest.raises(CalibrationError, match='^the motion does not determine the zeros: they'):
        free_motions.calibrated(
            stamps[::100],
            raw[::100],
            direction,
            zeros,
        )


def test_slow_errors_count_as_noise_and_take_from_the_information(monkeypatch):
    """Four times the variance: twice the noise, and a quarter of the information."""
    layout = Layout(4)
    informations = []

    def estimated(given, vector, columns, information):
        informations.append(information)
        return given

    normal = SimpleNamespace(matrix=8.0 * np.eye(3), rotation=None)
    monkeypatch.setattr(free_motion.fit, 'normal_equations', lambda *_: normal)
    monkeypatch.setattr(free_motion.misfit, 'slow_factor', lambda *_: 4.0)
    monkeypatch.setattr(free_motion, 'estimated_tolerances', estimated)
    found = free_motion._as_found(
        SimpleNamespace(layout=layout, sigma=np.full(4, 1e-3)),
        None,
        SimpleNamespace(seconds=None),
        SimpleNamespace(normal=normal, vector=None, columns=None),
    )
    assert found.layout is layout
    np.testing.assert_allclose(found.sigma, 2e-3)
    np.testing.assert_allclose(informations, [2.0 * np.eye(3)])


@pytest.fixture
def searched(monkeypatch):
    """Let a search find directions; return what was asked of it."""
    asked = []
    start = zero_search.Start((1, -1, 1, 1), np.zeros(32))

    def find_start(
        means,
        model,
        progress,
        swaps,
    ):
        asked.append(swaps)
        return start

    monkeypatch.setattr(
        free_motion,
        'find_start',
        find_start,
    )
    monkeypatch.setattr(
        free_motion,
        'fitted',
        lambda layout, means, start, progress: start,
    )
    return asked


def test_directions_are_those_that_were_given_if_any_were(searched):
    stamps, raw, _ = fifth_of_short_motion()
    for given in (None, (1, -1, 1, 1)):
        assert calibrate_motion(
            Layout(4),
            stamps,
            raw,
            given,
        ).direction == (1, -1, 1, 1)
    words = (
        r'^joint_1b turns with direction -1, encoders.direction has \+1; joint_3a turns with '
        r'direction \+1, encoders.direction has -1$'
    )
    with pytest.raises(CalibrationError, match=words):
        calibrate_motion(
            Layout(4),
            stamps,
            raw,
            (1, 1, 1, -1),
        )
    calibrate_motion(
        Layout(4),
        stamps,
        raw,
        swaps=False,
    )
    # Exchanged encoders are looked for unless it is said otherwise.
    assert searched == [True, True, True, False]


class Motions:
    """A motion that is being recorded: travel of its joints, deg, and its length, s."""

    def __init__(self, monkeypatch):
        self.searches = []
        self.finds = False
        monkeypatch.setattr(
            free_motion,
            'motion_readings',
            self._readings,
        )
        monkeypatch.setattr(
            free_motion,
            'find_start',
            self._search,
        )
        monkeypatch.setattr(
            free_motion,
            '_outlook',
            lambda *_: (radians(0.123), {'tilt it': 4.0, 'turn it': 1.25}),
        )
        self.guide = free_motion.Guide(Layout(4))

    def _readings(
        self,
        stamps,
        readings,
    ):
        return SimpleNamespace(
            seconds=np.array([0.0, stamps]),
            readings=readings,
            sigma=np.full(4, 1e-3),
        )

    def _search(
        self,
        means,
        model,
        swaps,
    ):
        self.searches.append(float(means.seconds[-1]))
        assert swaps is False
        if self.finds:
            return 'a start'
        raise CalibrationError('several explain the motion')

    def after(self, seconds, *travel_deg):
        """Return the guidance of a motion whose joints turn, across the end of their turn."""
        ramp = np.linspace(-0.5, 0.5, 50)[:, None] * np.radians(travel_deg)
        return self.guide.evaluate(seconds, (ramp + 0.01) % tau)


def test_zeros_are_searched_for_once_all_joints_have_moved_far_enough(monkeypatch):
    """By 25 deg; again when the motion has become half as long again."""
    motions = Motions(monkeypatch)
    found = motions.after(
        10.0,
        50.0,
        24.0,
        30.0,
        100.0,
    )
    assert found.error is None
    assert found.text.endswith('turn it both ways (joint_1b has moved by 24 deg)')
    assert found.covered == pytest.approx(
        {'joint_1a': 1.0, 'joint_1b': 0.96, 'joint_1c': 1.0, 'joint_3a': 1.0}
    )
    assert motions.searches == []
    enough = (50.0, 26.0, 30.0, 100.0)
    found = motions.after(10.0, *enough)
    assert found.text.endswith('turn it both ways (the zeros are not determined yet)')
    assert found.covered['joint_1b'] == 1.0
    motions.after(14.9, *enough)
    assert motions.searches == [10.0]
    motions.finds = True
    found = motions.after(15.1, *enough)
    assert motions.searches == [10.0, 15.1]
    assert found.error == pytest.approx(radians(0.123))
    assert found.text == 'predicted error 0.123 deg; tilt it'
    assert found.covered == {'tilt it': 0.25, 'turn it': 0.8}
    # What was found is kept.
    motions.after(60.0, *enough)
    assert len(motions.searches) == 2


def test_the_reason_why_a_motion_is_too_short_is_guidance():
    found = free_motion.Guide(Layout(4)).evaluate(np.arange(10), np.zeros((10, 4)))
    assert (found.error, found.covered) == (None, {})
    assert found.text.startswith('10 sets of four encoders in 0.0 s')
