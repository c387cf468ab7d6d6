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
from spm_haptic_master.calibration.calibration_file import check_output
from spm_haptic_master.calibration.motion.coverage import Region
from spm_haptic_master.calibration.motion.motion_file import Checked, Origin, Verdict
from spm_haptic_master.calibration.report import report_paths, write_report
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.validation import plot_style

pytest.importorskip('matplotlib')

ORIGIN = Origin(
    '2026-03-01T10:00:00+01:00',
    'hand | motion.log',
    'ab' * 32,
    '1.2.3',
    (16384, 16384, 4096, 65536),
    {'encoders.can_id': (1, 2, 3, 4)},
)
CHECKED = Checked(1.0, (0.93, 0.91, 0.9, 0.62), 0.42)


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


def write(output, calibration, target=0.04):
    """Write a report; return what is said of it."""
    return write_report(output, Verdict(calibration, ORIGIN, 0.5, 0.9987, target, CHECKED))


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


def test_the_report_is_the_recorded_one_and_begins_with_its_use(calibration, output, drawn):
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
    calibration, output, drawn
):
    """With mechanisms drawn by the covariance of the parameters."""
    rows = tables(written(output, calibration))
    layout = calibration.layout
    vectors = np.random.default_rng(1).multivariate_normal(
        calibration.vector, calibration.covariance, 500
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


def test_what_was_left_and_which_motion_would_determine_it(calibration, output, drawn):
    left = {'second harmonics': 'the motion does not determine them'}
    estimated = tuple(column for column in range(24) if column != 5)
    text = written(
        output,
        replace(calibration, left=left, advice='turn the handle farther', estimated=estimated),
    )
    assert (
        'Left as drawn: second harmonics (the motion does not determine them); proximal link '
        'B (the motion does not determine them).'
    ) in text
    assert 'What would determine more: turn the handle farther.' in text
    assert [cells[-1] for cells in tables(text)['proximal link B']] == ['as drawn']
    text = written(
        output,
        replace(calibration, left={}, estimated=tuple(range(32)), kept=np.arange(2400) % 50 > 0),
    )
    assert 'Left as drawn: nothing.' in text
    assert '**CAUTION**: 2.0 % of the samples do not fit the others and were cut: ' in text


def test_the_picture_is_the_recorded_one(calibration, monkeypatch):
    """Maps with their scale and edges, lines and texts; means without orientation are left out."""
    figures = []
    monkeypatch.setattr(
        plot_style,
        'save',
        lambda figure, file: (figures.append(figure), file.write(b'the picture')),
    )
    rotation = calibration.rotation.copy()
    rotation[:50] = np.nan
    assert (
        report_picture.draw(
            replace(calibration, rotation=rotation, region=Region(9.0, 30.0, 70.0))
        )
        == b'the picture'
    )
    lines = []
    for axes in figures[0].axes[:6]:
        (mesh,) = axes.collections
        corners = mesh.get_coordinates()
        lines += [
            ' | '.join(
                (
                    axes.get_title(),
                    axes.get_xlabel(),
                    axes.get_ylabel(),
                    *(each.get_text() for each in axes.texts),
                )
            ),
            *(
                ' '.join(f'{number:.4f}' for number in np.ravel(numbers))
                for numbers in (
                    (*axes.get_xlim(), *axes.get_ylim()),
                    mesh.get_clim(),
                    (corners[0, 0], corners[-1, -1]),
                    axes.lines[0].get_xydata()[::10],
                    [each.get_position() for each in axes.texts],
                )
            ),
            *(
                ' '.join(f'{mean:.4f}' for mean in row)
                for row in np.ma.filled(mesh.get_array(), np.nan)
            ),
        ]
    lines += [axes.get_xlabel() for axes in figures[0].axes[6:]]
    assert_recorded('calibration/picture.txt', '\n'.join(lines))


def test_without_matplotlib_a_line_says_so(calibration, output, monkeypatch):
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
