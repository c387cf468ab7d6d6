# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's room: each topic's results, and the page in the repository."""

from importlib import import_module
import os
import re

from disturbance import Disturbance
from harness import ROOT
import numpy as np
import pytest

pytest.importorskip('matplotlib')
pytest.importorskip('mujoco')

from paper import rig_experiment, rig_figures  # noqa: E402, I100
import paper.errata  # noqa: E402
from paper.figure_entry import Verdict  # noqa: E402
import paper.sensor_placement  # noqa: E402
import paper.solve_times  # noqa: E402
from spm_haptic_master.exceptions import SpmError  # noqa: E402
from spm_haptic_master.kinematics import zxz_from_matrix  # noqa: E402
from spm_haptic_master.validation.comparison import orientation_of_markers  # noqa: E402

PAGE = ROOT / 'docs' / 'paper' / 'README.md'
PICTURE_LIMIT = 200_000  # bytes


def check(entries, out):
    """Each entry has its texts and its picture, and no computed condition fails."""
    for entry in entries:
        assert entry.shows
        assert entry.here
        assert entry.verdict is not Verdict.DIFFERS, f'{entry.name}: {entry.here}'
        if entry.picture:
            assert 5_000 < (out / entry.picture).stat().st_size < PICTURE_LIMIT
    return {entry.figures: entry for entry in entries}


def test_page_has_every_figure_of_the_paper():
    text = PAGE.read_text(encoding='utf-8')
    headings = re.findall(r'^## Figs?\. ([\d, ]+):', text, re.MULTILINE)
    assert {int(each) for each in ', '.join(headings).split(', ')} == set(range(1, 35))
    assert '## Section 5: Calculation times' in text
    for section in text.split('\n## ')[2:-1]:
        assert '- **The paper:**' in section
        assert '- **Here:**' in section


@pytest.mark.evidence
@pytest.mark.parametrize(
    ('topic', 'options', 'words'),
    [
        # Equation 5 belongs to 90 deg: a misprint.
        (
            'geometry_figures',
            {},
            {
                (4,): ['misprint.', '15 of the 15'],
                (5,): ['-21.8165', '137.1047'],
                (8,): ['49.358592', '63.577'],
            },
        ),
        ('dexterity_maps', {'circles': 26, 'rays': 72}, {(6,): ['0.0070', '0.101']}),
        ('mode_branches', {'step': 0.1}, {(10,): ['φ = 49.36 and 49.36 deg']}),
        (
            'scenarios',
            {'step': 0.1},
            {(18, 19, 20, 21): [r'improved FKM \| [\d.]+e-1[3-9]'], (23, 24, 25, 26): ['0.009']},
        ),
    ],
)
def test_a_topic_finds_what_is_on_its_page(tmp_path, topic, options, words):
    found = check(import_module(f'paper.{topic}').entries(tmp_path, **options), tmp_path)
    for figures, each in words.items():
        text = f'{found[figures].verdict.value}. {found[figures].here} {found[figures].details}'
        assert [word for word in each if not re.search(word, text)] == []


@pytest.mark.evidence
def test_monte_carlo(tmp_path):
    found = check(paper.sensor_placement.entries(tmp_path, small=100, large=2000), tmp_path)
    assert found[13,].verdict is Verdict.AGREES
    assert paper.sensor_placement.first_order(np.radians(50.0)) == pytest.approx(2.9, abs=0.1)
    case2, estimate = (
        float(re.search(name + r', n = 2,000 \| ([\d.]+)', found[13, 14].details)[1])
        for name in (r'Case 2 \(th3A\)', 'estimate')
    )
    assert estimate < 0.9 * case2


def test_velocity_signs_of_the_print():
    printed, turned = paper.errata.velocity_signs()
    assert printed > 0.1
    assert turned < 1e-5


def test_times():
    (entry,) = paper.solve_times.entries(rounds=3)
    assert 'Python' in entry.here
    assert '> 100 ms' in entry.details
    assert os.uname().nodename not in entry.here


def test_simulated_capture_errs_by_less_than_a_degree():
    coordinates, truth = rig_experiment.capture(20.0)
    found = rig_experiment.FRAME.T @ orientation_of_markers(coordinates, rig_experiment.AZIMUTHS)
    error = np.degrees(np.abs(zxz_from_matrix(found)[2] - zxz_from_matrix(truth)[2]))
    assert 0.1 < error.max() < rig_figures.CAPTURE_LIMIT


@pytest.mark.process
@pytest.mark.alone
@pytest.mark.evidence
def test_experiment_on_simulated_hardware(tmp_path):
    with Disturbance() as machine:
        experiment = rig_experiment.run(tmp_path, 4.0)
    # The kernel drops datagrams of a reader that a busy machine keeps waiting.
    machine.expect(len(experiment.joints.time) >= 0.98 * rig_experiment.RATE * 4.0)
    errors = {(row['model'], row['quantity']): row for row in experiment.errors}
    assert float(errors['improved', 'phi']['max_deg']) < rig_figures.CAPTURE_LIMIT
    assert float(errors['classic', 'phi']['rms_deg']) > 3.0 * float(
        errors['improved', 'phi']['rms_deg']
    )
    entries = rig_figures._compared(experiment)
    assert [entry.figures for entry in entries] == [(32,), (33,), (34,)]


def test_a_gap_in_the_recording_is_no_step_of_a_model():
    """A busy machine loses samples: what moved meanwhile is no jump."""
    columns = {
        'capture_time': np.array([0.0, 0.01, 0.02, 0.12, 0.13]),
        'improved_phi_deg': np.array([1.0, 1.1, 1.3, 4.0, 4.1]),
    }
    assert rig_figures._largest_step(columns, 'improved_phi_deg') == pytest.approx(0.2)


@pytest.mark.process
@pytest.mark.evidence
def test_the_jig_determines_zeros_and_directions(tmp_path):
    """One simulated encoder turns backwards: a single pose would hide it in its zero count."""
    found = rig_experiment.calibrate(tmp_path)
    assert -1 in found['true']['encoders.direction']
    for name in ('encoders.direction', 'encoders.zero_count'):
        assert list(found['found'][name]) == list(found['true'][name])
    assert all(found['found']['encoders.direction_verified'])
    assert rig_figures._calibration(found).verdict is Verdict.AGREES


@pytest.mark.process
def test_experiment_reports_which_program_failed(tmp_path, monkeypatch):
    monkeypatch.setattr(rig_experiment, 'RATE', 0.0)
    with pytest.raises(SpmError, match="ended with 1: .*parameter 'rate' is 0.0"):
        rig_experiment.run(tmp_path, seconds=0.1)
