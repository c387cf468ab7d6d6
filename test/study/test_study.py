# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The study's room: rates of nine joints, an independent model's table, the page."""

from itertools import permutations
from math import inf
import re

from built_mechanism import nominal
from harness import ROOT
import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION

pytest.importorskip('matplotlib')

from study import __main__ as command  # noqa: E402, I100
from study import nine_joints, placement, protection_maps  # noqa: E402

PAPER = kinematics.Geometry()
PAGE = ROOT / 'docs' / 'sensors' / 'README.md'
POSES = kinematics.workspace_pose(
    tilt=np.array([0.0, 0.1, 0.25]),
    azimuth=np.array([0.0, 2.0, 4.0]),
    phi=np.array([0.5, 1.1, 0.3]),
)


def test_rates_of_nine_joints_add_up_to_the_platforms_turn():
    joints = nine_joints.rates(POSES, PAPER)
    assert len(joints) == 9
    for row, R in enumerate(POSES):
        first = np.array(PAPER.base_axes)
        second = nominal().second_axes(kinematics.inverse(R).theta1)
        third = nominal().third_axes(R)
        for leg, name in enumerate('ABC'):
            total = np.outer(first[leg], joints[f'1{name}'][row])
            total += np.outer(second[leg], joints[f'2{name}'][row])
            total += np.outer(third[leg], joints[f'3{name}'][row])
            np.testing.assert_allclose(total, np.eye(3), atol=1e-12)


@pytest.mark.parametrize('sensors', placement.REFERENCE)
def test_the_table_of_an_independent_model(sensors):
    rates = nine_joints.rates(placement.table_poses(), PAPER)
    found = placement.figures_of(nine_joints.worth(rates, sensors))
    reference = placement.REFERENCE[sensors]
    assert placement.agrees(found, reference)
    # A tenth more or less of any figure is none of that model's.
    for part, row in enumerate(reference):
        for number, value in enumerate(row):
            if value is not None and 0.1 < value < inf:
                other = [list(each) for each in found]
                other[part][number] *= 1.1
                assert not placement.agrees(other, reference)


def largest_isolable_step(sample, threshold):
    """Return the step, rad, of which any other sensor's fault leaves the threshold unexplained."""
    gains = np.array(sample.parity_gains)
    left = []
    for gain, other in permutations(gains, 2):
        explained = other * (gain @ other) / (other @ other)
        left.append(np.linalg.norm(gain - explained))
    least = min(left)
    if least <= 1e-6 / sample.sensors.largest:
        return inf
    return threshold / least


@pytest.mark.parametrize('number', [4, 5, 6])
def test_it_is_what_the_supervision_computes(number):
    sigma = (float(np.radians(nine_joints.SIGMA)),) * number
    rates = nine_joints.rates(POSES, PAPER)
    found = nine_joints.worth(rates, protection_maps.SETS[number])
    root = np.sqrt(nine_joints.WINDOW)
    of_noise = (nine_joints.FALSE_ALARM + MISSED_DETECTION) / root
    of_bias = nine_joints.BIAS / nine_joints.SIGMA * np.sqrt(number)
    for row, R in enumerate(POSES):
        joints = kinematics.inverse(R)
        passive = (joints.theta3a, joints.theta3b, joints.theta3c)
        angles = (*joints.theta1.tolist(), *map(float, passive))[:number]
        sample = kinematics.estimate_sample(angles, kinematics.UsedSensors(sigma), PAPER)
        worth = integrity(sample, (0.0,) * number, (1.0,) * number)
        level = np.degrees(max(worth.slopes)) * (of_noise + of_bias)
        deviation = np.degrees(worth.deviation)
        step = np.degrees(largest_isolable_step(sample, nine_joints.ISOLATION / root))
        assert found.levels[row] == pytest.approx(level, rel=1e-6)
        assert found.deviations[row] == pytest.approx(deviation, rel=1e-6)
        assert found.steps[row] == pytest.approx(step, rel=1e-4)


def test_poses_out_of_reach_have_no_worth():
    poses = np.stack([POSES[0], kinematics.workspace_pose(1.2, 0.0, 0.5)])
    found = nine_joints.worth(nine_joints.rates(poses, PAPER), protection_maps.SETS[5])
    for values in (found.levels, found.steps, found.deviations):
        assert np.isfinite(values[0])
        assert np.isnan(values[1])


@pytest.mark.evidence
def test_the_study_writes_its_page_and_pictures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(protection_maps.sections, '__defaults__', (8, 12))
    monkeypatch.setattr(placement.sections, '__defaults__', (4, 8))
    monkeypatch.setattr(command, 'DEFAULT_OUTPUT', tmp_path)
    assert command.main(['--accept']) == 0
    text = (tmp_path / 'README.md').read_text(encoding='utf-8')
    pictures = {path.name for path in tmp_path.glob('*.png')}
    assert len(pictures) == 6
    assert set(re.findall(r'\]\((\S+\.png)\)', text)) == pictures
    assert 'six sensors | everywhere' in text
    assert str(tmp_path / 'README.md') in capsys.readouterr().out


def test_the_page_in_the_repository_is_current():
    text = PAGE.read_text(encoding='utf-8')
    joints = nine_joints.rates(placement.table_poses(), PAPER)
    assert placement.comparison(joints) in text, 'run `make study`'
