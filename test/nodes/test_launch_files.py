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
from types import SimpleNamespace

from harness import ROOT
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.files import config_directory

CALIBRATION = str(config_directory() / 'simulated_rig.yaml')


class Context:
    """LaunchContext: the values of the arguments, what was started and logged."""

    def __init__(self, given=()):
        self.launch_configurations = dict(given)
        self.started = []
        self.logged = []
        self.is_shutdown = False


# An action, and a condition of one, is a function of the context.
def always(context):
    return True


def if_condition(predicate_expression):
    return lambda context: predicate_expression.perform(context).lower() in ('true', '1')


def launch_configuration(name):
    return SimpleNamespace(perform=lambda context: context.launch_configurations[name])


def launch_description(actions):
    return lambda context: [action(context) for action in actions]


def declare_launch_argument(name, *, default_value=None, description='', choices=None):
    def declare(context):
        value = context.launch_configurations.setdefault(name, default_value)
        if value is None or choices is not None and value not in choices:
            raise RuntimeError(f'Argument "{name}" provided value "{value}" is not valid')

    declare.name = name
    return declare


def opaque_function(*, function):
    return lambda context: launch_description(function(context) or ())(context)


def include_launch_description(path, *, launch_arguments=(), condition=always):
    def include(context):
        if condition(context):
            context.launch_configurations.update(launch_arguments)
            execute(path, context)

    return include


def launch_node(
    *,
    package,
    executable,
    namespace='',
    parameters=(),
    arguments=(),
    ros_arguments=(),
    output='log',
    emulate_tty=False,
    on_exit=None,
    condition=always,
):
    node = SimpleNamespace(**locals())
    return lambda context: condition(context) and context.started.append(node)


MODULES = {
    'launch': SimpleNamespace(
        LaunchContext=Context, LaunchDescriptionEntity=object, LaunchDescription=launch_description
    ),
    'launch.events.process': SimpleNamespace(ProcessExited=object),
    'launch.actions': SimpleNamespace(
        DeclareLaunchArgument=declare_launch_argument,
        OpaqueFunction=opaque_function,
        IncludeLaunchDescription=include_launch_description,
        LogInfo=lambda *, msg: lambda context: context.logged.append(msg),
        Shutdown=lambda *, reason: lambda context: setattr(context, 'is_shutdown', True),
    ),
    'launch.conditions': SimpleNamespace(IfCondition=if_condition),
    'launch.launch_description_sources': SimpleNamespace(PythonLaunchDescriptionSource=str),
    'launch.substitutions': SimpleNamespace(LaunchConfiguration=launch_configuration),
    'launch_ros.actions': SimpleNamespace(Node=launch_node),
}


def execute(path, context):
    """Execute a launch file as it is; return the context."""
    try:
        runpy.run_path(str(path))['generate_launch_description']()(context)
    except InputError:
        assert context.started == []
        raise
    return context


@pytest.fixture
def ros2_launch(monkeypatch, tmp_path):
    """Return a function that does as `ros2 launch` does, and returns the context."""
    for name, module in MODULES.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    monkeypatch.setenv('AMENT_PREFIX_PATH', '')

    def ros2_launch(name, *arguments, words=('spm_haptic_master',)):
        path = ROOT / 'launch' / f'{name}.launch.py'
        monkeypatch.setattr(
            sys, 'argv', ['ros2', 'launch', *words, path.name if words else str(path), *arguments]
        )
        return execute(path, Context(word.split(':=', 1) for word in arguments))

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


def executables(context):
    return [(node.namespace, node.executable) for node in context.started]


def test_a_master_in_one_process_or_three(ros2_launch):
    (master,) = ros2_launch(
        'master', 'source:=sim', f'config:={CALIBRATION}', 'namespace:=left'
    ).started
    assert (master.package, master.executable, master.namespace) == (
        'spm_haptic_master',
        'master',
        'left',
    )
    assert master.ros_arguments == ['--params-file', CALIBRATION, '-p', 'source:=sim']
    assert executables(ros2_launch('master', 'source:=sim', 'composed:=false')) == [
        ('', 'encoder_driver'),
        ('', 'fkm'),
        ('', 'diagnostics'),
    ]


@pytest.mark.parametrize(
    ('name', 'arguments'),
    [
        ('master', ('source:=sim',)),
        ('teleop', ('source:=sim', 'arms:=left')),
    ],
)
def test_the_first_process_to_end_ends_the_launch(ros2_launch, name, arguments):
    ended, failed = (SimpleNamespace(process_name='fkm-1', returncode=code) for code in (0, 1))
    for node in ros2_launch(name, *arguments).started:
        context = Context()
        launch_description(node.on_exit(ended, context))(context)
        assert context.is_shutdown
        assert node.on_exit(failed, context) == []
        with pytest.raises(RuntimeError, match='fkm-1 has ended with exit code 1'):
            node.on_exit(failed, Context())


def test_two_arms_with_slave_and_pedals(ros2_launch):
    context = ros2_launch(
        'teleop',
        'source:=sim',
        f'left_config:={CALIBRATION}',
        'right_slave:=/PSM1',
        'right_slave_pose:=/PSM1/setpoint_cp',
        'right_presence:=/coag',
        'right_clutch:=/clutch',
        # A pedal that publishes changes only, and the torque of dVRK.
        'right_presence_timeout:=0.0',
        'right_slave_torque:=/PSM1/body/measured_cf',
    )
    assert executables(context) == [('left', 'master'), ('left', 'sim_slave'), ('right', 'master')]
    left, _, right = (node.ros_arguments for node in context.started)
    assert CALIBRATION in left
    assert CALIBRATION not in right
    assert {word.split(':', 1)[1] for word in right if word.startswith('teleop:')} == {
        'servo_cp:=/PSM1/servo_cp',
        'slave/measured_cp:=/PSM1/setpoint_cp',
        'slave/measured_cf:=/PSM1/body/measured_cf',
        'slave/operating_state:=/PSM1/operating_state',
        'slave/trocar:=/PSM1/trocar',
        'slave/jaw/measured_js:=/PSM1/jaw/measured_js',
        'slave/jaw/servo_jp:=/PSM1/jaw/servo_jp',
        'presence:=/coag',
        'clutch:=/clutch',
    }
    assert 'teleop.presence_timeout:=0.0' in right
    assert not any('presence_timeout' in word for word in left)
    assert 'frame_id:=right/spm_base' in right


def test_the_time_of_a_pedal_is_checked_before_anything_starts(ros2_launch):
    with pytest.raises(InputError, match=r"'teleop.presence_timeout' is 60.*from 0 to 10"):
        ros2_launch('teleop', 'source:=sim', 'arms:=right', 'right_presence_timeout:=60.0')


@pytest.mark.parametrize(
    ('argument', 'expected'),
    [
        ('right_calibration:=/no/such.yaml', 'an existing file'),
        ('left_slave_pose:=/PSM2/setpoint_cp', 'left_slave, too'),
        ('left_slave_torque:=/PSM2/measured_cf', 'left_slave, too'),
        ('arms:=middle', 'left, right or left,right'),
    ],
)
def test_an_argument_of_an_arm_is_named_as_itself(ros2_launch, argument, expected):
    with pytest.raises(InputError, match=f'^{argument}; expected {expected}'):
        ros2_launch('teleop', 'source:=sim', argument)


@pytest.mark.parametrize(
    ('name', 'argument', 'near', 'words'),
    [
        ('master', 'Source:=can', 'source', ()),
        ('teleop', 'config:=rig.yaml', 'left_config', ('spm_haptic_master',)),
        ('display', 'rvis:=false', 'rviz', ('spm_haptic_master',)),
    ],
)
def test_an_unknown_argument_is_refused_with_the_nearest_name(
    ros2_launch, name, argument, near, words
):
    with pytest.raises(InputError) as error:
        ros2_launch(name, 'source:=sim', argument, words=words)
    assert (
        str(error.value) == f'{argument}; expected an argument of {name}.launch.py, such as {near}'
    )


def test_a_file_that_includes_one_of_these_has_arguments_of_its_own(ros2_launch, monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', 'mine', 'mine.launch.py', 'robot:=mine'])
    context = execute(
        ROOT / 'launch' / 'master.launch.py', Context({'source': 'sim', 'robot': 'mine'})
    )
    assert executables(context) == [('', 'master')]
    assert executables(ros2_launch('master', 'source:=sim', 'launch-prefix:=xterm')) == [
        ('', 'master')
    ]


def test_a_device_with_its_master_in_rviz(ros2_launch, installed, tmp_path):
    installed('rviz2', 'robot_state_publisher')
    context = ros2_launch('display', 'namespace:=/left/', 'composed:=false')
    assert executables(context) == [
        *(('/left/', name) for name in ('encoder_driver', 'fkm', 'diagnostics')),
        ('left', 'robot_state_publisher'),
        ('left', 'rviz2'),
    ]
    _, fkm, _, publisher, rviz = context.started
    assert 'frame_id:=left/spm_base' in fkm.ros_arguments
    (parameters,) = publisher.parameters
    assert parameters['frame_prefix'] == 'left/'
    assert parameters['robot_description'].lstrip().startswith('<')
    assert rviz.arguments[2:] == ['-f', 'left/spm_base']
    (layout,) = tmp_path.glob('spm_display_*/foxglove_layout.json')
    assert context.logged == [f'layout for Foxglove and Lichtblick: {layout}']
    assert '"/left/state.data"' in layout.read_text()
    assert executables(ros2_launch('display', 'master:=false', 'rviz:=false')) == [
        ('', 'robot_state_publisher')
    ]


@pytest.mark.parametrize(
    ('there', 'absent'),
    [
        ('robot_state_publisher', 'rviz2'),
        ('rviz2', 'robot_state_publisher'),
    ],
)
def test_nothing_starts_where_what_shows_it_is_not_installed(
    ros2_launch, installed, tmp_path, there, absent
):
    installed(there)
    with pytest.raises(InputError, match=f'^{absent} is not installed; .*apt install') as error:
        ros2_launch('display')
    assert '\n' not in str(error.value)
    assert list(tmp_path.glob('spm_display_*')) == []
