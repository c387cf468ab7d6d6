# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The files for dVRK and MoveIt Servo: what their programs need to follow this master."""

import json
import re
from textwrap import dedent

from harness import ROOT
import pytest
from spm_haptic_master.nodes.launch_plan import Follower, plan, SLAVE_TOPICS
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
import yaml

# Keys without which the master goes silent or the MTM is to move, and their values.
NEEDED = {
    '2.4.0': {
        'skip_ROS_bridge': True,
        'align_MTM': False,
        'MTM_is_haptic': False,
        # K3: without a gripper the jaw would follow a constant, and let a needle go.
        'ignore_jaw': True,
        '$id': 'dvrk-system.schema.json',
        '$version': '1',
    },
    '2.3.1': {'skip-ros-bridge': True, 'align-mtm': False, 'ignore-jaw': True},
}
# K5: only a haptic MTM gets wrenches, locks and the compensation of its weight.
NEEDED['2.4.0_force'] = NEEDED['2.4.0'] | {'MTM_is_haptic': True}
SLAVE_PAGE = (ROOT / 'docs' / 'slave.md').read_text(encoding='utf-8')


def objects(name, value):
    """Yield each object in a value, with the name that it has there."""
    if isinstance(value, dict):
        yield name, value
        for key, each in value.items():
            yield from objects(key, each)
    elif isinstance(value, list):
        for each in value:
            yield from objects(name, each)


def objects_of_release(release):
    """Return the objects of the configuration for a release of dVRK, by their names."""
    text = (ROOT / 'config' / f'dvrk_{release}.json').read_text(encoding='utf-8')
    return list(objects('', json.loads(text)))


@pytest.mark.parametrize('release', NEEDED)
def test_the_master_of_a_release_of_dvrk_speaks_nobody_moves_it_and_it_is_the_arm_read(release):
    found = objects_of_release(release)
    values = {}
    for _, each in found:
        values |= each
    assert NEEDED[release].items() <= values.items()
    (component,) = [each for name, each in found if name == 'components']
    assert component['shared-library'] == 'dvrk_arm_from_ros'
    assert component['class-name'] == 'dvrk_mtm_from_ros'


@pytest.mark.parametrize('release', NEEDED)
def test_the_arm_that_a_release_of_dvrk_reads_is_the_master(release):
    found = objects_of_release(release)
    (component,) = [each for name, each in found if name == 'components']
    arms = [each for name, each in found if name == 'arms']
    (arm,) = [each for each in arms if each['type'] == 'MTM_GENERIC']
    name = component['constructor-arg']['Name']
    assert arm['name'] == name
    assert arm['component'] == name
    assert arm['interface'] == name
    (pair,) = [each for key, each in found if key in ('teleop_PSMs', 'psm-teleops')]
    assert name in pair.values()
    assert f'namespace:={name} ' in SLAVE_PAGE


def test_moveit_servo_moves_and_turns_about_the_tool():
    section = SLAVE_PAGE.partition('## MoveIt Servo\n')[2].partition('\n## ')[0]
    parameters = yaml.safe_load(re.search(r'```yaml\n(.+?)```', section, re.DOTALL)[1])
    assert parameters['command_in_type'] == 'speed_units'
    assert parameters['apply_twist_commands_about_ee_frame'] is True
    # Jazzy's servo_node takes a twist whose age is below it: some that are lost are bridged.
    (rate,) = [each.default for each in FKM_SETTINGS if each.name == 'crtk_rate']
    assert 5.0 / rate <= parameters['incoming_command_timeout'] <= 0.1


def blocks(heading, language):
    """Return the code blocks of a language below a heading of the page of slaves."""
    section = SLAVE_PAGE.partition(f'## {heading}\n')[2].partition('\n## ')[0]
    found = re.findall(rf'^ *```{language}\n(.+?)```', section, re.DOTALL | re.MULTILINE)
    return [dedent(block) for block in found]


@pytest.mark.parametrize('heading', ['A laparoscopic slave', 'dVRK'])
def test_the_files_of_the_page_are_what_the_nodes_take(heading, tmp_path):
    for block in blocks(heading, 'yaml'):
        path = tmp_path / 'rig.yaml'
        path.write_text(block)
        assert plan('sim', str(path), '', '', True, Follower())


@pytest.mark.parametrize('heading', ['A laparoscopic slave', 'dVRK', 'cartesian_controllers'])
def test_the_topics_of_the_page_are_those_of_the_launch_file_and_the_node(heading):
    """An argument of `teleop.launch.py` exists, and a remapping is of a topic of `teleop`."""
    section = SLAVE_PAGE.partition(f'## {heading}\n')[2].partition('\n## ')[0]
    launch = (ROOT / 'launch' / 'teleop.launch.py').read_text(encoding='utf-8')
    arguments = re.findall(r'\bright_(\w+):=', section)
    assert [each for each in arguments if f"'{each}'" not in launch] == []
    remapped = re.findall(r'-r teleop:([\w/]+):=', section)
    assert set(remapped) <= {'servo_cp', *(f'slave/{topic}' for topic in SLAVE_TOPICS)}
    assert arguments or remapped
