# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start the haptic master: driver, forward model and diagnostics, in one process or three."""

import sys

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from spm_haptic_master.nodes.launch_plan import check_arguments, plan
from spm_haptic_master.parameters.files import PACKAGE
from spm_haptic_master.parameters.nodes import SOURCE_SETTING


def end(event: ProcessExited, context: LaunchContext) -> list[Shutdown]:
    """End the launch with its first process; with exit code 1 if that failed."""
    if context.is_shutdown:
        return []
    if event.returncode:
        raise RuntimeError(f'{event.process_name} has ended with exit code {event.returncode}')
    return [Shutdown(reason=f'{event.process_name} has ended')]


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes for the given arguments."""
    check_arguments(sys.argv, __file__, [argument.name for argument in arguments()])
    given = {
        name: LaunchConfiguration(name).perform(context)
        for name in ('source', 'config', 'calibration', 'namespace', 'frame_prefix')
    }
    composed = LaunchConfiguration('composed').perform(context) == 'true'
    return [
        Node(
            package=PACKAGE,
            executable=process.executable,
            namespace=given['namespace'],
            ros_arguments=list(process.arguments),
            output='screen',
            emulate_tty=False,
            on_exit=end,
        )
        for process in plan(**given, composed=composed)
    ]


def arguments() -> list[DeclareLaunchArgument]:
    """Return the arguments that `ros2 launch --show-args` lists."""
    return [
        DeclareLaunchArgument(
            'source',
            default_value='',
            choices=['', *SOURCE_SETTING.allowed],
            description=f'{SOURCE_SETTING.description}; empty: that of the files',
        ),
        DeclareLaunchArgument(
            'config',
            default_value='',
            description='parameter file (YAML) for all nodes: the rig and its encoders',
        ),
        DeclareLaunchArgument(
            'calibration',
            default_value='',
            description='second parameter file, which overrides the first: that of calibrate',
        ),
        DeclareLaunchArgument(
            'namespace', default_value='', description='namespace of nodes and topics, one per arm'
        ),
        DeclareLaunchArgument(
            'frame_prefix',
            default_value='',
            description="what the names of fkm's frames begin with, where the files do not name "
            'them',
        ),
        DeclareLaunchArgument(
            'composed',
            default_value='true',
            choices=['true', 'false'],
            description='true: one process (lower latency); false: one process per node',
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and the nodes."""
    return LaunchDescription([*arguments(), OpaqueFunction(function=nodes)])
