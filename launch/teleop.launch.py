# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start the tele-operation of one or two arms: a master, `teleop` and its pedals for each."""

import sys

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes.launch_plan import check_arguments, Follower, plan
from spm_haptic_master.parameters.files import PACKAGE
from spm_haptic_master.parameters.nodes import SOURCE_SETTING

# The arms, by their namespaces, and the arguments that each has of its own.
ARMS = ('left', 'right')
OWN = {
    'config': 'parameter file (YAML) of the arm: its rig, its encoders, its registration',
    'calibration': 'second parameter file, which overrides the first: that of calibrate',
    'slave': 'namespace of its slave, such as /PSM2; empty: a simulated slave is started',
    'slave_pose': 'topic of the pose of its slave, such as /PSM2/setpoint_cp; empty: measured_cp '
    'in the namespace of its slave',
    'slave_torque': 'topic of the torque of its slave, such as /PSM2/body/measured_cf; empty: '
    'measured_cf in the namespace of its slave',
    'presence': 'topic of the pedal that shows presence (sensor_msgs/Joy); empty: ARM/presence',
    'presence_timeout': 'largest age of the presence, s; 0.0: any, for a pedal that publishes '
    'changes only; empty: teleop.presence_timeout of the files',
    'clutch': 'topic of the clutch (sensor_msgs/Joy); empty: ARM/clutch',
}


def end(event: ProcessExited, context: LaunchContext) -> list[Shutdown]:
    """End the launch with its first process; with exit code 1 if that failed."""
    if context.is_shutdown:
        return []
    if event.returncode:
        raise RuntimeError(f'{event.process_name} has ended with exit code {event.returncode}')
    return [Shutdown(reason=f'{event.process_name} has ended')]


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes for the given arguments."""

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    check_arguments(sys.argv, __file__, [argument.name for argument in arguments()])
    arms = [arm.strip() for arm in given('arms').split(',')]
    for arm in arms:
        if arm not in ARMS or arms.count(arm) > 1:
            raise InputError(f'arms:={given("arms")}; expected left, right or left,right')
    found = []
    for arm in arms:
        own = {name: given(f'{arm}_{name}') for name in OWN}
        follower = Follower(
            slave=own['slave'],
            presence=own['presence'],
            clutch=own['clutch'],
            pose=own['slave_pose'],
            torque=own['slave_torque'],
            presence_timeout=own['presence_timeout'],
        )
        found += [
            Node(
                package=PACKAGE,
                executable=process.executable,
                namespace=arm,
                ros_arguments=list(process.arguments),
                output='screen',
                emulate_tty=False,
                on_exit=end,
            )
            for process in plan(
                given('source'),
                own['config'],
                own['calibration'],
                arm,
                given('composed') == 'true',
                follower,
                frame_prefix=f'{arm}/',
                argument_prefix=f'{arm}_',
            )
        ]
    return found


def arguments() -> list[DeclareLaunchArgument]:
    """Return the arguments that `ros2 launch --show-args` lists."""
    return [
        DeclareLaunchArgument(
            'arms',
            default_value=','.join(ARMS),
            description='arms to start, by their namespaces: left, right or left,right',
        ),
        DeclareLaunchArgument(
            'source',
            default_value='',
            choices=['', *SOURCE_SETTING.allowed],
            description=f'{SOURCE_SETTING.description}; empty: that of the files',
        ),
        DeclareLaunchArgument(
            'composed',
            default_value='true',
            choices=['true', 'false'],
            description='true: one process an arm (lower latency); false: one process per node',
        ),
        *(
            DeclareLaunchArgument(f'{arm}_{name}', default_value='', description=text)
            for arm in ARMS
            for name, text in OWN.items()
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and the nodes."""
    return LaunchDescription([*arguments(), OpaqueFunction(function=nodes)])
