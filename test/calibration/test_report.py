# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a calibration from free motion: its figures, its pictures, what it refuses."""

from dataclasses import replace
import re
import sys

from free_motions import short_calibration
import numpy as np
import pytest
from recorded_text import assert_recorded
from spm_haptic_master.calibration import report_picture
from spm_haptic_master.calibration.calibration_file import check_output, write_text
from spm_haptic_master.calibration.motion.coverage import Region
from spm_haptic_master.calibration.motion.motion_file import Checked, Origin, Verdict
from spm_haptic_master.calibration.report import report_paths, write_report
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.validation import plot_style

pytest.importorskip('matplotlib')

ORIGIN = Origin(
    date='2026-03-01T10:00:00+01:00',
    recording='hand | motion.log',
    checksum='ab' * 32,
    version='1.2.3',
    counts_per_turn=(16384, 16384, 4096, 65536),
    settings={'encoders.can_id': (1, 2, 3, 4)},
)
CHECKED = Checked(
    alert_limit_deg=1.0,
    share=(0.93, 0.91, 0.9, 0.62),
    least_limit_deg=0.42,
)


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


def write(
    output,
    calibration,
    target=0.04,
):
    """Write a report; return what is said of it."""
    return write_report(
        output,
        Verdict(
            calibration,
            ORIGIN,
            0.5,
            0.9987,
            target,
            CHECKED,
        ),
    )


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


def test_the_report_is_the_recorded_one_and_begins_with_its_use(
    calibration,
    output,
    drawn,
):
    """And is one page of A4 in print: 60 lines beside the picture."""
    text = written(output, replace(calibration, region=Region(14.0, 5.0, 75.0)))
    assert len(text.splitlines()) < 60
    assert_recorded('calibration/short.md', text)
    assert output.with_name('rig_parity.png').read_bytes() == b'the picture'
    first, _, second, *_ = written(output, calibration, 2.0).splitlines()
    assert first == (
        '# Good for an alert limit of 0.5 deg or more, over the workspace: tilt to '
        '16 deg, self-rotation 0 to 80 deg.'
    )
    assert 'deg rms over the region, target 2 deg reached' in second


def test_deviations_of_angles_between_axes_are_those_of_drawn_mechanisms(
    calibration,
    output,
    drawn,
):
    """With mechanisms drawn by the covariance of the parameters."""
    rows = tables(written(output, calibration))
    layout = calibration.layout
    vectors = np.random.default_rng(1).multivariate_normal(
        calibration.vector,
        calibration.covariance,
        500,
    )
    several = [layout.geometry(vector) for vector in vectors]
    for joint, kind in ((1, 'base_axes'), (3, 'platform_axes')):
        for first, second in ((0, 1), (1, 2), (2, 0)):
            angles = np.degrees(
                [
                    np.arccos(np.dot(getattr(each, kind)[first], getattr(each, kind)[second]))
                    for each in several
                ]
            )
            cells = rows[f'angle from Z{joint}{"ABC"[first]} to Z{joint}{"ABC"[second]}'][0]
            assert float(cells[1]) == pytest.approx(angles.mean(), abs=0.05)
            assert float(cells[3]) == pytest.approx(angles.std(), rel=0.12)


def test_what_was_left_and_which_motion_would_determine_it(
    calibration,
    output,
    drawn,
):
    left = {'second harmonics': 'the motion does not determine them'}
    estimated = tuple(column for column in range(24) if column != 5)
    text = written(
        output,
        replace(
            calibration,
            left=left,
            advice='turn the handle farther',
            estimated=estimated,
        ),
    )
    assert (
        'Left as drawn: second harmonics (the motion does not determine them); proximal link '
        'B (the motion does not determine them).'
    ) in text
    assert 'What would determine more: turn the handle farther.' in text
    assert [cells[-1] for cells in tables(text)['proximal link B']] == ['as drawn']
    text = written(
        output,
        replace(
            calibration,
            left={},
            estimated=tuple(range(32)),
            kept=np.arange(2400) % 50 > 0,
        ),
    )
    assert 'Left as drawn: nothing.' in text
    assert '**CAUTION**: 2.0 % of the samples do not fit the others and were cut: ' in text


@pytest.fixture
def picture(calibration, monkeypatch):
    """Draw a calibration; return it, its region, and the axes of the maps row by row."""
    figures = []

    def save(figure, file):
        figures.append(figure)
        file.write(b'the picture')

    monkeypatch.setattr(plot_style, 'save', save)
    rotation = calibration.rotation.copy()
    # Samples without an orientation are on no map.
    rotation[:50] = np.nan
    drawn = replace(calibration, rotation=rotation, region=Region(9.0, 30.0, 70.0))
    # Nor are those that have none with the mechanism as drawn.
    drawn.parity_before[60:80] = np.nan
    assert report_picture.draw(drawn) == b'the picture'
    return drawn, figures[0].axes


def cells(axes):
    """Return the edges of the cells of a map in both coordinates, and the means in them, deg."""
    (mesh,) = axes.collections
    corners = mesh.get_coordinates()
    across = corners[0, :, 0]
    along = corners[:, 0, 1]
    return across, along, np.ma.filled(mesh.get_array(), np.nan)


def shown_parities(calibration):
    """Return tilts and parities of the samples on the maps, deg; before and after."""
    shown = np.isfinite(calibration.rotation).all(axis=(1, 2))
    shown &= np.isfinite(calibration.parity) & np.isfinite(calibration.parity_before)
    axis = calibration.rotation[shown][:, :, 2]
    tilt = np.degrees(np.arccos(axis @ np.full(3, 3**-0.5)))
    # Towards (1, -1, 0) and (1, 1, -2), at the distance of the tilt.
    x = axis @ np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    y = axis @ np.array([1.0, 1.0, -2.0]) / np.sqrt(6.0)
    place = np.column_stack([tilt * x, tilt * y]) / np.hypot(x, y)[:, None]
    before = np.degrees(calibration.parity_before[shown])
    return place, tilt, before, np.degrees(calibration.parity[shown])


def check_cells(axes, place, parity):
    """Check that each cell of a map has the mean parity of the samples in it."""
    across, along, means = cells(axes)
    x, y = place.T
    assert np.allclose(np.diff(across), 2.0)
    assert np.allclose(np.diff(along), 2.0)
    rows, columns = np.nonzero(np.isfinite(means))
    assert len(rows) > 50
    for row, column in zip(rows, columns, strict=True):
        inside = (x >= across[column]) & (x < across[column + 1])
        inside &= (y >= along[row]) & (y < along[row + 1])
        assert means[row, column] == pytest.approx(parity[inside].mean(), abs=1e-9)


def test_a_cell_of_the_picture_is_the_mean_parity_of_the_samples_in_it(picture):
    calibration, axes = picture
    place, _, before, after = shown_parities(calibration)
    check_cells(axes[0], place, before)
    check_cells(axes[1], place, after)
    check_cells(axes[2], place, after)


def test_tilt_over_self_rotation_is_of_the_same_samples(picture):
    """So it has nearly the same mean parity."""
    calibration, axes = picture
    _, _, before, after = shown_parities(calibration)
    for number, parity in ((3, before), (4, after)):
        across, along, means = cells(axes[number])
        assert np.allclose(np.diff(across), 4.0)
        assert np.allclose(np.diff(along), 2.0)
        assert np.nanmean(means) == pytest.approx(parity.mean(), abs=0.03)


def test_the_picture_has_one_scale_for_before_and_after_and_one_of_its_own(picture):
    calibration, axes = picture
    _, _, before, _ = shown_parities(calibration)
    scales = [each.collections[0].get_clim() for each in axes[:6]]
    # The second row has those of the first.
    assert scales[:3] == scales[3:]
    (low, first), (_, second), (_, own) = scales[:3]
    assert low == -first
    assert first == second
    assert 0.5 * np.abs(before).max() < first <= np.abs(before).max()
    assert 0.0 < own < 0.2 * first
    assert [scale.get_xlabel() for scale in axes[6:]] == ['mean parity, deg'] * 2
    assert [scale.get_xlim() for scale in axes[6:]] == [(-first, first), (-own, own)]


def test_cells_are_whole_steps_around_the_values():
    assert report_picture._edges(np.array([5.0, -3.1, 0.0]), 2.0).tolist() == [-4, -2, 0, 2, 4, 6]
    assert report_picture._edges(np.array([4.0]), 4.0).tolist() == [4.0, 8.0]


def test_a_cell_with_fewer_samples_than_it_needs_is_not_drawn():
    across = np.array([0.5, 1.0, 0.2, 2.5, 3.9])
    along = np.array([0.5, 1.9, 1.0, 2.1, 3.9])
    on = report_picture._Map(
        across,
        along,
        np.array([0.0, 2.0, 4.0]),
    )
    values = np.array([1.0, 2.0, 6.0, -4.0, 8.0])
    np.testing.assert_array_equal(on.means(values, 2), [[3.0, np.nan], [np.nan, 2.0]])
    np.testing.assert_array_equal(on.means(values, 3), [[3.0, np.nan], [np.nan, np.nan]])


def test_the_colour_scale_covers_all_but_a_fiftieth_of_the_cells():
    values = np.linspace(-100.0, 0.0, 101)
    first, second = values[:50].reshape(5, 10), np.append(values[50:], np.nan)
    assert report_picture._scale([first, second]) == pytest.approx(98.0)
    for nothing in (np.zeros((2, 2)), np.full(3, np.nan), np.zeros(0)):
        assert report_picture._scale([nothing]) == 1.0


@pytest.mark.parametrize(('rate', 'least'), [(100.0, 5), (60.0, 3), (10.0, 1), (250.0, 12)])
def test_a_cell_needs_a_twentieth_of_a_second(
    calibration,
    rate,
    least,
):
    readings = replace(calibration.readings, seconds=np.arange(2400) / rate)
    asked = []

    class Map:
        def means(
            self,
            values,
            least,
        ):
            asked.append(least)
            return values

    known = np.arange(2400) < 100
    part = replace(calibration, readings=readings)
    part.__dict__.update(parity=calibration.parity, parity_before=calibration.parity_before)
    report_picture._columns(
        part,
        (Map(), Map()),
        known,
    )
    assert asked == [least] * 4


@pytest.mark.parametrize(('region', 'highest'), [(30.0, 32.0), (9.0, 17.0)])
def test_a_map_of_the_turn_shows_the_tilt_of_the_region(region, highest):
    axes = plot_style.new_figure(width=3.0, height=3.0).subplots()
    axes.plot([0.0, 10.0], [3.0, 16.0])
    axes.set_ylim(3.0, 17.0)
    report_picture._label_turns(
        axes,
        Region(region, 0.0, 10.0),
        True,
    )
    assert axes.get_ylim() == (0.0, highest)


def rms_deg(parity):
    """Return the root mean square of a parity, deg."""
    return np.degrees(np.sqrt(np.nanmean(parity**2)))


def test_the_picture_names_what_it_shows(picture):
    calibration, axes = picture
    assert [each.get_title() for each in axes[:3]] == [
        f'before: {rms_deg(calibration.parity_before):.4f} deg rms',
        f'after: {rms_deg(calibration.parity):.4f} deg rms',
        'after, own scale',
    ]
    across = [each.get_xlabel() for each in axes[:6]]
    assert across[:3] == ['tilt towards (1, −1, 0), deg'] * 3
    assert across[3:] == ['self-rotation φ, deg'] * 3
    along = [each.get_ylabel() for each in axes[:6]]
    assert along == ['tilt towards (1, 1, −2), deg', '', '', 'tilt, deg', '', '']


def test_the_picture_names_the_motors(picture):
    """The axis of leg A's motor is z, of B's x, of C's y."""
    calibration, axes = picture
    _, tilt, _, _ = shown_parities(calibration)
    for each in axes[:3]:
        # Around the cells there is a rim for the letters, whose middle they are in.
        outermost = each.get_xlim()[1]
        assert outermost == pytest.approx(tilt.max() + 2.0 + 3.0)
        assert each.get_xlim() == each.get_ylim() == (-outermost, outermost)
        assert each.get_aspect() == 1.0
        # What the motion did not reach is grey.
        assert len(set(each.get_facecolor()[:3])) == 1
        angles = {}
        for text in each.texts:
            x, y = text.get_position()
            angles[text.get_text()] = np.degrees(np.arctan2(y, x))
            assert np.hypot(x, y) == pytest.approx(outermost - 1.5)
        assert angles == pytest.approx({'A': -90.0, 'B': 30.0, 'C': 150.0})


def test_the_picture_has_the_edge_of_the_region(picture):
    _, axes = picture
    for each in axes[:3]:
        x, y = each.lines[0].get_xydata().T
        assert np.hypot(x, y) == pytest.approx(9.0)
        assert [x[0], y[0]] == pytest.approx([x[-1], y[-1]])
        assert [np.ptp(x), np.ptp(y)] == pytest.approx([18.0, 18.0], rel=1e-3)
    for each in axes[3:6]:
        corners = each.lines[0].get_xydata().tolist()
        assert corners == [[30.0, 0.0], [30.0, 9.0], [70.0, 9.0], [70.0, 0.0]]
        assert each.get_ylim()[0] == 0.0
        assert each.get_ylim()[1] >= 9.0


def test_without_matplotlib_a_line_says_so(
    calibration,
    output,
    monkeypatch,
):
    stale = output.with_name('rig_parity.png')
    stale.write_bytes(b'of an earlier calibration')
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    for room, module in (('validation', 'plot_style'), ('calibration', 'report_picture')):
        name = f'spm_haptic_master.{room}'
        monkeypatch.delitem(sys.modules, f'{name}.{module}', raising=False)
        monkeypatch.delattr(f'{name}.{module}', raising=False)
    said = write(output, calibration)
    assert re.fullmatch(
        'report rig.md without picture: drawing needs matplotlib .* sudo apt '
        r"install .* pip install '\.\[validate\]'",
        said,
    )
    assert {path.name for path in output.parent.iterdir()} == {'rig.yaml', 'rig.md'}
    text = output.with_suffix('.md').read_text()
    assert '![' not in text
    assert re.search(r'^No picture: drawing needs matplotlib .*\[validate\]', text, re.MULTILINE)


def test_a_file_that_cannot_be_written_is_refused_before_anything_is_recorded(tmp_path):
    nowhere = tmp_path / 'none' / 'rig.yaml'
    with pytest.raises(
        InputError, match=f'-o {nowhere}; expected a file in an existing directory'
    ):
        check_output(nowhere, force=True)
    # Too long a name of its own, and with what it is written to first.
    for length in (300, 253):
        long = tmp_path / ('l' * length)
        with pytest.raises(InputError, match=f'-o: {long} cannot be written: .*name too long'):
            check_output(long, force=False)
    with pytest.raises(InputError, match=f'{long}: cannot be written: .*name too long'):
        write_text(long, 'the parameters')
    with pytest.raises(InputError, match='cannot be written'):
        write_text(nowhere, 'the parameters')
    new = tmp_path / 'rig.yaml'
    check_output(new, force=False)
    write_text(new, 'größe')
    assert new.read_bytes() == 'größe'.encode()
    assert [each.name for each in tmp_path.iterdir()] == ['rig.yaml']


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
    with pytest.raises(
        InputError,
        match=r'rig\.md: the report is written there; expected another '
        r'name, as rig\.yaml',
    ):
        report_paths(output.with_suffix('.md'))
