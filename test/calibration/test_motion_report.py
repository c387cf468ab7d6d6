# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a calibration from free motion: its figures, its pictures, what it refuses."""

from dataclasses import replace
import hashlib
import re
import sys

import numpy as np
import pytest
from spm_haptic_master.calibration.free_motion import MotionCalibrator, Start
from spm_haptic_master.calibration.mechanism_parameters import layout_of, Tolerances
from spm_haptic_master.calibration.motion_coverage import Proposal
from spm_haptic_master.calibration.motion_file import Origin, zero_counts
from spm_haptic_master.calibration.motion_model import MotionModel
from spm_haptic_master.calibration.motion_report import check_report, report_paths, write_report
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry, workspace_pose

pytest.importorskip('matplotlib')
motion_figures = pytest.importorskip('spm_haptic_master.calibration.motion_figures')

NAMES = ('parity', 'coverage', 'harmonics', 'correlation')
# Zeros (rad) and directions of the simulated encoders, and noise of a reading (rad).
ZEROS, DIRECTION, NOISE = (1.0, -2.0, 0.3, 2.5), (1, -1, 1, -1), 0.0007
# Least size of a picture that shows something (bytes): an empty one has 3,000.
LEAST = 10_000


class Started(MotionCalibrator):
    """Calibrates from zeros and directions that are known, which saves the search for them."""

    def start(self, means, model, swaps=True):
        vector = np.zeros(model.layout.count)
        vector[:4] = ZEROS
        return Start(DIRECTION, vector)


@pytest.fixture(scope='module')
def calibration():
    """Return the calibration from 16 s of a small motion of a rig that is off."""
    layout = layout_of(Geometry(), 4)
    rng = np.random.default_rng(5)
    vector = rng.normal(size=layout.count) * np.where(
        np.arange(layout.count) < 16, np.radians(0.2), np.radians(0.02))
    vector[:4] = ZEROS
    seconds = np.arange(2000) * 0.008
    rotation = workspace_pose(0.25 * np.abs(np.sin(0.9 * seconds)), 2.3 * seconds,
                              0.7 + 0.5 * np.sin(0.5 * seconds))
    turned = MotionModel(layout, (1, 1, 1), np.full(4, NOISE)).readings(rotation, vector)
    readings = DIRECTION * turned + rng.normal(0.0, NOISE, turned.shape)
    return Started(Geometry(), (1, 1, 1), Tolerances()).calibrate(
        (seconds * 1e9).astype(np.int64), readings)


@pytest.fixture
def origin():
    return Origin('2026-03-01T10:00:00+01:00', 'hand | motion.log', 'ab' * 32, '1.2.3',
                  (16384, 16384, 4096, 65536), {'encoders.can_id': (1, 2, 3, 4)})


@pytest.fixture
def output(tmp_path):
    """Return a parameter file that is complete."""
    path = tmp_path / 'rig.yaml'
    path.write_text('the parameters')
    return path


@pytest.fixture(scope='module')
def pictures(calibration):
    """Return the pictures, which take seconds to draw."""
    return motion_figures.draw(calibration)


@pytest.fixture
def drawn(pictures, monkeypatch):
    """Take the pictures as they were drawn once."""
    monkeypatch.setattr(motion_figures, 'draw', lambda calibration: pictures)


def text_of(output):
    return output.with_suffix('.md').read_text(encoding='utf-8')


def tables(text):
    """Return the rows of all tables by their first cells, a list of rows for each."""
    found = {}
    for line in text.splitlines():
        if line.startswith('| '):
            first, *cells = (cell.strip() for cell in line.strip('|').split('|'))
            found.setdefault(first, []).append(cells)
    return found


def test_report_has_the_figures_of_the_calibration(calibration, origin, output, drawn):
    c, degrees = calibration, np.degrees
    assert write_report(output, c, origin) == 'report rig.md with 4 pictures'
    text = text_of(output)
    rows = tables(text)
    assert rows['recording'] == [['`hand / motion.log`']]
    assert rows['SHA-256 of the recording'] == [[f'`{origin.checksum}`']]
    assert rows['date'] == [[origin.date]]
    assert rows['spm_haptic_master'] == [['1.2.3']]
    assert rows['SHA-256 of the parameter file'] == [
        [f"`{hashlib.sha256(b'the parameters').hexdigest()}`"]]
    assert rows['sets of readings'] == [['2000']]
    assert rows['length'] == [['16.0 s']]
    assert rows['sets left out because of a spike'] == [[f'{c.readings.spikes}']]
    assert rows['`encoders.can_id`'] == [['`[1, 2, 3, 4]`']]
    zeros = zero_counts(c, origin.counts_per_turn)[0]
    for at, joint in enumerate(ALL_JOINT_NAMES[:4]):
        encoder, first, second = rows[joint]
        per_turn = origin.counts_per_turn[at]
        assert encoder[:7] == [
            f'{per_turn}', f'{DIRECTION[at]:+d}', f'{zeros[at]}',
            f'{c.deviations[at] * per_turn / (2.0 * np.pi):.2f}',
            f'{degrees(c.deviations[at]):.4f}', f'{degrees(c.noise[at]):.4f}',
            f'{degrees(c.bias[at]):.4f}']
        for column, order, cells in ((16 + 2 * at, 'first', first),
                                     (24 + 2 * at, 'second', second)):
            assert cells[:5] == [order, *(
                f'{degrees(each[column + part]):.4f}' for part in (0, 1)
                for each in (c.vector, c.deviations))]
            assert (cells[5] == '') == ({column, column + 1} <= set(c.estimated))
    for number, name in enumerate(c.layout.names):
        note = '' if number in c.estimated else 'as drawn'
        assert rows[f'{number + 1}'] == [[name, f'{degrees(c.vector[number]):.4f}',
                                          f'{degrees(c.deviations[number]):.4f}', note]]
    noise = np.sqrt(np.mean(c.readings.sigma ** 2))
    for label, parity in (('parity before, with zeros and directions only, rms', c.parity_before),
                          ('parity after, rms', c.parity)):
        rms = np.sqrt(np.nanmean(parity ** 2))
        assert rows[label] == [[f'{degrees(rms):.4f}', f'{rms / noise:.2f}']]
    assert rows['predicted orientation error, rms over the motion'][0][0] \
        == f'{degrees(c.error):.4f}'
    assert rows['predicted orientation error, rms over the workspace'][0][0] \
        == f'{degrees(c.target_error):.4f}'
    for group, rms in c.held_out.items():
        assert rows[group if group == 'zeros' else f'+ {group}'][0][0] == f'{degrees(rms):.4f}'
    assert 'nan' not in text


def test_mechanism_is_quoted_beside_the_drawing(calibration, origin, output, drawn):
    c = calibration
    write_report(output, c, origin)
    rows = tables(text_of(output))
    built = c.layout.geometry(c.vector)
    for number, name in enumerate(c.layout.names[4:10]):
        found = (*built.alphas, *built.betas)[number]
        drawn = (*c.layout.nominal.alphas, *c.layout.nominal.betas)[number]
        assert rows[name][0][:4] == [
            f'{np.degrees(drawn):.4f}', f'{np.degrees(found):.4f}',
            f'{np.degrees(found - drawn):+.4f}', f'{np.degrees(c.deviations[4 + number]):.4f}']
    for joint, axes in ((1, built.base_axes), (3, built.platform_axes)):
        for first, second in ('AB', 'BC', 'CA'):
            one, other = (np.array(axes['ABC'.index(leg)]) for leg in (first, second))
            cells = rows[f'angle from Z{joint}{first} to Z{joint}{second}'][0]
            assert cells[1] == f'{np.degrees(np.arccos(one @ other)):.4f}'
    # The one angle of the axes that is a parameter has that parameter's deviation.
    assert rows['angle from Z1A to Z1B'][0][3] == f'{np.degrees(c.deviations[10]):.4f}'


def test_standard_deviation_of_an_angle_between_axes_is_that_of_its_spread(
        calibration, origin, output, drawn):
    """Of the angles of mechanisms that are drawn by the covariance."""
    c = calibration
    write_report(output, c, origin)
    rows = tables(text_of(output))
    drawn = np.random.default_rng(1).multivariate_normal(c.vector, c.covariance, 500)
    built = [c.layout.geometry(vector) for vector in drawn]
    for name, axes, first, second in (
            ('angle from Z1B to Z1C', 'base_axes', 1, 2),
            ('angle from Z3A to Z3B', 'platform_axes', 0, 1),
            ('angle from Z3C to Z3A', 'platform_axes', 2, 0)):
        angles = [np.degrees(np.arccos(np.dot(getattr(g, axes)[first], getattr(g, axes)[second])))
                  for g in built]
        assert float(rows[name][0][3]) == pytest.approx(np.std(angles), rel=0.12)


def test_what_was_left_and_which_motion_would_determine_it(calibration, origin, output, drawn):
    left = {'second harmonics': 'the motion does not determine them'}
    advice = (Proposal('turn the handle farther', 4.0), Proposal('tilt the handle', 2.0),
              Proposal('turn the handle farther', 1.5))
    estimated = tuple(column for column in range(24) if column != 5)
    write_report(output, replace(
        calibration, left=left, advice=advice, estimated=estimated), origin)
    rows = tables(text_of(output))
    assert rows['second harmonics'] == [['the motion does not determine them']]
    assert rows['proximal link B'][1] == ['the motion does not determine them']
    assert rows['turn the handle farther'] == [['4.00', '50 %']]
    assert rows['tilt the handle'] == [['2.00', '29 %']]
    write_report(output, replace(
        calibration, left={}, advice=(), estimated=tuple(range(32)), held_out={}), origin)
    text = text_of(output)
    assert 'Nothing: the motion determines all parameters.' in text
    assert 'No further motion would determine more.' in text
    assert 'too short to hold a part of it out' in text


def test_pictures_are_beside_the_file_and_in_the_report(calibration, origin, output, drawn):
    write_report(output, calibration, origin)
    shown = re.findall(r'!\[.*?\]\((.*?)\)', text_of(output))
    assert shown == [f'rig_{name}.png' for name in NAMES]
    images = pytest.importorskip('matplotlib.image')
    for name in shown:
        path = output.with_name(name)
        assert path.stat().st_size > LEAST
        assert images.imread(path)[..., :3].std() > 0.05
    assert {path.name for path in output.parent.iterdir()} == {'rig.yaml', 'rig.md', *shown}


@pytest.mark.slow
def test_pictures_of_a_calibration_that_determined_little(calibration):
    """Zeros alone, means without an orientation, and further sensors."""
    sensors = 6
    layout = layout_of(Geometry(), sensors)
    vector = np.zeros(layout.count)
    vector[:4] = ZEROS
    rotation, parity = calibration.rotation.copy(), calibration.parity.copy()
    rotation[:50] = np.nan
    parity[:50] = np.nan
    readings = np.tile(calibration.readings.readings, 2)[:, :sensors]
    found = motion_figures.draw(replace(
        calibration, layout=layout, vector=vector, covariance=1e-6 * np.eye(layout.count),
        estimated=tuple(range(sensors)), direction=(*DIRECTION, 1, 1),
        noise=np.full(sensors, NOISE), bias=np.full(sensors, NOISE), rotation=rotation,
        parity=parity, advice=(),
        readings=replace(calibration.readings, readings=readings)))
    assert tuple(found) == NAMES
    assert min(map(len, found.values())) > LEAST


def without_matplotlib(monkeypatch):
    """Make matplotlib missing, and what was loaded of it forgotten."""
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    for room, module in (('validation', 'plot_style'), ('calibration', 'motion_figures')):
        name = f'spm_haptic_master.{room}'
        monkeypatch.delitem(sys.modules, f'{name}.{module}', raising=False)
        monkeypatch.delattr(f'{name}.{module}', raising=False)


def test_without_matplotlib_a_line_says_so(calibration, origin, output, monkeypatch):
    stale = output.with_name('rig_parity.png')
    stale.write_bytes(b'of an earlier calibration')
    without_matplotlib(monkeypatch)
    said = write_report(output, calibration, origin)
    assert re.fullmatch('report rig.md without pictures: drawing needs matplotlib .* sudo apt '
                        r"install .* pip install '\.\[validate\]'", said)
    assert {path.name for path in output.parent.iterdir()} == {'rig.yaml', 'rig.md'}
    text = text_of(output)
    assert '![' not in text
    assert re.search(r'^No pictures: drawing needs matplotlib .*\[validate\]', text, re.MULTILINE)
    assert tables(text)['parity after, rms']


@pytest.mark.parametrize('blocked', ['rig.md', 'rig_correlation.png', 'rig.md.new'])
def test_report_that_cannot_be_written_leaves_nothing(
        calibration, origin, output, drawn, blocked):
    output.with_name(blocked).mkdir()
    with pytest.raises(InputError, match='(?s)rig.md: the report cannot be written: .*'
                       'rig.yaml is complete') as caught:
        write_report(output, calibration, origin)
    assert '\n' not in str(caught.value)
    assert {path.name for path in output.parent.iterdir()} == {'rig.yaml', blocked}
    assert output.read_text() == 'the parameters'


def test_directory_that_cannot_be_written_is_named(calibration, origin, tmp_path, drawn):
    """The parameter file is there first: without it there is no report."""
    output = tmp_path / 'gone' / 'rig.yaml'
    with pytest.raises(InputError, match='gone/rig.md: the report cannot be written: .*rig.yaml'):
        write_report(output, calibration, origin)
    assert not list(tmp_path.iterdir())


def test_earlier_report_is_kept_without_force(output):
    check_report(output, force=False)
    for path in report_paths(output):
        path.write_text('earlier')
        with pytest.raises(InputError, match=f'{path.name}: .*already exists; expected --force'):
            check_report(output, force=False)
        check_report(output, force=True)
        path.unlink()
    report_paths(output)[-1].mkdir()
    with pytest.raises(InputError, match=r'rig\.md: .*expected a regular file'):
        check_report(output, force=True)


def test_parameter_file_under_the_name_of_the_report_is_refused(tmp_path):
    with pytest.raises(InputError, match=r'-o .*rig\.md: the report is written there; expected '
                                         r'another name, as rig\.yaml'):
        check_report(tmp_path / 'rig.md', force=True)
