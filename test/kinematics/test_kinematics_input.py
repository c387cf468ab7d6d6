# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments of a wrong kind: every public function raises one clear line, or gives an answer."""

import decimal
import math
import warnings

import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError, SpmError
from spm_haptic_master.kinematics import (
    dexterity,
    estimate,
    estimate_sample,
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
    singularity_locus,
    track_mode,
    UsedSensors,
    workspace_pose,
    zxz_from_matrix,
)

POSE = workspace_pose(0.1, 0.2, 0.4)
JOINTS = inverse(POSE)
TH1, TH2A, TH3A = JOINTS.theta1, JOINTS.theta2a, JOINTS.theta3a
MODE = (1, 1, 1)


class Foreign:
    """An object of another library that cannot become an array."""

    def __array__(self, *_, **__):
        raise RuntimeError('the tensor is on another device')

    def __repr__(self):
        raise RuntimeError('no description')


# What is no number, no array and no name in any argument.
SENSELESS = [
    'x', object(), {}, [[1.0], [1.0, 2.0]], 1j, math.nan, -math.inf, True, 10 ** 5000,
    decimal.Decimal(1), np.datetime64('2026-01-01'), (number for number in (1, 2, 3)),
    np.array(None), float, np.full((40, 3), 'x'), [[None] * 3] * 3, np.ma.masked,
    np.ma.array([1.0, 1.0, 1.0], mask=[0, 1, 0]), np.full(4, 1e200), np.full((3, 3), 1e200),
    np.full(4, np.longdouble('1e4000')), Foreign()]
# What has the wrong shape or size in most arguments.
UNUSUAL = [
    None, [], 3.5, 0, -1, 1e-320, np.ones(2), np.ones((2, 2, 2)), np.zeros((0, 3)),
    np.zeros((0, 3, 3)), (1, 1, 1), [True] * 3, np.longdouble(1), [1e-3] * 4]
BUILT = {'geometry': Geometry()}
AT_POSE = {'R': POSE, **BUILT, 'working_mode': MODE}
FUNCTIONS = [
    (estimate, {'th1': TH1, 'theta3a': TH3A, 'sigma': 1e-3, 'prior': POSE, **BUILT}),
    (forward_all, {'th1': TH1, **BUILT}), (inverse, AT_POSE), (parallel_determinant, AT_POSE),
    (forward_theta3a, {'th1': TH1, 'theta3a': TH3A, **BUILT}),
    (forward_theta2a, {'th1': TH1, 'theta2a': TH2A, **BUILT}),
    (jacobian, {**AT_POSE, 'sensors': 4}), (dexterity, {**AT_POSE, 'sensors': 4}),
    (track_mode, {'th1': TH1, 'last': POSE, **BUILT}),
    (matrix_from_quaternion, {'q': [0.0, 0.0, 0.0, 1.0]}), (quaternion_from_matrix, {'R': POSE}),
    (zxz_from_matrix, {'R': POSE}), (matrix_from_zxz, {'psi': 0.1, 'theta': 0.2, 'phi': 0.3}),
    (workspace_pose, {'tilt': 0.1, 'azimuth': 0.2, 'phi': 0.3}),
    (Geometry, {'alpha': 0.7, 'beta': 0.6, 'gamma': 0.3})]
CASES = [(function, arguments, name) for function, arguments in FUNCTIONS for name in arguments]


def outcome(function, arguments, name, value):
    """Return the error of a call with one argument exchanged, or None; a warning is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        try:
            function(**{**arguments, name: value})
        except SpmError as error:
            return error
    return None


@pytest.mark.parametrize('function, arguments, name', CASES)
def test_senseless_arguments_raise_one_clear_line_and_unusual_ones_nothing_else(
        function, arguments, name):
    for index, value in enumerate(SENSELESS + UNUSUAL):
        error = outcome(function, arguments, name, value)
        if error is not None:
            assert '\n' not in str(error) and len(str(error)) < 400, (index, error)
        if index >= len(SENSELESS):
            continue
        assert isinstance(error, InputError) and name in str(error), (index, error)


@pytest.mark.parametrize('call, match', [
    *((lambda R=R, function=function: function(R), 'rotation')
      for R in (1.001 * POSE, -POSE, np.zeros((3, 3)))
      for function in (inverse, quaternion_from_matrix, lambda R: track_mode(TH1, R),
                       lambda R: estimate(TH1, TH3A, 1e-3, prior=[R]))),
    *((lambda mode=mode: jacobian(POSE, working_mode=mode), 'working_mode')
      for mode in ((1, 1), (1, 1, 0), (1, 1, 2), '+++', (1, 1, '+'))),
    *((lambda sensors=sensors: dexterity(POSE, sensors=sensors), 'sensors =')
      for sensors in (2, 7, 5.0, np.array(4))),
    *((lambda sigma=sigma: estimate(TH1, TH3A, sigma), 'sigma') for sigma in (
        0.0, -1e-3, 9e-10, 3.2, [1e-3] * 3, [1e-3] * 5, [1e-3, 1e-3, 1e-3, 1e-200],
        [1e-3, 1e-3, math.nan, 1e-3], np.full((2, 4), 1e-3))),
    *((lambda number=number, left_out=left_out: UsedSensors((1e-3,) * number, left_out), match)
      for number, left_out, match in (
          (3, (), 'sigma'), (7, (), 'sigma'), (4, (0, 1), 'left_out'), (4, (4,), 'left_out'),
          (6, (0, 1, 2, 5), 'left_out'), (5, (-1,), 'left_out'))),
    (lambda: estimate_sample((0.5,) * 4, UsedSensors((1e-3,) * 4, (1,)), Geometry()), 'prior'),
    (lambda: estimate(TH1, TH3A, 1e-3, theta3c=0.4), 'theta3b = None: .* theta3c is given'),
    (lambda: estimate(TH1, TH3A, [1e-3] * 4, theta3b=0.4), 'sigma = .*: expected one .* or five'),
    (lambda: estimate(TH1, TH3A, [1e-3] * 5, theta3b=0.4, theta3c=0.4), 'expected one .* or six'),
    (lambda: estimate(TH1, TH3A, 1e-3, theta3b=math.nan), 'theta3b: entry'),
    (lambda: estimate([[1.0] * 3, [1.0, math.nan, 1.0]], 1.0, 1e-3), r'th1: entry \(1, 1\) is n'),
    *((call, r'-1100000.0, expected 1e\+06 or less in size') for call in (
        lambda: estimate(np.full((20, 3), -1.1e6), 0.4, 1e-3),
        lambda: forward_theta2a(TH1, -1.1e6), lambda: matrix_from_zxz(-1.1e6, 0.1, 0.2))),
    (lambda: forward_all([TH1, TH1]), 'one triple'),
    *((lambda name=name, value=value: singularity_locus(
        **{'phi': 0.8, 'half_angle': 0.3, name: value}), name) for name, value in (
            ('half_angle', [0.1]), ('half_angle', 0.0), ('half_angle', -0.1), ('half_angle', 3.2),
            ('phi', [0.1, 0.2]), ('phi', 'x'), ('half_angle', math.nan))),
    (lambda: estimate(np.ones((4, 3)), np.ones(5), 1e-3),
     r'th1, theta3a, prior: .*\(4,\).*\(5,\)'),
    *((call, r'\(4,\).*\(5,\)') for call in (
        lambda: forward_theta3a(np.ones((4, 3)), np.ones(5)),
        lambda: estimate(np.ones((4, 3)), 1.0, 1e-3, prior=np.broadcast_to(POSE, (5, 3, 3))),
        lambda: workspace_pose(np.ones(4), np.ones(5), 0.0),
        lambda: matrix_from_zxz(np.ones(4), np.ones(5), 0.0)))])
def test_what_is_refused_by_name_and_value(call, match):
    with pytest.raises(InputError, match=match):
        call()


@pytest.mark.parametrize('sigma', [1e-9, math.pi, [1e-9, 1e-9, 1e-9, 1e-9]])
def test_the_extreme_standard_deviations_give_the_pose(sigma):
    found = estimate(TH1, TH3A, sigma, prior=POSE)
    np.testing.assert_allclose(found.rotation, POSE, atol=1e-9)
    assert np.isfinite(found.covariance).all()


def test_empty_batches_give_empty_results():
    found = estimate(np.empty((0, 3), np.float32), np.empty(0), 1e-3)
    assert found.rotation.shape == (0, 3, 3) and found.consistent.shape == (0,)
    assert inverse(np.empty((0, 3, 3))).theta1.shape == (0, 3)
