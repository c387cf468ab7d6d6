# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What RViz and Foxglove are given: files, topics that exist, the mechanism of the rig."""

import json
from pathlib import Path
import re

import numpy as np
import pytest
import rig_as_built
from spm_haptic_master.description.urdf import describe, foxglove_layout, INSTALLED
from spm_haptic_master.nodes.launch_plan import mechanism, rviz_config, source_to_show
import yaml

ROOT = Path(__file__).resolve().parents[2]
LAYOUT = json.loads((ROOT / 'config' / 'foxglove_layout.json').read_text())
INTERFACES = (ROOT / 'docs' / 'interfaces.md').read_text()


def test_the_layout_names_panels_that_there_are():
    leaves = re.findall(r'"(\w+!\w+)"', json.dumps(LAYOUT['layout']))
    assert sorted(leaves) == sorted(LAYOUT['configById'])


def test_the_layout_names_topics_that_there_are():
    text = json.dumps(LAYOUT['configById'])
    topics = {path.partition('.')[0] for path in re.findall(r'"value": "(/[^"\\]+)', text)}
    assert topics == {
        '/state',
        '/source',
        '/measured_js',
        '/protection_level',
        '/diagnostics',
    }
    for topic in topics:
        assert f'`{topic.strip("/")}`' in INTERFACES or f'`{topic}`' in INTERFACES


def figure_paths():
    """Return the paths of figures on /diagnostics in the layout."""
    found = []
    for panel in LAYOUT['configById'].values():
        found += [path['value'] for path in panel.get('paths', [])]
    return [path for path in found if '{' in path]


def test_the_layout_names_figures_that_there_are():
    sources = (ROOT / 'spm_haptic_master/nodes').glob('*.py')
    nodes = ''.join(path.read_text() for path in sources)
    paths = figure_paths()
    assert len(paths) == 3
    for path in paths:
        name, key = re.findall(r'=="([^"]+)"', path)
        assert f"'{key}'" in nodes
        assert f"'{name.partition(': ')[2]}'" in nodes


def test_the_layout_of_an_arm_in_a_namespace_names_its_topics_frames_and_entries():
    text = (ROOT / 'config' / 'foxglove_layout.json').read_text()
    assert foxglove_layout(text, '') == text
    changed = foxglove_layout(text, 'arms/left')
    assert changed.replace('arms/left/', '') == text
    left = r'"/(?!arms/left/|diagnostics["\.])|name==\\"fkm|"spm_base"|"framePrefix": ""'
    assert len(re.findall(left, text)) > 10
    assert not re.search(left, changed)
    json.loads(changed)


def test_rviz_shows_the_description_of_an_arm_in_its_base_frame():
    """It looks for the frame PREFIX/LINK; robot_state_publisher names it so."""
    template = (ROOT / 'config' / 'display.rviz').read_text()

    def shown(namespace):
        manager = yaml.safe_load(rviz_config(template, namespace))['Visualization Manager']
        assert manager['Global Options']['Fixed Frame'] == 'spm_base'
        return {display['Class'].partition('/')[2]: display for display in manager['Displays']}

    displays = shown('')
    assert displays['RobotModel']['Description Topic']['Value'] == 'robot_description'
    assert f'`{displays["PoseWithCovariance"]["Topic"]["Value"]}`' in INTERFACES
    assert displays['RobotModel']['TF Prefix'] == ''
    assert shown('arms/left')['RobotModel'] == {**displays['RobotModel'], 'TF Prefix': 'arms/left'}


@pytest.mark.parametrize(
    ('source', 'config', 'calibration', 'expected'),
    [
        ('', '', '', 'sim'),
        ('', 'rig.yaml', '', ''),
        ('', '', 'calibration.yaml', ''),
        ('sim', 'rig.yaml', 'calibration.yaml', 'sim'),
        ('can', '', '', 'can'),
    ],
)
def test_a_rig_is_not_simulated_unless_that_is_asked_for(source, config, calibration, expected):
    assert source_to_show(source, config, calibration) == expected


@pytest.mark.parametrize('is_calibrated', [False, True])
def test_a_nominal_device_has_the_installed_meshes_and_a_calibrated_one_its_own(
    is_calibrated, tmp_path
):
    calibration = tmp_path / 'calibration.yaml'
    calibration.write_text(yaml.safe_dump({'/**': {'ros__parameters': rig_as_built.mechanism()}}))
    geometry = mechanism('', str(calibration) if is_calibrated else '', 'left')
    built = rig_as_built.rig()['base_axes']
    assert np.allclose(geometry.base_axes, built, atol=1e-6) == is_calibrated
    names = set(re.findall(r'filename="([^"]+)"', describe(geometry, tmp_path / 'urdf')))
    prefix, folder = (
        (f'file://{tmp_path}', tmp_path) if is_calibrated else (INSTALLED, ROOT / 'urdf')
    )
    assert len(names) == 8
    assert all((folder / name.removeprefix(f'{prefix}/')).is_file() for name in names)
    assert (tmp_path / 'urdf').exists() == is_calibrated
