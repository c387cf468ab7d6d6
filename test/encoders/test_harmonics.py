# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Harmonics of an encoder: from the joint angle to the reading, and from the counts back."""

from dataclasses import replace
from math import pi, radians

from encoder_frames import LAYOUTS, values
import numpy as np
import pytest
from spm_haptic_master.encoders.decoder_factory import make_harmonics, make_layouts
from spm_haptic_master.encoders.harmonics import Harmonics
from spm_haptic_master.exceptions import SettingError

ANGLES = np.random.default_rng(13).uniform(-9.0, 9.0, 5000)
FIRST = radians(0.4), radians(-0.3)


def series(angles, *amplitudes):
    """Return the sum of (order, cosine, sine) at angles, by its definition."""
    return sum(
        cosine * np.cos(order * angles) + sine * np.sin(order * angles)
        for order, cosine, sine in amplitudes
    )


@pytest.mark.parametrize('count', [5, 7, 8, 360])
def test_a_table_is_exact_for_the_orders_below_half_its_length(count):
    amplitudes = [
        (0, 0.002, 0.0),
        (1, 1e-3, -2e-3),
        (2, -3e-3, 1e-3),
        *([(3, 1e-3, 5e-4)] if count > 6 else []),
    ]
    table = series(np.arange(count) * 2.0 * pi / count, *amplitudes)
    found = Harmonics(*FIRST, tuple(table)).readings(ANGLES)
    np.testing.assert_allclose(
        found, ANGLES + series(ANGLES, (1, *FIRST), *amplitudes), rtol=0.0, atol=1e-9
    )
    # The order of half the length is a cosine.
    np.testing.assert_allclose(
        Harmonics(table=(1e-3, -1e-3) * 3).readings(ANGLES),
        ANGLES + 1e-3 * np.cos(3 * ANGLES),
        rtol=0.0,
        atol=1e-9,
    )


def test_without_a_table_there_is_the_first_order_alone():
    found = Harmonics(*FIRST).readings(ANGLES)
    expected = ANGLES + series(ANGLES, (1, *FIRST))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)


def test_angles_and_readings_are_inverse():
    harmonics = Harmonics(0.1, -0.05, tuple(np.random.default_rng(1).normal(0.0, 0.005, 16)))
    np.testing.assert_allclose(
        harmonics.angles(harmonics.readings(ANGLES)), ANGLES, rtol=0.0, atol=1e-7
    )
    assert harmonics.angles(0.3).shape == ()


@pytest.mark.parametrize('per_turn', [4096, 16384, 36000, 65536, 1 << 20])
@pytest.mark.parametrize('direction', [1, -1])
def test_counts_become_the_joint_angle(per_turn, direction):
    harmonics = Harmonics(*FIRST, (0.0, 2e-3, 0.0, -2e-3, 0.0))
    layout = replace(
        LAYOUTS[0],
        counts_per_turn=per_turn,
        zero_count=per_turn // 3,
        direction=direction,
        harmonics=harmonics,
    )
    angles = np.linspace(-pi, pi, 997)
    readings = harmonics.readings(angles)
    counts = np.round(layout.zero_count + direction * readings * per_turn / (2.0 * pi))
    found = np.array([layout.angle(int(each) % per_turn) for each in counts])
    # A frame has the counts of the reading, not of the angle.
    assert counts[0] % per_turn == layout.counts(layout.data(-pi))
    # Half a count, and half an entry of the table: 2.4e-5 deg for a slope of 1 %.
    apart = (found - angles + pi) % (2.0 * pi) - pi
    assert np.abs(apart).max() <= 1.02 * pi / per_turn + 1e-6
    assert (-pi < found).all()
    assert (found <= pi).all()


def test_no_harmonics_by_default_and_none_where_they_are_zero():
    assert make_harmonics(values()) == (None,) * 4
    found = make_harmonics(
        values(
            encoders__harmonic_sin_deg=[0.0, 0.1, 0.0, 0.0],
            encoders__table_deg__joint_3a=[0.01, 0.0, 0.0, 0.0, 0.0],
        )
    )
    assert found[0] is None
    assert found[2] is None
    assert found[1] == Harmonics(0.0, radians(0.1))
    assert found[3] == Harmonics(table=(radians(0.01), 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ('overrides', 'expected'),
    [
        (
            {'encoders__harmonic_sin_deg': [0.0, 11.0, 0.0, 0.0]},
            "'encoders.harmonic_sin_deg' .*11.0",
        ),
        (
            {'encoders__table_deg__joint_1b': [0.1]},
            r"'encoders.table_deg.joint_1b' is \[0.1\]; .* joint_1b \(a table of 1 values, "
            r'expected 5 ',
        ),
        ({'encoders__table_deg__joint_1b': [0.1] * 4}, 'a table of 4 values'),
        ({'encoders__table_deg__joint_1b': [0.1] * 4097}, 'a table of 4097 values'),
        (
            {'encoders__table_deg__joint_3a': [5.0, -5.0] * 20},
            r"'encoders.table_deg.joint_3a' .* joint_3a \(near a joint angle of .* deg the "
            r'reading does '
            'not increase with the angle, expected one that is monotonic',
        ),
    ],
)
def test_harmonics_that_no_encoder_has_are_refused(overrides, expected):
    with pytest.raises(SettingError, match=expected) as error:
        make_layouts(values(**{name: tuple(value) for name, value in overrides.items()}))
    assert '\n' not in str(error.value)
