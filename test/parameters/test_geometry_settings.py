# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mechanism from parameters: nominal, as built, and what cannot be a mechanism."""

from built_mechanism import random_built
import numpy as np
import pytest
from rig_as_built import mechanism
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.parameters import geometry
from spm_haptic_master.parameters.setting import complete

NOMINAL_BASE = list(geometry.NOMINAL_BASE)


def values(**given):
    """Return checked values; in names, __ stands for a dot."""
    return complete(
        geometry.MECHANISM_SETTINGS,
        {name.replace('__', '.'): value for name, value in given.items()},
    )


def test_missing_values_are_those_of_the_nominal_mechanism_of_the_paper():
    nominal = Geometry()
    for given in {}, {'geometry__base_axes': [0, 0, 1, 1, 0, 0, 0, 1, 0]}:
        assert repr(geometry.geometry_from(values(**given))) == repr(nominal)
    assert geometry.geometry_from(
        values(geometry__alpha_deg=40.0, geometry__gamma_deg=20.0)
    ) == Geometry(np.radians(40.0), nominal.beta, np.radians(20.0))
    found = geometry.geometry_from(
        values(geometry__proximal_deg=[39.0, 0.0, 39.5], geometry__beta_deg=35.0)
    )
    assert found.alphas == (np.radians(39.0), nominal.alpha, np.radians(39.5))
    assert found.betas == (np.radians(35.0),) * 3
    np.testing.assert_array_equal(found.base_axes, nominal.base_axes)
    np.testing.assert_allclose(found.platform_axes, nominal.platform_axes, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        (
            {'geometry__base_axes': [*NOMINAL_BASE[:8], 1.0]},
            r"'geometry.base_axes' .* row 2 = \[0.0, 1.0, 1.0\] has length 1.41421356",
        ),
        (
            {'geometry__platform_axes': [0.0, 0.1, 0.99, *NOMINAL_BASE[3:]]},
            "'geometry.platform_axes' .* row 0 = .* has length",
        ),
        (
            {'geometry__base_axes': [*NOMINAL_BASE[:6], 0.0, -1.0, 0.0]},
            "'geometry.base_axes' .* opposite",
        ),
        # Links that do not reach from Z1k to Z3k at the workspace's centre, 36.5 deg.
        (
            {'geometry__alpha_deg': 70.8},
            "'geometry.alpha_deg' is 70.8; .* assembled at the workspace's centre: there "
            'Z1A and Z3A are '
            '36.5[34] deg apart, and links of 70.8 and 34.1 deg span 36.70 to 104.90 deg',
        ),
        (
            {'geometry__proximal_deg': [39.3, 2.0, 39.3]},
            r"'geometry.proximal_deg' is \[39.3, 2.0, 39.3\]; .* Z1B and Z3B .* span 32.10 "
            r'to 36.10 deg',
        ),
        (
            {'geometry__distal_deg': [34.1, 34.1, 80.0]},
            r"'geometry.distal_deg' is \[34.1, 34.1, 80.0\]; .* Z1C and Z3C .* span 40.70 "
            r'to 119.30 deg',
        ),
        (
            {'geometry__platform_axes': [0, 0, 1, 1, 0, 0, 0, 1, 0]},
            "'geometry.platform_axes' .* Z1B and Z3B are 135.00 deg apart",
        ),
        # Of several: the one without which it could be assembled, or else the last.
        (
            {'geometry__gamma_deg': 155.0, 'geometry__proximal_deg': [34.1, 39.3, 39.3]},
            "'geometry.gamma_deg' is 155.0",
        ),
        (
            {'geometry__alpha_deg': 20.0, 'geometry__distal_deg': [34.1, 2.0, 80.0]},
            r"'geometry.distal_deg' is \[34.1, 2.0, 80.0\]; .* Z1B and Z3B .* 20 and 2 deg",
        ),
    ],
)
def test_values_that_form_no_mechanism_are_refused(given, expected):
    with pytest.raises(SettingError, match=expected) as error:
        geometry.geometry_from(values(**given))
    assert '\n' not in str(error.value)


def test_every_mechanism_near_the_nominal_one_can_be_assembled():
    rng = np.random.default_rng(13)
    for _ in range(30):
        drawn = random_built(rng)
        alpha = np.degrees(drawn.alpha).tolist()
        beta = np.degrees(drawn.beta).tolist()
        assert geometry.geometry_from(
            values(
                geometry__proximal_deg=alpha,
                geometry__distal_deg=beta,
                geometry__base_axes=np.ravel(drawn.base).tolist(),
                geometry__platform_axes=np.ravel(drawn.platform).tolist(),
            )
        ) == Geometry.from_axes(drawn.base, drawn.platform, np.radians(alpha), np.radians(beta))


def test_the_checksum_is_that_of_the_mechanism():
    nominal = geometry.mechanism_checksum(values())
    assert len(nominal) == 8
    assert int(nominal, 16) >= 0
    # However it is given.
    assert geometry.mechanism_checksum(values(geometry__proximal_deg=[39.3] * 3)) == nominal
    different = [
        {'geometry__alpha_deg': 39.30001},
        {'geometry__distal_deg': [34.1, 34.1, 34.10001]},
        {'geometry__base_axes': [0, 0, 1, 1, 0, 0, 0, 1, 1e-6]},
        {'geometry__gamma_deg': 18.20001},
        {'working_mode': [1, 1, -1]},
        mechanism(),
    ]
    found = {geometry.mechanism_checksum(values(**given)) for given in different}
    assert len(found | {nominal}) == len(different) + 1
