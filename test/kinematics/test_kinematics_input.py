# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bad input: the error of every public function names argument, value and expectation."""

import copy
import math
import pickle

from mechanism import CENTRE, zxz
import numpy as np
import pytest
from spm_haptic_master.exceptions import GeometryError, InputError, SpmError
from spm_haptic_master.kinematics import (
    dexterity,
    estimate,
    forward_all,
    forward_theta2a,
    forward_theta3a,
    Geometry,
    inverse,
    jacobian,
    matrix_from_quaternion,
    matrix_from_zxz,
    parallel_determinant,
    quaternion_from_matrix,
    track_mode,
    workspace_pose,
    zxz_from_matrix,
)

POSE = zxz(*CENTRE, 0.3)
TH1 = np.array([1.1, 1.0, 1.2])


@pytest.mark.parametrize('angles, name, value', [
    ((0.0, 0.5, 0.3), 'alpha', '0.0'), ((0.7, math.pi, 0.3), 'beta', '3.14159'),
    ((0.7, 0.6, -0.3), 'gamma', '-0.3'), ((39.3, 34.1, 18.2), 'alpha', '39.3'),
    ((math.nan, 0.6, 0.3), 'alpha', 'nan'), ((0.7, math.inf, 0.3), 'beta', 'inf'),
    ((0.7, '0.6', 0.3), 'beta', "'0.6'"), ((0.7, 0.6, None), 'gamma', 'None'),
    ((True, 0.6, 0.3), 'alpha', 'True')])
def test_impossible_geometries(angles, name, value):
    with pytest.raises(GeometryError) as caught:
        Geometry(*angles)
    assert f'{name} = {value}' in str(caught.value) and 'rad' in str(caught.value)


def test_geometry_is_a_value():
    assert Geometry() == Geometry(*np.radians([39.3, 34.1, 18.2]))
    assert hash(Geometry()) == hash(Geometry(*np.radians([39.3, 34.1, 18.2])))
    for name in ('alpha', 'alphas', 'legs', 'other'):
        with pytest.raises(AttributeError, match=name):
            setattr(Geometry(), name, 1.0)
    for copied in (copy.deepcopy(Geometry()), pickle.loads(pickle.dumps(Geometry()))):
        assert copied == Geometry() and copied.chain == Geometry().chain
    assert 'cos' not in repr(Geometry())


TAKE_ROTATIONS = [
    (inverse, 'R'), (jacobian, 'R'), (dexterity, 'R'), (parallel_determinant, 'R'),
    (quaternion_from_matrix, 'R'), (zxz_from_matrix, 'R'),
    (lambda R: track_mode(TH1, R), 'last'),
    (lambda R: estimate(TH1, 0.4, 1e-3, prior=[R]), 'prior')]


@pytest.mark.parametrize('function, name', TAKE_ROTATIONS)
@pytest.mark.parametrize('bad, quoted', [
    (np.full((3, 3), np.nan), 'nan'), (POSE + np.inf, 'inf'), (np.eye(4), '4, 4)'),
    (np.ones(9), '9'), (1.001 * POSE, 'rotation'), (-POSE, 'rotation'),
    (np.zeros((3, 3)), 'rotation'), ('pose', "'pose'"), (None, 'None'),
    (POSE.astype(complex), 'real'), ([[1.0, 0.0], [0.0]], 'real')])
def test_what_is_not_a_rotation(function, name, bad, quoted):
    with pytest.raises(InputError) as caught:
        function(bad)
    assert isinstance(caught.value, SpmError)
    assert name in str(caught.value) and quoted in str(caught.value)


def test_single_precision_rotations_pass():
    np.testing.assert_allclose(
        inverse(POSE.astype(np.float32)).theta1, inverse(POSE).theta1, atol=1e-5)


TAKE_TH1 = [
    forward_all, lambda th1: forward_theta3a(th1, 0.4),
    lambda th1: forward_theta2a(th1, 0.4), lambda th1: estimate(th1, 0.4, 1e-3),
    lambda th1: track_mode(th1, POSE)]


@pytest.mark.parametrize('function', TAKE_TH1)
@pytest.mark.parametrize('bad, quoted', [
    ([1.0, math.nan, 1.0], 'nan'), ([1.0, -math.inf, math.inf], 'inf'), ([1.0, 2.0], '(2,)'),
    (1.0, '()'), ([1.0, 'x', 2.0], 'x'), (None, 'None'), ([True, False, True], 'True')])
def test_bad_active_angles(function, bad, quoted):
    with pytest.raises(InputError) as caught:
        function(bad)
    assert 'th1' in str(caught.value) and quoted in str(caught.value)


def test_one_triple_at_a_time():
    with pytest.raises(InputError, match='one triple'):
        forward_all([TH1, TH1])


@pytest.mark.parametrize('function, name', [
    (lambda value: forward_theta3a(TH1, value), 'theta3a'),
    (lambda value: forward_theta2a(TH1, value), 'theta2a'),
    (lambda value: estimate(TH1, value, 1e-3), 'theta3a'),
    (lambda value: matrix_from_zxz(0.1, value, 0.2), 'theta'),
    (lambda value: workspace_pose(value, 0.1, 0.2), 'tilt')])
@pytest.mark.parametrize('bad', [math.nan, math.inf, 'x', None])
def test_bad_single_angles(function, name, bad):
    with pytest.raises(InputError) as caught:
        function(bad)
    assert name in str(caught.value) and str(bad) in str(caught.value)


@pytest.mark.parametrize('function', [
    lambda: forward_theta3a(np.ones((4, 3)), np.ones(5)),
    lambda: forward_theta2a(np.ones((4, 3)), np.ones(5)),
    lambda: estimate(np.ones((4, 3)), np.ones(5), 1e-3),
    lambda: estimate(np.ones((4, 3)), 1.0, 1e-3, prior=np.broadcast_to(POSE, (5, 3, 3))),
    lambda: workspace_pose(np.ones(4), np.ones(5), 0.0),
    lambda: matrix_from_zxz(np.ones(4), np.ones(5), 0.0)])
def test_batches_that_do_not_go_together(function):
    with pytest.raises(InputError, match=r'\(4,\).*\(5,\)'):
        function()


@pytest.mark.parametrize('sigma', [0.0, -1e-3, math.nan, math.inf, [1e-3] * 3, [1e-3, 1, 1, 0],
                                   np.ones((2, 4)), 'x', None])
def test_bad_sigma(sigma):
    with pytest.raises(InputError, match='sigma'):
        estimate(TH1, 0.4, sigma)


@pytest.mark.parametrize('missing', ['th3a', 3, ''])
def test_unknown_missing_sensor(missing):
    with pytest.raises(InputError, match='missing'):
        estimate(TH1, 0.4, 1e-3, prior=POSE, missing=missing)


@pytest.mark.parametrize('mode', [(1, 1), (1, 1, 0), (1, 1, 2), 1, None, '+++', (1, 1, '+')])
@pytest.mark.parametrize('function', [inverse, jacobian, dexterity, parallel_determinant])
def test_bad_working_mode(function, mode):
    with pytest.raises(InputError, match='working_mode'):
        function(POSE, Geometry(), mode)


@pytest.mark.parametrize('function', [
    inverse, jacobian, parallel_determinant,
    lambda R, g: forward_all(TH1, g), lambda R, g: estimate(TH1, 0.4, 1e-3, g),
    lambda R, g: forward_theta3a(TH1, 0.4, g), lambda R, g: forward_theta2a(TH1, 0.4, g)])
def test_what_is_not_a_geometry(function):
    with pytest.raises(InputError, match='geometry'):
        function(POSE, (0.7, 0.6, 0.3))


def test_other_options():
    with pytest.raises(InputError, match='sensors = 7'):
        jacobian(POSE, sensors=7)
    with pytest.raises(InputError, match="norm = 'inf'"):
        dexterity(POSE, norm='inf')
    with pytest.raises(InputError, match='margin'):
        track_mode(TH1, POSE, margin=0.0)
    with pytest.raises(InputError, match='norm 2'):
        matrix_from_quaternion([0.0, 0.0, 0.0, 2.0])
    with pytest.raises(InputError, match='shape'):
        matrix_from_quaternion(np.ones(3))


def test_a_nan_anywhere_in_a_batch_raises():
    th1 = np.ones((5, 3))
    th1[3, 1] = math.nan
    with pytest.raises(InputError, match=r'th1: entry \(3, 1\) is nan'):
        estimate(th1, np.ones(5), 1e-3)
