# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Show the device in RViz: the haptic master, robot_state_publisher and RViz."""

from pathlib import Path
import sys
from tempfile import mkdtemp

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
)
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from spm_haptic_master.description.urdf import describe, foxglove_layout
from spm_haptic_master.nodes.launch_plan import (
    check_arguments,
    check_installed,
    mechanism,
    rviz_config,
    source_to_show,
)
from spm_haptic_master.parameters.files import config_directory

# Arguments that master.launch.py takes, too, and their defaults here.
ARGUMENTS = {'source': '', 'config': '', 'calibration': '', 'namespace': '', 'composed': 'true'}
# What to do without the packages of others.
CURES = {
    'robot_state_publisher': 'apt install ros-jazzy-robot-state-publisher',
    'rviz2': 'apt install ros-jazzy-rviz2, or rviz:=false for Foxglove',
}


def nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the haptic master and the nodes that show it, for the given arguments."""
    check_arguments(sys.argv, __file__, [argument.name for argument in arguments()])
    for package, cure in CURES.items():
        if package != 'rviz2' or LaunchConfiguration('rviz').perform(context) == 'true':
            check_installed(package, cure)
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    given['source'] = source_to_show(given['source'], given['config'], given['calibration'])
    namespace = given['namespace'].strip('/')
    geometry = mechanism(given['config'], given['calibration'], namespace)
    # Two arms in one tree of transforms: each has frames of its own.
    prefix = f'{namespace}/' if namespace else ''
    folder = Path(mkdtemp(prefix='spm_display_'))
    config = folder / 'display.rviz'
    config.write_text(rviz_config((config_directory() / 'display.rviz').read_text(), namespace))
    layout = folder / 'foxglove_layout.json'
    layout.write_text(foxglove_layout((config_directory() / layout.name).read_text(), namespace))
    return [
        LogInfo(msg=f'layout for Foxglove and Lichtblick: {layout}'),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(Path(__file__).with_name('master.launch.py'))),
            launch_arguments={**given, 'frame_prefix': prefix}.items(),
            condition=IfCondition(LaunchConfiguration('master')),
        ),
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            namespace=namespace,
            output='screen',
            parameters=[
                {
                    'robot_description': describe(geometry, folder),
                    'frame_prefix': prefix,
                    'publish_frequency': 60.0,
                }
            ],
        ),
        Node(
            package='rviz2',
            executable='rviz2',
            namespace=namespace,
            output='screen',
            arguments=['-d', str(config), '-f', f'{prefix}spm_base'],
            condition=IfCondition(LaunchConfiguration('rviz')),
        ),
    ]


def arguments() -> list[DeclareLaunchArgument]:
    """Return the arguments that `ros2 launch --show-args` lists."""
    return [
        *(
            DeclareLaunchArgument(
                name, default_value=default, description='as of master.launch.py'
            )
            for name, default in ARGUMENTS.items()
        ),
        DeclareLaunchArgument(
            'master',
            default_value='true',
            choices=['true', 'false'],
            description='false: the haptic master already runs, only show it',
        ),
        DeclareLaunchArgument(
            'rviz',
            default_value='true',
            choices=['true', 'false'],
            description='false: robot_state_publisher alone, for Foxglove',
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and the nodes."""
    return LaunchDescription([*arguments(), OpaqueFunction(function=nodes)])
