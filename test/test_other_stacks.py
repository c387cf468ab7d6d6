# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The files for dVRK and MoveIt Servo: each has the keys and values of their sources."""

import json
import re

from harness import ROOT
import pytest
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
import yaml

# Keys of the objects of a system's file by release, as far as the files have them, in the sources
# of dVRK; `component` is of cisst. 2.4.0: share/schemas and the .cdg files in
# core/components/code. 2.3.1: mtsIntuitiveResearchKitConsole.cpp and mtsTeleOperationPSM.cpp.
COMPONENT = {'component_manager': 'components connections',
             'components': 'shared-library class-name constructor-arg configure-parameter',
             'constructor-arg': 'Name Period'}
KEYS = {
    '2.4.0': {
        **COMPONENT, '': '$id $version component_manager IOs arms consoles settings',
        'arms': 'name type IO serial simulation arm_file skip_ROS_bridge component interface '
                'base_frame',
        'consoles': 'name input_type IO_pedals HID_file clutch camera operator_present '
                    'teleop_PSMs teleop_ECMs',
        'teleop_PSMs': 'type MTM PSM configure_parameter period PSM_base_frame',
        'configure_parameter': 'align_MTM rotation_locked translation_locked ignore_jaw scale '
                               'start_orientation_tolerance start_gripper_threshold '
                               'start_roll_threshold use_MTM_angular_velocity MTM_is_haptic'},
    '2.3.1': {
        **COMPONENT, 'component-manager': COMPONENT['component_manager'],
        '': 'component-manager chatty io arms operator-present psm-teleops console-inputs',
        'io': 'firewire-protocol period port configuration-files footpedals '
              'physical-footpedals-required',
        'arms': 'name system type serial simulation skip-ros-bridge component interface arm '
                'kinematic base-frame period',
        'psm-teleops': 'type period configure-parameter mtm psm psm-base-frame',
        'configure-parameter': 'scale rotation-locked translation-locked ignore-jaw jaw-rate '
                               'gripper-scaling start-orientation-tolerance align-mtm '
                               'start-gripper-threshold start-roll-threshold use-mtm-velocity'}}
# Keys without which the master goes silent or the MTM is to move, and their values.
NEEDED = {
    '2.4.0': {'skip_ROS_bridge': True, 'align_MTM': False, 'MTM_is_haptic': False,
              '$id': 'dvrk-system.schema.json', '$version': '1'},
    '2.3.1': {'skip-ros-bridge': True, 'align-mtm': False}}


def page(name):
    return (ROOT / 'docs' / name).read_text(encoding='utf-8')


def blocks():
    """Return the system's file of each release of dVRK."""
    return {path.stem.removeprefix('dvrk_'): json.loads(path.read_text(encoding='utf-8'))
            for path in (ROOT / 'config').glob('dvrk_*.json')}


def objects(name, value):
    """Yield each object in a value, with the name that it has there."""
    if isinstance(value, dict):
        yield name, value
        for key, each in value.items():
            yield from objects(key, each)
    elif isinstance(value, list):
        for each in value:
            yield from objects(name, each)


def test_each_release_has_a_file():
    assert set(blocks()) == set(KEYS)
    assert all(f'../config/dvrk_{release}.json' in page('slave.md') for release in KEYS)


@pytest.mark.parametrize('release', KEYS)
def test_a_file_for_dvrk_has_the_keys_of_its_release(release):
    system = blocks()[release]
    unknown = [(name, key) for name, each in objects('', system) for key in each
               if key not in KEYS[release][name].split()]
    assert unknown == []
    values = {key: value for _, each in objects('', system) for key, value in each.items()}
    assert {key: values.get(key) for key in NEEDED[release]} == NEEDED[release]


@pytest.mark.parametrize('release', KEYS)
def test_the_arm_of_a_file_is_the_one_that_its_component_reads(release):
    found = list(objects('', blocks()[release]))
    (component,) = [each for name, each in found if name == 'components']
    assert component['shared-library'] == 'dvrk_arm_from_ros'
    assert component['class-name'] == 'dvrk_mtm_from_ros'
    (arm,) = [each for name, each in found
              if name == 'arms' and each['type'] == 'MTM_GENERIC']
    name = component['constructor-arg']['Name']
    assert arm['name'] == arm['component'] == arm['interface'] == name
    (pair,) = [each for key, each in found if key in ('teleop_PSMs', 'psm-teleops')]
    assert name in pair.values() and f'namespace:={name} ' in page('slave.md')


def test_moveit_servo_moves_and_turns_about_the_tool():
    section = page('slave.md').partition('## MoveIt Servo\n')[2].partition('\n## ')[0]
    parameters = yaml.safe_load(re.search(r'```yaml\n(.+?)```', section, re.DOTALL)[1])
    assert parameters['command_in_type'] == 'speed_units'
    assert parameters['apply_twist_commands_about_ee_frame'] is True
    # Jazzy's servo_node takes a twist whose age is below it: some that are lost are bridged.
    (rate,) = [each.default for each in FKM_SETTINGS if each.name == 'crtk_rate']
    assert 5.0 / rate <= parameters['incoming_command_timeout'] <= 0.1
