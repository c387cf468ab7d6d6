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


def test_every_limit_of_the_page_holds_and_its_numbers_are_current(tmp_path):
    page = PAGE.read_text()
    found = verdicts.read(page)
    assert len(found) == 23
    assert set(found.values()) == {'holds'}
    assert statics_pictures.motor_torque(tmp_path / 'torque.png') in page
    assert statics_pictures.fade(tmp_path / 'fade.png') in page
    assert f'torque is zero {dynamics_pictures.loss(tmp_path / "loss.png")} after' in page


@pytest.mark.slow
@pytest.mark.parametrize('latency', [1, 2, 3])
def test_the_largest_stable_stiffness_is_half_the_law_or_more(latency):
    """About roll, with a damping of 0.005 N m s/rad over 10 ms."""
    law = (dynamics_pictures.FRICTION + 0.005) / ((0.5 + latency) * 1e-3)
    assert dynamics_pictures.stiffest(latency, 0.005) >= 0.5 * law
