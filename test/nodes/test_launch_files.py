# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The launch files, executed: what they start, and what they refuse before anything starts.

`launch` and `launch_ros` are in no package registry: what the launch files use of them is below.
It takes the arguments that those take and no others, and visits actions in their order.
"""

import runpy
import sys
import tempfile
import types

from harness import ROOT
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.files import config_directory

CALIBRATION = str(config_directory() / 'simulated_rig.yaml')


class Context:
    """LaunchContext: the values of the arguments, what was started and logged."""

    def __init__(self, given):
        self.launch_configurations = dict(given)
        self.started, self.logged, self.is_shutdown = [], [], False


class Action:
    """What does something with a context when it is visited, if its condition holds."""

    def __init__(self, do, condition=None, **fields):
        self.do, self.condition = do, condition
        vars(self).update(fields)

    def visit(self, context):
        if self.condition is None or self.condition.perform(context).lower() in ('true', '1'):
            self.do(context)


def launch_configuration(name):
    return types.SimpleNamespace(perform=lambda context: context.launch_configurations[name])


def launch_description(entities):
    return Action(lambda context: [entity.visit(context) for entity in entities])


def declare_launch_argument(name, *, default_value=None, description='', choices=None):
    def declare(context):
        value = context.launch_configurations.setdefault(name, default_value)
        if value is None or choices is not None and value not in choices:
            raise RuntimeError(f'Argument "{name}" provided value "{value}" is not valid')
    return Action(declare, name=name)


def opaque_function(*, function):
    return Action(lambda context: launch_description(function(context) or ()).visit(context))


def include_launch_description(path, *, launch_arguments=(), condition=None):
    def include(context):
        context.launch_configurations.update(launch_arguments)
        execute(path, context)
    return Action(include, condition)


def launch_node(*, package, executable, namespace='', parameters=(), arguments=(),
                ros_arguments=(), output='log', emulate_tty=False, on_exit=None, condition=None):
    node = Action(lambda context: context.started.append(node), condition, package=package,
                  executable=executable, namespace=namespace, parameters=parameters,
                  arguments=arguments, ros_arguments=ros_arguments, on_exit=on_exit)
    return node


def process_exited(name, code):
    return types.SimpleNamespace(process_name=name, returncode=code)


MODULES = {
    'launch': {'LaunchContext': Context, 'LaunchDescriptionEntity': Action,
               'LaunchDescription': launch_description},
    'launch.events': {}, 'launch.events.process': {'ProcessExited': process_exited},
    'launch.actions': {
        'DeclareLaunchArgument': declare_launch_argument, 'OpaqueFunction': opaque_function,
        'IncludeLaunchDescription': include_launch_description,
        'LogInfo': lambda *, msg: Action(lambda context: context.logged.append(msg)),
        'Shutdown': lambda *, reason: Action(
            lambda context: setattr(context, 'is_shutdown', True))},
    'launch.conditions': {'IfCondition': lambda predicate_expression: predicate_expression},
    'launch.launch_description_sources': {'PythonLaunchDescriptionSource': lambda path: path},
    'launch.substitutions': {'LaunchConfiguration': launch_configuration},
    'launch_ros': {}, 'launch_ros.actions': {'Node': launch_node}}


def execute(path, context):
    """Execute a launch file as it is."""
    runpy.run_path(str(path))['generate_launch_description']().visit(context)


@pytest.fixture
def ros2_launch(monkeypatch, tmp_path):
    """Return a function that does as `ros2 launch` does, and returns what is started."""
    for name, content in MODULES.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    monkeypatch.setenv('AMENT_PREFIX_PATH', '')

    def ros2_launch(name, *arguments, words=('spm_haptic_master',), context=None):
        path = ROOT / 'launch' / f'{name}.launch.py'
        monkeypatch.setattr(
            sys, 'argv', ['ros2', 'launch', *words, path.name if words else str(path), *arguments])
        context = context or Context({})
        context.launch_configurations.update(word.split(':=', 1) for word in arguments)
        execute(path, context)
        return context.started
    return ros2_launch


@pytest.fixture
def installed(monkeypatch, tmp_path):
    """Return a function that puts executables into a sourced workspace."""
    def installed(*packages):
        for package in packages:
            path = tmp_path / 'ws' / 'lib' / package / package
            path.parent.mkdir(parents=True)
            path.touch(mode=0o755)
        monkeypatch.setenv('AMENT_PREFIX_PATH', f'/no/such:{tmp_path / "ws"}')
    return installed


def executables(started):
    return [(node.namespace, node.executable) for node in started]


def test_a_master_in_one_process_or_three(ros2_launch):
    (master,) = ros2_launch('master', 'source:=sim', f'config:={CALIBRATION}', 'namespace:=left')
    assert (master.package, master.executable, master.namespace) == (
        'spm_haptic_master', 'master', 'left')
    assert master.ros_arguments == ['--params-file', CALIBRATION, '-p', 'source:=sim']
    assert executables(ros2_launch('master', 'source:=sim', 'composed:=false')) == [
        ('', 'encoder_driver'), ('', 'fkm'), ('', 'diagnostics')]


@pytest.mark.parametrize(('name', 'arguments'), [
    ('master', ('source:=sim',)), ('teleop', ('source:=sim', 'arms:=left'))])
def test_the_first_process_to_end_ends_the_launch(ros2_launch, name, arguments):
    for node in ros2_launch(name, *arguments):
        context = Context({})
        for action in node.on_exit(process_exited('fkm-1', 0), context):
            action.visit(context)
        assert context.is_shutdown
        assert node.on_exit(process_exited('fkm-1', 1), context) == []
        with pytest.raises(RuntimeError, match='fkm-1 has ended with exit code 1'):
            node.on_exit(process_exited('fkm-1', 1), Context({}))


def test_two_arms_with_slave_and_pedals(ros2_launch):
    started = ros2_launch(
        'teleop', 'source:=sim', f'left_config:={CALIBRATION}', 'right_slave:=/PSM1',
        'right_slave_pose:=/PSM1/setpoint_cp', 'right_presence:=/coag', 'right_clutch:=/clutch')
    assert executables(started) == [
        ('left', 'master'), ('left', 'sim_slave'), ('right', 'master')]
    left, _, right = (node.ros_arguments for node in started)
    assert CALIBRATION in left and CALIBRATION not in right
    assert [word.split(':', 1)[1] for word in right if word.startswith('teleop:')] == [
        'servo_cp:=/PSM1/servo_cp', 'slave/measured_cp:=/PSM1/setpoint_cp', 'presence:=/coag',
        'clutch:=/clutch']
    assert 'frame_id:=right/spm_base' in right


@pytest.mark.parametrize(('arguments', 'line'), [
    (('left_config:=/no/such.yaml',), 'left_config:=/no/such.yaml; expected an existing file'),
    (('right_calibration:=/no/such.yaml',), 'right_calibration:=/no/such.yaml; expected an'),
    (('left_slave_pose:=/PSM2/setpoint_cp',),
     'left_slave_pose:=/PSM2/setpoint_cp; expected left_slave, too'),
    (('arms:=middle',), 'arms:=middle; expected left, right or left,right')])
def test_an_argument_of_an_arm_is_named_as_itself(ros2_launch, arguments, line):
    context = Context({})
    with pytest.raises(InputError, match=f'^{line}'):
        ros2_launch('teleop', 'source:=sim', *arguments, context=context)
    assert context.started == []


@pytest.mark.parametrize(('name', 'word', 'near'), [
    ('master', 'Source:=can', 'source'), ('teleop', 'config:=rig.yaml', 'left_config'),
    ('display', 'rvis:=false', 'rviz')])
@pytest.mark.parametrize('words', [('spm_haptic_master',), ()])
def test_an_unknown_argument_is_refused_with_the_nearest_name(
        ros2_launch, name, word, near, words):
    context = Context({})
    with pytest.raises(InputError) as error:
        ros2_launch(name, 'source:=sim', word, words=words, context=context)
    assert str(error.value) == f'{word}; expected an argument of {name}.launch.py, such as {near}'
    assert context.started == []


def test_a_file_that_includes_one_of_these_has_arguments_of_its_own(ros2_launch, monkeypatch):
    context = Context({'source': 'sim', 'robot': 'mine'})
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', 'mine', 'mine.launch.py', 'robot:=mine'])
    execute(ROOT / 'launch' / 'master.launch.py', context)
    assert executables(context.started) == [('', 'master')]
    assert executables(ros2_launch('master', 'source:=sim', 'launch-prefix:=xterm')) == [
        ('', 'master')]


def test_a_device_with_its_master_in_rviz(ros2_launch, installed, tmp_path):
    installed('rviz2', 'robot_state_publisher')
    context = Context({})
    started = ros2_launch('display', 'namespace:=/left/', 'composed:=false', context=context)
    assert executables(started) == [
        *(('/left/', name) for name in ('encoder_driver', 'fkm', 'diagnostics')),
        ('left', 'robot_state_publisher'), ('left', 'rviz2')]
    assert 'frame_id:=left/spm_base' in started[1].ros_arguments
    (parameters,) = started[3].parameters
    assert parameters['frame_prefix'] == 'left/'
    assert parameters['robot_description'].lstrip().startswith('<')
    assert started[4].arguments[2:] == ['-f', 'left/spm_base']
    (layout,) = tmp_path.glob('spm_display_*/foxglove_layout.json')
    assert context.logged == [f'layout for Foxglove and Lichtblick: {layout}']
    assert '"/left/state.data"' in layout.read_text()
    assert executables(ros2_launch('display', 'master:=false', 'rviz:=false')) == [
        ('', 'robot_state_publisher')]


@pytest.mark.parametrize(('there', 'absent'), [
    (('robot_state_publisher',), 'rviz2'), (('rviz2',), 'robot_state_publisher'),
    ((), 'robot_state_publisher')])
def test_nothing_starts_where_what_shows_it_is_not_installed(
        ros2_launch, installed, tmp_path, there, absent):
    installed(*there)
    context = Context({})
    with pytest.raises(InputError, match=f'^{absent} is not installed; .*apt install') as error:
        ros2_launch('display', context=context)
    assert '\n' not in str(error.value)
    assert context.started == []
    assert list(tmp_path.glob('spm_display_*')) == []
