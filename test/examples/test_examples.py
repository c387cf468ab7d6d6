# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each example does what its page promises; README shows the shortest one."""

import re
from runpy import run_path
import sys

from harness import ROOT
from mechanism import SINGULAR_PHI
import numpy as np
import pytest
from spm_haptic_master.encoders.recording_files import Table
from spm_haptic_master.kinematics import inverse, workspace_pose
from spm_haptic_master.kinematics.joints import JOINT_NAMES

EXAMPLES = ROOT / 'examples'
PYTHON = re.compile(r'^```python\n(.*?)^```', re.MULTILINE | re.DOTALL)


def run(monkeypatch, name, *arguments):
    """Run an example as a script; return its names."""
    monkeypatch.setattr(sys, 'argv', [name, *map(str, arguments)])
    return run_path(str(EXAMPLES / name), run_name='__main__')


def test_the_kinematics_example_finds_its_pose_and_readme_has_its_lines(monkeypatch, capsys):
    names = run(monkeypatch, 'kinematics.py')
    R = names['R']
    fit = names['fit']
    dexterity = names['dexterity']
    deviation = np.degrees(np.sqrt(fit.covariance.max()))
    np.testing.assert_allclose(fit.rotation, R, rtol=0.0, atol=1e-9)
    assert 0.01 < deviation < 0.1
    assert dexterity(R) < 0.01
    assert dexterity(R, sensors=4) > 0.01
    (block,) = PYTHON.findall((ROOT / 'README.md').read_text())
    example = (EXAMPLES / 'kinematics.py').read_text()
    assert example.endswith(f'"""\n\n{block}')


@pytest.mark.parametrize('page', ['kinematics.md', 'force.md'])
def test_the_python_of_a_page_runs(page):
    """One block after the other, in one name space that has a pose and a torque."""
    blocks = PYTHON.findall((ROOT / 'docs' / page).read_text())
    names = {'R': workspace_pose(0.1, 0.2, 0.3), 'torque': (0.0, 0.1, 0.0)}
    assert blocks
    for block in blocks:
        exec(compile(block, page, 'exec'), names)


def test_a_recording_through_supervise(monkeypatch, capsys, tmp_path):
    """A step of 3 deg of joint_1a in the middle of a recording is named, and withheld."""
    t = np.arange(2000) * 1e-3
    tilt = 0.2 * np.sin(2.0 * t)
    phi = 0.3 + 0.3 * np.cos(2.0 * t)
    joints = inverse(workspace_pose(tilt, 1.0, phi))
    noise = np.random.default_rng(3).normal(0.0, np.radians(0.04), (len(t), 4))
    angles = np.column_stack([joints.theta1, joints.theta3a]) + noise
    angles[1000:, 0] += np.radians(3.0)
    table = Table(tmp_path / 'measured_js.csv', JOINT_NAMES)
    for seconds, row in zip(t, angles, strict=True):
        table.write(1_700_000_000_000_000_000 + round(seconds * 1e9), row)
    table.close()
    names = run(monkeypatch, 'supervise_recording.py', tmp_path / 'measured_js.csv')
    published = names['result'].published
    assert published[20:1000].all()
    assert not published[1000:].any()
    out = capsys.readouterr().out
    assert 'of 2000 orientations published' in out
    assert re.search(r'^ +1\.\d{3} s  silent: joint_1a jumped$', out, re.MULTILINE), out
    assert re.search(r'^ +\d+ withheld: ', out, re.MULTILINE), out


def test_the_singularity_is_drawn_where_it_is(monkeypatch, tmp_path):
    pytest.importorskip('matplotlib').use('Agg')
    names = run(monkeypatch, 'singularity.py', tmp_path / 'singularity.png')
    three, four = (line.get_ydata() for line in names['turn'].lines)
    lowest = names['phi'][np.argmin(three)]
    assert lowest == pytest.approx(np.degrees(SINGULAR_PHI), abs=0.1)
    assert three.min() < 0.01
    assert four.min() > 0.1
    assert len(names['cone'].lines) == 4
    for line in names['cone'].lines:
        assert len(line.get_xdata()) > 50
    assert (tmp_path / 'singularity.png').stat().st_size > 10_000
