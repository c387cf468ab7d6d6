# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The processes that a launch file starts, from its arguments, checked before any starts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
import os
from pathlib import Path

from spm_haptic_master.drives.plan import check_shared_bus
from spm_haptic_master.encoders.decoder_factory import unverified_joints
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.executables import FOLLOWER, PIPELINE
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.nodes.force_factory import make_motors
from spm_haptic_master.nodes.teleop_factory import make_teleoperation
from spm_haptic_master.parameters.files import PACKAGE
from spm_haptic_master.parameters.geometry import geometry_from, GEOMETRY_SETTINGS
from spm_haptic_master.parameters.nodes import (
    ALL_NAMES,
    FKM_SETTINGS,
    MASTER_SETTINGS,
    NODE_SETTINGS,
    SOURCE_SETTING,
)
from spm_haptic_master.parameters.resolver import (
    check_agreement,
    Parameters,
    resolve,
    resolve_source,
)

# Names of the frames that an arm does not share with another one: parameters of `fkm`.
ARM_FRAMES = ('frame_id', 'mounting.platform_frame_id', 'mounting.handle_frame_id')
# Launch arguments that `ros2 launch` makes of its own options.
OPTIONS = ('launch-prefix', 'launch-prefix-filter')
# What the configuration of RViz has where the links' names are those of the frames.
TF_PREFIX = "TF Prefix: ''"


@dataclass(frozen=True, slots=True)
class Process:
    """
    A process to start.

    Attributes
    ----------
    executable : str
        Executable of the package.
    arguments : tuple of str
        ROS arguments, without namespace.

    """

    executable: str
    arguments: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Follower:
    """
    What `teleop` of one arm is connected to.

    Attributes
    ----------
    slave : str
        Namespace of the slave, such as /PSM1; empty: that of the arm, where a simulated slave is
        started.
    presence, clutch : str
        Topics of the pedals; empty: `presence` and `clutch` in the namespace of the arm.
    pose : str
        Topic of the slave's pose, such as /PSM1/setpoint_cp; empty: `measured_cp` in the namespace
        of the slave.

    """

    slave: str = ''
    presence: str = ''
    clutch: str = ''
    pose: str = ''

    def remaps(self) -> list[tuple[str, str]]:
        """Return the topics of `teleop` that have another name, and that name."""
        slave = self.slave.rstrip('/')
        pairs = [('servo_cp', slave and f'{slave}/servo_cp'),
                 ('slave/measured_cp', self.pose or slave and f'{slave}/measured_cp'),
                 ('presence', self.presence), ('clutch', self.clutch)]
        return [(topic, name) for topic, name in pairs if name]


def plan(source: str, config: str, calibration: str, namespace: str, composed: bool,
         follower: Follower | None = None, frame_prefix: str = '',
         argument_prefix: str = '') -> list[Process]:
    """
    Return the processes of one arm.

    Parameters
    ----------
    source : str
        Source of the joint angles; empty: that of the files.
    config, calibration : str
        Parameter files, in their order, with ~ for the home directory; empty: none.
    namespace : str
        Namespace of all nodes.
    composed : bool
        Whether all nodes run in one process.
    follower : Follower, optional
        What `teleop` is connected to; without it `teleop` is not started.
    frame_prefix : str, optional
        What the names of the arm's frames begin with, where the files do not name them.
    argument_prefix : str, optional
        What the names of the arm's launch arguments begin with, for errors.

    Raises
    ------
    InputError
        A file does not exist, is no parameter file or reaches no node; a value has no effect, or
        differs between two nodes; no source is given; a pose of a slave without the slave.

    """
    paths = [_existing(f'{argument_prefix}{name}', path)
             for name, path in (('config', config), ('calibration', calibration)) if path]
    if follower is not None and follower.pose and not follower.slave:
        raise InputError(f'{argument_prefix}slave_pose:={follower.pose}; expected '
                         f'{argument_prefix}slave, too: without one the slave is simulated')
    own = [f'__ns:=/{namespace.strip("/")}'] if namespace.strip('/') else []
    source_words = [f'{SOURCE_SETTING.name}:={source}'] if source else []
    # A file may have parameters of teleop, which is not started without a follower.
    Parameters(paths, (), own).check((*PIPELINE, FOLLOWER), ALL_NAMES)
    given = Parameters(paths, source_words, own)
    names = PIPELINE if follower is None else (*PIPELINE, FOLLOWER)
    checked = {name: _checked(name, given.of(name)) for name in names}
    check_agreement(checked)
    if checked['fkm']['force.enabled'] and 'can.channel' in checked['encoder_driver']:
        check_shared_bus(checked['fkm'], checked['encoder_driver'])
    frames = _prefixed_frames(given.of('fkm'), frame_prefix)
    processes = {'master': names} if composed else {name: (name,) for name in names}
    found = [Process(executable, (
        *(word for path in paths
          if any(Parameters([path], (), own).of(name) for name in of_process)
          for word in ('--params-file', path)),
        *(_words(source_words, follower, of_process)), *(frames if 'fkm' in of_process else ())))
        for executable, of_process in processes.items()]
    if follower is not None and not follower.slave:
        found.append(Process('sim_slave', ()))
    return found


def _checked(node: str, given: Mapping[str, object]) -> dict[str, object]:
    """Return a node's values; SettingError where it would end at once: the launch ends before."""
    if node != 'encoder_driver':
        values = resolve(given, NODE_SETTINGS[node])[1]
        if node == FOLLOWER:
            make_teleoperation(values)
        elif node == 'fkm' and values['force.enabled']:
            make_motors(values)
        return values
    values = resolve_source(given)[1]
    unverified_joints(values)
    return values


def _prefixed_frames(values: Mapping[str, object], prefix: str) -> list[str]:
    """Return the arguments that name the frames of `fkm` as robot_state_publisher does."""
    return [word for setting in FKM_SETTINGS
            if prefix and setting.name in ARM_FRAMES and setting.name not in values
            for word in ('-p', f'{setting.name}:={prefix}{setting.default}')]


def rviz_config(template: str, namespace: str) -> str:
    """
    Return the configuration of RViz for the arm of a namespace.

    Parameters
    ----------
    template : str
        The configuration without namespace, `config/display.rviz`.
    namespace : str
        Namespace without slashes at its ends; empty: none. RViz has it before the name of each
        link, with a slash between.

    """
    return template.replace(TF_PREFIX, f"TF Prefix: '{namespace}'")


def _words(source: Sequence[str], follower: Follower | None, names: Sequence[str]) -> list[str]:
    """Return the arguments of a process beside its files: parameters, and topics of `teleop`."""
    words = ['-p', *source] if source and PIPELINE[0] in names else []
    if follower is not None and FOLLOWER in names:
        if len(names) > 1:
            words += ['-p', f'{MASTER_SETTINGS[0].name}:=true']
        for topic, name in follower.remaps():
            words += ['-r', f'{FOLLOWER}:{topic}:={name}']
    return words


def source_to_show(source: str, config: str, calibration: str) -> str:
    """
    Return the source of a device that is to be shown: a simulation only without a rig's files.

    Parameters
    ----------
    source, config, calibration
        As of `plan`.

    """
    return source or ('' if config or calibration else 'sim')


def mechanism(config: str, calibration: str, namespace: str) -> Geometry:
    """
    Return the mechanism that the files of one arm give its nodes.

    Parameters
    ----------
    config, calibration, namespace
        As of `plan`.

    Raises
    ------
    InputError
        As `plan`, of a file; the mechanism is none.

    """
    paths = [_existing(name, path)
             for name, path in (('config', config), ('calibration', calibration)) if path]
    own = [f'__ns:=/{namespace.strip("/")}'] if namespace.strip('/') else []
    return geometry_from(resolve(Parameters(paths, (), own).of('fkm'), GEOMETRY_SETTINGS)[1])


def check_arguments(command_line: Sequence[str], file: str, names: Collection[str]) -> None:
    """
    Refuse launch arguments that a launch file does not have: `ros2 launch` ignores them.

    Parameters
    ----------
    command_line : sequence of str
        That of `ros2 launch`. If it starts another file, which includes this one, the arguments
        are that file's, and nothing is refused.
    file : str
        Path of the launch file.
    names : collection of str
        Its arguments.

    Raises
    ------
    InputError
        An argument has another name.

    """
    path = Path(file)
    started = [number for number, (before, word) in enumerate(
        zip(command_line, command_line[1:], strict=False), 1) if Path(word).name == path.name
        and (before == PACKAGE or Path(word).resolve() == path.resolve())]
    for word in command_line[started[0]:] if started else ():
        name, given, _ = word.partition(':=')
        if given and name not in (*names, *OPTIONS):
            near = ', '.join(get_close_matches(name, names, n=1) or sorted(names))
            raise InputError(f'{word}; expected an argument of {path.name}, such as {near}')


def check_installed(package: str, cure: str) -> None:
    """
    Refuse to start what is not there: `ros2 launch` would have started other processes before.

    Parameters
    ----------
    package : str
        Package with an executable of its own name.
    cure : str
        What to do without it.

    Raises
    ------
    InputError
        No workspace that is sourced has the executable.

    """
    prefixes = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    if not any(os.access(Path(prefix, 'lib', package, package), os.X_OK) for prefix in prefixes):
        raise InputError(f'{package} is not installed; {cure}')


def _existing(name: str, path: str) -> str:
    """Return the path of a file, absolute; InputError if there is none."""
    try:
        found = Path(path).expanduser().absolute()
    except RuntimeError as error:
        raise InputError(f'{name}:={path}; expected an existing file ({error})') from error
    if not found.is_file():
        kind = 'it is a directory' if found.is_dir() else 'it does not exist'
        raise InputError(f'{name}:={path}; expected an existing file ({found}: {kind})')
    return str(found)
