# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments of a wrong kind: every public function raises one clear line, or gives an answer."""

import decimal
import math
import warnings

import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import InputError, SpmError

POSE = kinematics.workspace_pose(0.1, 0.2, 0.4)
JOINTS = kinematics.inverse(POSE)
TH1 = JOINTS.theta1
TH2A = JOINTS.theta2a
TH3A = JOINTS.theta3a


class Foreign:
    """An object of another library that cannot become an array."""

    def __array__(self, *_, **__):
        raise RuntimeError('the tensor is on another device')

    def __repr__(self):
        raise RuntimeError('no description')


# What is no number, no array and no name in any argument.
SENSELESS = [
    'x',
    object(),
    {},
    [[1.0], [1.0, 2.0]],
    1j,
    math.nan,
    -math.inf,
    True,
    10**5000,
    decimal.Decimal(1),
    np.datetime64('2026-01-01'),
    (number for number in (1, 2, 3)),
    np.array(None),
    float,
    np.full((40, 3), 'x'),
    [[None] * 3] * 3,
    np.ma.masked,
    np.ma.array([1.0, 1.0, 1.0], mask=[0, 1, 0]),
    np.full(4, 1e200),
    np.full((3, 3), 1e200),
    np.full(4, np.longdouble('1e4000')),
    Foreign(),
]
# What has the wrong shape or size in most arguments.
UNUSUAL = [
    None,
    [],
    3.5,
    0,
    -1,
    1e-320,
    np.ones(2),
    np.ones((2, 2, 2)),
    np.zeros((0, 3)),
    np.zeros((0, 3, 3)),
    (1, 1, 1),
    [True] * 3,
    np.longdouble(1),
    [1e-3] * 4,
]
BUILT = {'geometry': kinematics.Geometry()}
AT_POSE = {'R': POSE, **BUILT, 'working_mode': (1, 1, 1)}
FUNCTIONS = {
    'estimate': {'th1': TH1, 'theta3a': TH3A, 'sigma': 1e-3, 'prior': POSE, **BUILT},
    'forward_all': {'th1': TH1, **BUILT},
    'inverse': AT_POSE,
    'parallel_determinant': AT_POSE,
    'forward_theta3a': {'th1': TH1, 'theta3a': TH3A, **BUILT},
    'forward_theta2a': {'th1': TH1, 'theta2a': TH2A, **BUILT},
    'jacobian': {**AT_POSE, 'sensors': 4},
    'dexterity': {**AT_POSE, 'sensors': 4},
    'track_mode': {'th1': TH1, 'last': POSE, **BUILT},
    'matrix_from_quaternion': {'q': [0.0, 0.0, 0.0, 1.0]},
    'quaternion_from_matrix': {'R': POSE},
    'zxz_from_matrix': {'R': POSE},
    'matrix_from_zxz': {'psi': 0.1, 'theta': 0.2, 'phi': 0.3},
    'workspace_pose': {'tilt': 0.1, 'azimuth': 0.2, 'phi': 0.3},
    'Geometry': {'alpha': 0.7, 'beta': 0.6, 'gamma': 0.3},
    'in_usual_frames': {**BUILT, 'nominal': kinematics.Geometry()},
}
CASES = [(function, name) for function, arguments in FUNCTIONS.items() for name in arguments]


def call(function, **changes):
    """Call a function with some arguments exchanged; a warning is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        return getattr(kinematics, function)(**{**FUNCTIONS.get(function, {}), **changes})


@pytest.mark.parametrize('function, name', CASES)
def test_senseless_arguments_raise_one_clear_line_and_unusual_ones_nothing_else(function, name):
    for index, value in enumerate(SENSELESS + UNUSUAL):
        error = None
        try:
            call(function, **{name: value})
        except SpmError as caught:
            error = caught
            assert '\n' not in str(error) and len(str(error)) < 400, (index, error)
        if index < len(SENSELESS):
            assert isinstance(error, InputError) and name in str(error), (index, error)


@pytest.mark.parametrize(
    'function, changes, match',
    [
        *(
            (function, {name: value}, 'rotation')
            for value in (1.001 * POSE, -POSE, np.zeros((3, 3)))
            for function, name in (
                ('inverse', 'R'),
                ('quaternion_from_matrix', 'R'),
                ('track_mode', 'last'),
                ('estimate', 'prior'),
            )
        ),
        *(
            ('jacobian', {'working_mode': mode}, 'working_mode')
            for mode in ((1, 1), (1, 1, 0), (1, 1, 2), '+++', (1, 1, '+'))
        ),
        *(
            ('dexterity', {'sensors': sensors}, 'sensors =')
            for sensors in (2, 7, 5.0, np.array(4))
        ),
        *(
            ('estimate', {'sigma': sigma}, 'sigma')
            for sigma in (
                0.0,
                -1e-3,
                9e-10,
                3.2,
                [1e-3] * 3,
                [1e-3] * 5,
                [1e-3, 1e-3, 1e-3, 1e-200],
                [1e-3, 1e-3, math.nan, 1e-3],
                np.full((2, 4), 1e-3),
            )
        ),
        *(
            ('UsedSensors', {'sigma': (1e-3,) * number, 'left_out': left_out}, match)
            for number, left_out, match in (
                (3, (), 'sigma'),
                (7, (), 'sigma'),
                (4, (0, 1), 'left_out'),
                (4, (4,), 'left_out'),
                (6, (0, 1, 2, 5), 'left_out'),
                (5, (-1,), 'left_out'),
            )
        ),
        (
            'estimate_sample',
            {
                'readings': (0.5,) * 4,
                **BUILT,
                'sensors': kinematics.UsedSensors((1e-3,) * 4, (1,)),
            },
            'prior',
        ),
        ('estimate', {'theta3c': 0.4}, 'theta3b = None: .* theta3c is given'),
        ('estimate', {'sigma': [1e-3] * 4, 'theta3b': 0.4}, 'sigma = .*: expected one .* or five'),
        (
            'estimate',
            {'sigma': [1e-3] * 5, 'theta3b': 0.4, 'theta3c': 0.4},
            'expected one .* or six',
        ),
        ('estimate', {'theta3b': math.nan}, 'theta3b: entry'),
        ('estimate', {'th1': [[1.0] * 3, [1.0, math.nan, 1.0]]}, r'th1: entry \(1, 1\) is n'),
        *(
            (function, {name: value}, r'-1100000.0, expected 1e\+06 or less in size')
            for function, name, value in (
                ('estimate', 'th1', np.full((20, 3), -1.1e6)),
                ('forward_theta2a', 'theta2a', -1.1e6),
                ('matrix_from_zxz', 'psi', -1.1e6),
            )
        ),
        ('forward_all', {'th1': [TH1, TH1]}, 'one triple'),
        *(
            ('Geometry', {name: value}, f'{name} = {value}.* rad')
            for name, value in (
                ('alpha', 0.0),
                ('beta', math.pi),
                ('gamma', -0.3),
                ('alpha', 39.3),
            )
        ),
        *(
            ('singularity_locus', {'phi': 0.8, 'half_angle': 0.3, name: value}, name)
            for name, value in (
                ('half_angle', [0.1]),
                ('half_angle', 0.0),
                ('half_angle', -0.1),
                ('half_angle', 3.2),
                ('phi', [0.1, 0.2]),
                ('phi', 'x'),
                ('half_angle', math.nan),
            )
        ),
        *(
            (
                function,
                {first: np.ones((4, 3) if first == 'th1' else 4), second: other},
                rf'{first}, .*{second}.*\(4,\).*\(5,\)',
            )
            for function, first, second, other in (
                ('estimate', 'th1', 'theta3a', np.ones(5)),
                ('estimate', 'th1', 'prior', np.broadcast_to(POSE, (5, 3, 3))),
                ('forward_theta3a', 'th1', 'theta3a', np.ones(5)),
                ('workspace_pose', 'tilt', 'azimuth', np.ones(5)),
                ('matrix_from_zxz', 'psi', 'theta', np.ones(5)),
            )
        ),
    ],
)
def test_what_is_refused_by_name_and_value(function, changes, match):
    with pytest.raises(InputError, match=match):
        call(function, **changes)


@pytest.mark.parametrize('sigma', [1e-9, math.pi, [1e-9, 1e-9, 1e-9, 1e-9]])
def test_the_extreme_standard_deviations_give_the_pose(sigma):
    found = kinematics.estimate(TH1, TH3A, sigma, prior=POSE)
    np.testing.assert_allclose(found.rotation, POSE, atol=1e-9)
    assert np.isfinite(found.covariance).all()


def test_empty_batches_give_empty_results():
    found = kinematics.estimate(np.empty((0, 3), np.float32), np.empty(0), 1e-3)
    assert found.rotation.shape == (0, 3, 3)
    assert found.consistent.shape == (0,)
    assert kinematics.inverse(np.empty((0, 3, 3))).theta1.shape == (0, 3)
