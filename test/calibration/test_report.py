# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a calibration from free motion: its figures, its pictures, what it refuses."""

from dataclasses import replace
from itertools import product
import re
import sys

from free_motions import short_calibration
import numpy as np
import pytest
from spm_haptic_master.calibration import report_picture
from spm_haptic_master.calibration.calibration_file import check_output
from spm_haptic_master.calibration.motion.calibration import Origin, Verdict
from spm_haptic_master.calibration.motion.coverage import Region
from spm_haptic_master.calibration.report import report_paths, write_report
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import zxz_from_matrix
from spm_haptic_master.validation import plot_style

images = pytest.importorskip('matplotlib.image')

ORIGIN = Origin('2026-03-01T10:00:00+01:00', 'hand | motion.log', 'ab' * 32, '1.2.3',
                (16384, 16384, 4096, 65536), {'encoders.can_id': (1, 2, 3, 4)})


@pytest.fixture
def calibration():
    return short_calibration()


@pytest.fixture
def output(tmp_path):
    """Return a parameter file that is complete."""
    path = tmp_path / 'rig.yaml'
    path.write_text('the parameters')
    return path


@pytest.fixture
def drawn(monkeypatch):
    """Draw nothing: a picture takes seconds."""
    monkeypatch.setattr(report_picture, 'draw', lambda calibration: b'the picture')


def write(output, calibration, target=0.02):
    """Write a report; return what is said of it."""
    return write_report(output, Verdict(calibration, ORIGIN, 0.5, 1.0, target))


def written(output, *args):
    """Write a report; return its text."""
    assert write(output, *args) == 'report rig.md'
    return output.with_suffix('.md').read_text(encoding='utf-8')


def tables(text):
    """Return the rows of all tables by their first cells, a list of rows for each."""
    found = {}
    for line in text.splitlines():
        if line.startswith('| '):
            first, *cells = (cell.strip() for cell in line.strip('|').split('|'))
            found.setdefault(first, []).append(cells)
    return found


def test_the_report_begins_with_what_the_calibration_is_good_for(calibration, output, drawn):
    """And is one page of A4 in print: 60 lines beside the picture."""
    first, _, second, *_ = lines = written(output, calibration).splitlines()
    assert first == ('# Good for an alert limit of 0.5 deg or more, over the workspace: tilt to '
                     '16 deg, self-rotation 0 to 80 deg.')
    assert 'deg rms over the region, target 0.02 deg NOT reached' in second
    assert len(lines) < 60
    part = replace(calibration, region=Region(9.0, 30.0, 70.0))
    first, _, second, *_ = written(output, part, 2.0).splitlines()
    assert 'ONLY for the region moved: tilt to 9 deg, self-rotation 30 to 70 deg' in first
    assert 'target 2 deg reached' in second


def test_the_mechanism_is_quoted_beside_the_drawing(calibration, output, drawn):
    """With standard deviations of angles between axes as those of mechanisms by the covariance."""
    c = calibration
    rows = tables(written(output, c))
    built, nominal = c.layout.geometry(c.vector), c.layout.nominal
    for name, angle, drawn, deviation in zip(
            c.layout.names[4:10], (*built.alphas, *built.betas),
            (*nominal.alphas, *nominal.betas), c.deviations[4:10], strict=True):
        assert [float(cell) for cell in rows[name][0][:4]] == pytest.approx(
            np.degrees([drawn, angle, angle - drawn, deviation]), abs=1e-4)
    vectors = np.random.default_rng(1).multivariate_normal(c.vector, c.covariance, 500)
    several = [c.layout.geometry(vector) for vector in vectors]
    for joint, kind in ((1, 'base_axes'), (3, 'platform_axes')):
        for first, second in ((0, 1), (1, 2), (2, 0)):
            angle, *angles = (np.degrees(np.arccos(
                np.dot(getattr(each, kind)[first], getattr(each, kind)[second])))
                for each in (built, *several))
            cells = rows[f'angle from Z{joint}{"ABC"[first]} to Z{joint}{"ABC"[second]}'][0]
            assert float(cells[1]) == pytest.approx(angle, abs=1e-4)
            assert float(cells[3]) == pytest.approx(np.std(angles), rel=0.12)


def test_what_was_left_and_which_motion_would_determine_it(calibration, output, drawn):
    left = {'second harmonics': 'the motion does not determine them'}
    estimated = tuple(column for column in range(24) if column != 5)
    text = written(output, replace(
        calibration, left=left, advice='turn the handle farther', estimated=estimated))
    assert ('Left as drawn: second harmonics (the motion does not determine them); proximal link '
            'B (the motion does not determine them).') in text
    assert 'What would determine more: turn the handle farther.' in text
    assert [cells[-1] for cells in tables(text)['proximal link B']] == ['as drawn']
    text = written(output, replace(calibration, left={}, estimated=tuple(range(32)),
                                   kept=np.arange(2400) % 50 > 0))
    assert 'Left as drawn: nothing.' in text
    assert '**CAUTION**: 2.0 % of the samples do not fit the others and were cut: ' in text


@pytest.mark.slow
def test_the_picture_is_beside_the_file_and_in_the_report(calibration, output):
    shown = re.findall(r'!\[.*?\]\((.*?)\)', written(output, calibration))
    assert shown == ['rig_parity.png']
    assert images.imread(output.with_name(shown[0]))[..., :3].std() > 0.05
    assert {path.name for path in output.parent.iterdir()} == {'rig.yaml', 'rig.md', *shown}


def test_the_picture_has_the_mean_parity_of_each_cell_before_and_after(calibration, monkeypatch):
    """Against tilt and azimuth by each orientation; means without an orientation are left out."""
    figures = []
    monkeypatch.setattr(plot_style, 'save', lambda figure, file: figures.append(figure))
    rotation = calibration.rotation.copy()
    rotation[:50] = np.nan
    c = replace(calibration, rotation=rotation, region=Region(9.0, 30.0, 70.0))
    report_picture.draw(c)
    axes = figures[0].axes
    centre, one, other = (np.array(each) / np.linalg.norm(each) for each in (
        [1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [1.0, 1.0, -2.0]))
    along = rotation[50:, :, 2]
    tilt = np.degrees(np.arccos(along @ centre))
    place = np.column_stack([along @ one, along @ other])
    x, y = (place * (tilt / np.linalg.norm(place, axis=1))[:, None]).T
    turn = np.degrees(np.unwrap(zxz_from_matrix(rotation[50:])[2]))
    turn -= 360.0 * np.round(turn.mean() / 360.0)
    limits, sizes = np.zeros((2, 3)), [[], [], []]
    for (row, coordinates, width), (column, parity) in product(
            ((0, (x, y), (2.0, 2.0)), (1, (turn, tilt), (4.0, 2.0))),
            enumerate((c.parity_before, c.parity, c.parity))):
        mesh = axes[3 * row + column].collections[0]
        corners = mesh.get_coordinates()
        cells = {}
        for cell, value in zip(np.floor(np.column_stack(coordinates) / width).tolist(),
                               np.degrees(parity[50:]), strict=True):
            cells.setdefault(tuple(cell), []).append(value)
        expected = {cell: np.mean(values) for cell, values in cells.items() if len(values) >= 5}
        drawn = np.ma.filled(mesh.get_array(), np.nan).reshape(np.array(corners.shape[:2]) - 1)
        assert {tuple(corners[at] / width): drawn[at] for at in zip(
            *np.nonzero(np.isfinite(drawn)), strict=True)} == pytest.approx(expected, abs=1e-9)
        # Of all cells that have a sample, and no more.
        assert [*(corners[0, 0] / width), *(corners[-1, -1] / width - 1.0)] == [
            *np.min([*cells], axis=0), *np.max([*cells], axis=0)]
        low, limits[row, column] = mesh.get_clim()
        assert low == -limits[row, column]
        sizes[column] += np.abs([*expected.values()]).tolist()
    # One scale for both maps of a column, and for before and after: but for the last spikes.
    assert (limits[0] == limits[1]).all()
    assert limits[0, 0] == limits[0, 1] > limits[0, 2]
    for column in (0, 2):
        assert np.mean(sizes[column] <= limits[0, column]) == pytest.approx(0.98, abs=0.01)
    # The region is dashed, and the legs' letters are towards their motors: x, y, z are B, C, A.
    circle, box = (axes[at].lines[0].get_xydata() for at in (1, 4))
    assert np.allclose(np.linalg.norm(circle, axis=1), 9.0)
    assert box.tolist() == [[30.0, 0.0], [30.0, 9.0], [70.0, 9.0], [70.0, 0.0]]
    for text in axes[0].texts:
        motor = np.eye(3)['BCA'.index(text.get_text())]
        at, towards = np.array(text.get_position()), np.array([motor @ one, motor @ other])
        assert at @ towards == pytest.approx(np.linalg.norm(at) * np.linalg.norm(towards))
        assert tilt.max() < np.linalg.norm(at) < axes[0].get_xlim()[1]


def test_without_matplotlib_a_line_says_so(calibration, output, monkeypatch):
    stale = output.with_name('rig_parity.png')
    stale.write_bytes(b'of an earlier calibration')
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    for room, module in (('validation', 'plot_style'), ('calibration', 'report_picture')):
        name = f'spm_haptic_master.{room}'
        monkeypatch.delitem(sys.modules, f'{name}.{module}', raising=False)
        monkeypatch.delattr(f'{name}.{module}', raising=False)
    said = write(output, calibration)
    assert re.fullmatch('report rig.md without picture: drawing needs matplotlib .* sudo apt '
                        r"install .* pip install '\.\[validate\]'", said)
    assert {path.name for path in output.parent.iterdir()} == {'rig.yaml', 'rig.md'}
    text = output.with_suffix('.md').read_text()
    assert '![' not in text
    assert re.search(r'^No picture: drawing needs matplotlib .*\[validate\]', text, re.MULTILINE)


def test_an_earlier_report_is_kept_without_force(output):
    for path in report_paths(output):
        check_output(path, force=False)
        path.write_text('earlier')
        with pytest.raises(InputError, match=f'{path.name} already exists; expected --force'):
            check_output(path, force=False)
        check_output(path, force=True)
        path.unlink()
        path.mkdir()
        with pytest.raises(InputError, match=f'{path.name} exists; expected a regular file'):
            check_output(path, force=True)
    with pytest.raises(InputError, match=r'rig\.md: the report is written there; expected another '
                                         r'name, as rig\.yaml'):
        report_paths(output.with_suffix('.md'))
