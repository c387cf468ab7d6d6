# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of simulated rigs compares a calibration with the true parameters of its rig."""

from types import SimpleNamespace

from free_motions import DEVIATIONS, RIG, short_calibration, short_motion
import numpy as np
import pytest
from spm_haptic_master.calibration.motion.model import Layout
from spm_haptic_master.simulation.rig import random_rig


@pytest.fixture
def rigs():
    return pytest.importorskip('benchmarks.calibration')


@pytest.mark.parametrize('number', [3, 4])
def test_the_true_parameters_are_those_of_the_rigs_mechanism(rigs, number):
    rig = random_rig(number, DEVIATIONS)
    layout = Layout(4)
    true = rigs.truth(SimpleNamespace(layout=layout), rig, np.zeros(4))
    found = layout.geometry(true)
    for name in ('base_axes', 'platform_axes', 'alphas', 'betas'):
        np.testing.assert_allclose(getattr(found, name), getattr(rig.geometry, name), atol=1e-9)


def test_no_bound_of_a_calibration_is_exceeded_by_its_rig(rigs):
    found = short_calibration()
    zeros = short_motion()[3]
    assert 0.05 < rigs.exceeded(found, RIG, zeros) < 1.0
    assert 0.05 < rigs.parity_exceeded(found, RIG, zeros) < 1.0
