# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start the haptic master: driver, forward model and diagnostics, in one process or three."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from spm_haptic_master.executables import PIPELINE
from spm_haptic_master.node_settings import SOURCE_SETTING
from spm_haptic_master.parameter_files import PACKAGE


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes for the given arguments."""
    given = {name: LaunchConfiguration(name).perform(context)
             for name in ('source', 'config', 'calibration', 'namespace', 'composed')}
    # `source` comes last: it overrides that of the files.
    parameters = [*filter(None, [given['config'], given['calibration']]),
                  {'source': given['source']}]
    executables = ('master',) if given['composed'].lower() in ('true', '1') else PIPELINE
    return [Node(package=PACKAGE, executable=executable, namespace=given['namespace'],
                 parameters=parameters, output='screen', emulate_tty=False)
            for executable in executables]


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments (ros2 launch --show-args) and the nodes."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'source', default_value='can', choices=list(SOURCE_SETTING.allowed),
            description=SOURCE_SETTING.description),
        DeclareLaunchArgument(
            'config', default_value='',
            description='parameter file (YAML) for all nodes: the rig and its encoders'),
        DeclareLaunchArgument(
            'calibration', default_value='',
            description='second parameter file, which overrides the first: that of calibrate'),
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of nodes and topics, one per arm'),
        DeclareLaunchArgument(
            'composed', default_value='true', choices=['true', 'false'],
            description='true: one process (lower latency); false: one process per node'),
        OpaqueFunction(function=nodes),
    ])
