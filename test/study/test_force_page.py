# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of force feedback: its numbers are those of the room."""

from harness import ROOT
import pytest

pytest.importorskip('matplotlib')
pytest.importorskip('mujoco')

from paper import verdicts  # noqa: E402, I100
from study.force import dynamics_pictures, statics_pictures  # noqa: E402, I100

PAGE = ROOT / 'docs' / 'force' / 'README.md'


def test_every_limit_of_the_page_holds():
    found = verdicts.read(PAGE.read_text())
    assert len(found) == 16 and set(found.values()) == {'holds'}


def test_numbers_of_the_statics_are_those_of_the_page(tmp_path):
    page = PAGE.read_text()
    assert statics_pictures.motor_torque(tmp_path / 'torque.png') in page
    assert statics_pictures.fade(tmp_path / 'fade.png') in page


def test_the_loss_of_a_wrench_is_that_of_the_page(tmp_path):
    assert f'torque is zero {dynamics_pictures.loss(tmp_path / "loss.png")} after' in (
        PAGE.read_text())


@pytest.mark.slow
@pytest.mark.parametrize('latency', [1, 2, 3])
def test_the_largest_stable_stiffness_is_half_the_law_or_more(latency):
    """About roll, with a damping of 0.005 N m s/rad over 10 ms."""
    law = (dynamics_pictures.FRICTION + 0.005) / ((0.5 + latency) * 1e-3)
    assert dynamics_pictures.stiffest(latency, 0.005) >= 0.5 * law
