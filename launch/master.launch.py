# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start the haptic master: driver, forward model and diagnostics, in one process or three."""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = 'spm_haptic_master'
APART = ('encoder_driver', 'fkm', 'diagnostics')


def nodes(context):
    """Return the nodes for the arguments given."""
    given = {name: LaunchConfiguration(name).perform(context)
             for name in ('source', 'config', 'calibration', 'namespace', 'composed')}
    # In this order, so that the source asked for is the one that runs, whatever the file says.
    parameters = [*filter(None, [given['config'], given['calibration']]),
                  {'source': given['source']}]
    executables = ('master',) if given['composed'].lower() in ('true', '1') else APART
    return [Node(package=PACKAGE, executable=executable, namespace=given['namespace'],
                 parameters=parameters, output='screen', emulate_tty=False)
            for executable in executables]


def generate_launch_description():
    """Declare the arguments (ros2 launch --show-args) and make the nodes."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'source', default_value='can', choices=['can', 'replay', 'sim'],
            description='where the joint angles come from'),
        DeclareLaunchArgument(
            'config', default_value='',
            description='parameter file (YAML) for all nodes: the rig and its encoders'),
        DeclareLaunchArgument(
            'calibration', default_value='',
            description='a second one that comes after it: what calibrate wrote'),
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of nodes and topics, one per arm'),
        DeclareLaunchArgument(
            'composed', default_value='true', choices=['true', 'false'],
            description='one process (shorter latency), or one process a node'),
        OpaqueFunction(function=nodes),
    ])
