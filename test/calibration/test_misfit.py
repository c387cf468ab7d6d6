# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rigs that are not the model's: slips, drift, play, axes that miss the centre, by their names."""

from math import radians, tau
import re

import free_motions
from free_motions import calibrated, short_motion
from non_concentric import closed_angles
import numpy as np
import pytest
from simulated_hand import Condition, hand_motion
from spm_haptic_master.calibration.motion import misfit
from spm_haptic_master.calibration.motion.calibration import CONTRADICTION
from spm_haptic_master.calibration.motion.fit import fit
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import Geometry, inverse, workspace_pose
from spm_haptic_master.simulation.rig import perfect_rig


def changed(sensor, change, **how):
    """Return the calibration with a sensor's angles changed, deg, by a function of 0 .. 1."""
    stamps, raw, direction, zeros = short_motion()
    raw = raw[::10].copy()
    part = np.arange(len(raw)) / len(raw)
    raw[:, sensor] += direction[sensor] * np.radians(change(part))
    return calibrated(
        stamps[::10],
        raw,
        direction,
        zeros,
        **how,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    'sensor, part',
    [
        (1, 0.06),
        *(
            pytest.param(*case, marks=pytest.mark.evidence)
            for case in ((0, 0.03), (3, 0.94), (2, 0.97))
        ),
    ],
)
def test_a_slip_near_an_end_of_the_motion_names_no_wrong_sensor(sensor, part):
    name = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a')[sensor]
    try:
        found = changed(sensor, lambda at: 1.0 * (at >= part))
    except CalibrationError as error:
        assert re.match(rf'{name} slipped by \+|one of the encoders slipped during', str(error))
    else:
        # So short a part is cut, and that is said.
        assert found.cut > 0.5 * min(part, 1.0 - part)
        assert any('were cut: an encoder that slipped' in each for each in found.cautions)


def test_play_is_a_caution_and_raises_the_bias():
    healthy = free_motions.short_calibration()
    shares = []
    _, raw, direction, _ = short_motion()
    turns = np.unwrap(raw[::10, 0] * direction[0])
    smooth = np.convolve(turns, np.ones(25) / 25.0, 'same')
    sense = np.sign(np.gradient(smooth))
    found = changed(
        0,
        lambda at: 0.1 * sense,
        progress=lambda text, share: shares.append(share),
    )
    assert any(
        'contradict each other' in caution and 'play' in caution for caution in found.cautions
    )
    assert found.bias[0] > radians(0.1)
    assert (found.bias > healthy.bias).all()
    assert shares == [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.9, 0.95]


@pytest.mark.slow
def test_axes_that_miss_the_centre_are_a_caution():
    geometry = Geometry()
    condition = Condition('motion', seconds=32.0)
    rotation = hand_motion(perfect_rig(geometry, 0.0), condition, 41)[::8]
    random = np.random.default_rng(1)
    offsets = 3.0 * random.normal(size=(3, 3, 3)) * [1.0, 1.0, 0.0]
    drawn = inverse(rotation[:50], geometry)
    assert np.allclose(
        closed_angles(rotation[:50], 0.0 * offsets, geometry),
        np.column_stack([drawn.theta1, drawn.theta3a]),
        atol=1e-9,
    )
    angles = closed_angles(rotation, offsets, geometry)
    zeros = random.uniform(0.0, tau, 4)
    direction = np.array([1, -1, 1, 1])
    read = angles + random.normal(size=angles.shape) * radians(0.02) + zeros
    stamps = (np.arange(len(rotation)) * 8e6).astype(np.int64)
    found = calibrated(stamps, direction * read, direction, zeros)
    assert any('axes that miss the centre' in caution for caution in found.cautions)


def test_a_motion_through_few_parts_of_the_workspace_does_not_contradict_itself():
    """Tilt and self-rotation grow together: most of the eight parts have no sample."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 5)
    along = np.linspace(-1.0, 1.0, 400)
    rotation = workspace_pose(0.2 * along, 0.8, 0.7 + 0.3 * along)
    turned = with_noise(model.readings(rotation, vector), 2)
    found = fit(
        model,
        turned,
        vector,
        range(model.layout.sensors),
        rotation,
    )
    assert misfit.contradiction(model, turned, found) < CONTRADICTION


SECONDS = 0.01 * np.arange(3000)
FASTEN = 'fasten the encoder and move the device again'


@pytest.mark.parametrize(
    ('sensor', 'change_deg', 'words'),
    [
        (
            0,
            0.5 * (SECONDS > 12.0),
            'joint_1a slipped by +0.50 deg during the motion, about 12 s after its beginning; '
            + FASTEN,
        ),
        # A slip of any encoder explains that of this one as well.
        (
            1,
            -0.4 * (SECONDS > 20.0),
            'one of the encoders slipped during the motion, about 20 s after its beginning; '
            + FASTEN,
        ),
        (
            2,
            0.02 * SECONDS,
            'joint_1c drifted by +0.60 deg during the motion; let it warm up, check its coupling '
            'and move the device again',
        ),
    ],
)
def test_a_slip_during_a_motion_is_named(
    sensor,
    change_deg,
    words,
):
    with pytest.raises(CalibrationError, match=f'^{re.escape(words)}$'):
        check_slip(sensor, change_deg)


def test_a_motion_without_a_slip_has_white_parity():
    assert check_slip(0, 0.0 * SECONDS) == pytest.approx(1.0)


def check_slip(sensor, change_deg):
    """Check a motion in which a zero changes, deg; return how slow its parity is."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 5)
    turned = with_noise(model.readings(free_motions.poses(3000), vector), 1)
    turned[:, sensor] += np.radians(change_deg)
    found = fit(model, turned, vector, range(4))
    slow = misfit.slow_factor(SECONDS, found.normal)
    assert slow > 200.0 or not change_deg.any()
    misfit.check_slip(model, turned, SECONDS, found)
    return slow


def with_noise(turned, seed):
    """Return readings with the noise of the model."""
    random = np.random.default_rng(seed)
    return turned + free_motions.SIGMA * random.normal(size=turned.shape)
