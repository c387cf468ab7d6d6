# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The processes that a launch file starts, from its arguments, checked before any starts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from itertools import pairwise
import os
from pathlib import Path
from typing import NamedTuple

from spm_haptic_master.drives.shared_bus import check_shared_bus
from spm_haptic_master.encoders.decoder_factory import unverified_joints
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.executables import FOLLOWER, PIPELINE
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.nodes.factories import make_motors
from spm_haptic_master.nodes.teleop_factory import make_teleoperation
from spm_haptic_master.parameters import nodes as settings
from spm_haptic_master.parameters import resolver
from spm_haptic_master.parameters.files import PACKAGE
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import geometry_from, GEOMETRY_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters

# Names of the frames that an arm does not share with another one: parameters of `fkm`.
ARM_FRAMES = ('frame_id', 'mounting.platform_frame_id', 'mounting.handle_frame_id')
# Launch arguments that `ros2 launch` makes of its own options.
OPTIONS = ('launch-prefix', 'launch-prefix-filter')
# What the configuration of RViz has where the links' names are those of the frames.
TF_PREFIX = "TF Prefix: ''"


class Process(NamedTuple):
    """
    A process to start.

    Attributes
    ----------
    executable : str
        Name of an executable of the package.
    arguments : tuple of str
        Its ROS arguments, such as `-p`, NAME:=VALUE.

    """

    executable: str  # of the package
    arguments: tuple[str, ...]  # ROS arguments, without namespace


# Topics of `teleop` that are those of the slave, without `slave/`: each has the same name there.
SLAVE_TOPICS = (
    'measured_cp',
    'measured_cf',
    'operating_state',
    'trocar',
    'jaw/measured_js',
    'jaw/servo_jp',
)


class Follower(NamedTuple):
    """What `teleop` of one arm is connected to."""

    slave: str = ''  # namespace, such as /PSM1; empty: the arm's, where a simulated slave starts
    presence: str = ''  # topic of the pedal; empty: `presence` in the namespace of the arm
    clutch: str = ''  # the same of the clutch
    pose: str = ''  # topic of the slave's pose; empty: `measured_cp` in the slave's namespace
    torque: str = ''  # topic of its torque; empty: `measured_cf` in the slave's namespace
    presence_timeout: str = ''  # largest age of the presence, s; empty: that of the files

    def check(self, argument_prefix: str) -> None:
        """
        Refuse a topic of a slave that is simulated.

        Parameters
        ----------
        argument_prefix : str
            Begins the names of the arm's launch arguments in the error.

        Raises
        ------
        InputError
            A topic is given without the slave's namespace.

        """
        self._check_slave(f'{argument_prefix}slave_pose', self.pose, argument_prefix)
        self._check_slave(f'{argument_prefix}slave_torque', self.torque, argument_prefix)

    def _check_slave(
        self,
        name: str,
        given: str,
        argument_prefix: str,
    ) -> None:
        """Raise InputError where a topic of the slave is given without the slave."""
        if given and not self.slave:
            raise InputError(
                f'{name}:={given}; expected '
                f'{argument_prefix}slave, too: without one the slave is simulated'
            )

    def parameters(self) -> list[str]:
        """Return the parameters NAME:=VALUE of `teleop`."""
        given = self.presence_timeout
        if not given:
            return []
        return [f'{settings.PRESENCE_TIMEOUT}:={given}']

    def remaps(self) -> list[tuple[str, str]]:
        """
        Return the topics of `teleop` that have another name, and that name.

        Returns
        -------
        list of tuples of two str
            Name in `teleop`, and name of the topic.

        """
        slave = self.slave.rstrip('/')
        names = {'presence': self.presence, 'clutch': self.clutch}
        if slave:
            names['servo_cp'] = f'{slave}/servo_cp'
            for topic in SLAVE_TOPICS:
                names[f'slave/{topic}'] = f'{slave}/{topic}'
        names['slave/measured_cp'] = self.pose or names.get('slave/measured_cp', '')
        names['slave/measured_cf'] = self.torque or names.get('slave/measured_cf', '')
        return [(topic, name) for topic, name in names.items() if name]


def plan(
    source: str,
    config: str,
    calibration: str,
    namespace: str,
    composed: bool,
    follower: Follower | None = None,
    frame_prefix: str = '',
    argument_prefix: str = '',
) -> list[Process]:
    """
    Return the processes of one arm, after all that would end one of them has been checked.

    Parameters
    ----------
    source : str
        Source of the driver; empty: that of the files.
    config, calibration : str
        Parameter files; the calibration overrides. Empty: none.
    namespace : str
        Of the arm; empty: none.
    composed : bool
        Whether all nodes run in one process.
    follower : Follower, optional
        What `teleop` is connected to; without it `teleop` is not started.
    frame_prefix : str
        Begins the names of the arm's frames where the files do not name them.
    argument_prefix : str
        Begins the names of the arm's launch arguments in errors.

    Returns
    -------
    list of Process
        The processes with their arguments.

    Raises
    ------
    InputError
        A file or a value is missing, has no effect, or differs between two nodes.

    """
    paths = _files(config, calibration, argument_prefix)
    own = _namespace(namespace)
    source_words = []
    if source:
        source_words.append(f'{settings.SOURCE_SETTING.name}:={source}')
    given_words = list(source_words)
    nodes: tuple[str, ...] = PIPELINE
    if follower is not None:
        follower.check(argument_prefix)
        given_words += follower.parameters()
        nodes = (*PIPELINE, FOLLOWER)
    # A file may have parameters of teleop, which is not started without a follower.
    Parameters(
        files=paths,
        arguments=(),
        remaps=own,
    ).check((*PIPELINE, FOLLOWER), settings.ALL_NAMES)
    given = Parameters(
        files=paths,
        arguments=given_words,
        remaps=own,
    )
    _check_values(given, nodes)
    frames = _prefixed_frames(given.of('fkm'), frame_prefix)
    if composed:
        by_process = {'master': nodes}
    else:
        by_process = {node: (node,) for node in nodes}
    processes = []
    for executable, of_process in by_process.items():
        arguments = _file_words(paths, own, of_process)
        arguments += _words(source_words, follower, of_process)
        if 'fkm' in of_process:
            arguments += frames
        processes.append(Process(executable, tuple(arguments)))
    if follower is not None and not follower.slave:
        processes.append(Process('sim_slave', ()))
    return processes


def _check_values(given: Parameters, nodes: Sequence[str]) -> None:
    """Raise InputError for values with which a node would end at its start, alone or beside."""
    checked = {node: _checked(node, given.of(node)) for node in nodes}
    resolver.check_agreement(checked)
    fkm = checked['fkm']
    driver = checked['encoder_driver']
    if fkm['force.enabled'] and 'can.channel' in driver:
        check_shared_bus(fkm, driver)


def _file_words(
    paths: Sequence[str],
    namespace: Sequence[str],
    nodes: Sequence[str],
) -> list[str]:
    """Return the arguments that give a process the files with parameters of its nodes."""
    words = []
    for path in paths:
        parameters = Parameters(
            files=[path],
            arguments=(),
            remaps=namespace,
        )
        if any(parameters.of(node) for node in nodes):
            words += ['--params-file', path]
    return words


def _checked(node: str, given: Mapping[str, object]) -> dict[str, object]:
    """
    Return a node's values; SettingError where it would end at once: the launch ends before.

    Parameters
    ----------
    node : str
        Name of the node.
    given : mapping
        Values given to it by name.

    Returns
    -------
    dict
        Checked values by name.

    """
    if node == 'encoder_driver':
        _, values = resolver.resolve_source(given)
        unverified_joints(values)
        return values
    _, values = resolver.resolve(given, settings.NODE_SETTINGS[node])
    if node == FOLLOWER:
        make_teleoperation(values)
    elif node == 'fkm' and values['force.enabled']:
        make_motors(values)
    return values


def _prefixed_frames(values: Mapping[str, object], prefix: str) -> list[str]:
    """Return the arguments that name the frames of `fkm` as robot_state_publisher does."""
    if not prefix:
        return []
    words = []
    for setting in FKM_SETTINGS:
        if setting.name in ARM_FRAMES and setting.name not in values:
            words += ['-p', f'{setting.name}:={prefix}{setting.default}']
    return words


def rviz_config(template: str, namespace: str) -> str:
    """
    Return the configuration of RViz for an arm.

    Parameters
    ----------
    template : str
        The configuration without a namespace, config/display.rviz.
    namespace : str
        Namespace without slashes at its ends; empty: none.

    Returns
    -------
    str
        The configuration, with the namespace before the names of the links.

    """
    return template.replace(TF_PREFIX, f"TF Prefix: '{namespace}'")


def _words(
    source: Sequence[str],
    follower: Follower | None,
    names: Sequence[str],
) -> list[str]:
    """Return the arguments of a process beside its files: parameters, and topics of `teleop`."""
    words: list[str] = []
    if source and PIPELINE[0] in names:
        words += ['-p', *source]
    if follower is None or FOLLOWER not in names:
        return words
    if len(names) > 1:
        words += ['-p', f'{settings.MASTER_SETTINGS[0].name}:=true']
    for parameter in follower.parameters():
        words += ['-p', parameter]
    for topic, name in follower.remaps():
        words += ['-r', f'{FOLLOWER}:{topic}:={name}']
    return words


def source_to_show(
    source: str,
    config: str,
    calibration: str,
) -> str:
    """
    Return the source of a device to show: a simulation only without a rig's files.

    Parameters
    ----------
    source, config, calibration : str
        As of `plan`.

    Returns
    -------
    str
        The source; empty: that of the files.

    """
    if source or config or calibration:
        return source
    return 'sim'


def mechanism(
    config: str,
    calibration: str,
    namespace: str,
) -> Geometry:
    """
    Return the mechanism that the files of one arm give its nodes.

    Parameters
    ----------
    config, calibration, namespace : str
        As of `plan`.

    Returns
    -------
    Geometry
        That of `fkm`.

    Raises
    ------
    InputError
        A file is missing or cannot be read, or the mechanism cannot be assembled.

    """
    given = Parameters(
        files=_files(config, calibration),
        arguments=(),
        remaps=_namespace(namespace),
    ).of('fkm')
    _, values = resolver.resolve(given, GEOMETRY_SETTINGS)
    return geometry_from(values)


def check_arguments(
    command_line: Sequence[str],
    file: str,
    names: Collection[str],
) -> None:
    """
    Refuse launch arguments that a launch file does not have: `ros2 launch` ignores them.

    Parameters
    ----------
    command_line : sequence of str
        That of `ros2 launch`. Where another file includes this one, the arguments are that file's,
        and nothing is refused.
    file : str
        The launch file.
    names : collection of str
        Its arguments.

    Raises
    ------
    InputError
        An argument is none of them.

    """
    path = Path(file)
    for word in _behind_file(command_line, path):
        name, given, _ = word.partition(':=')
        if not given or name in names or name in OPTIONS:
            continue
        near = get_close_matches(name, names, n=1) or sorted(names)
        raise InputError(f'{word}; expected an argument of {path.name}, such as {", ".join(near)}')


def _behind_file(command_line: Sequence[str], path: Path) -> Sequence[str]:
    """
    Return the words behind a launch file on a command line; none where it is not there.

    Parameters
    ----------
    command_line : sequence of str
        That of `ros2 launch`.
    path : Path
        The launch file, which is named behind the package or by its path.

    """
    for number, (before, word) in enumerate(pairwise(command_line), 1):
        given = Path(word)
        is_same = before == PACKAGE or given.resolve() == path.resolve()
        if given.name == path.name and is_same:
            return command_line[number:]
    return ()


def check_installed(package: str, cure: str) -> None:
    """
    Refuse to start a package that is not installed.

    Parameters
    ----------
    package : str
        The package, which has an executable of its own name.
    cure : str
        What to do, in the error.

    Raises
    ------
    InputError
        No installation of it is found.

    """
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    for prefix in filter(None, prefixes):
        executable = Path(prefix, 'lib', package, package)
        if os.access(executable, os.X_OK):
            return
    raise InputError(f'{package} is not installed; {cure}')


def _namespace(namespace: str) -> list[str]:
    """Return the remapping to a namespace; nothing for none."""
    name = namespace.strip('/')
    if not name:
        return []
    return [f'__ns:=/{name}']


def _files(
    config: str,
    calibration: str,
    argument_prefix: str = '',
) -> list[str]:
    """Return the absolute paths of the given parameter files; InputError where one is missing."""
    found = []
    for name, given in (('config', config), ('calibration', calibration)):
        if not given:
            continue
        path = Path(os.path.expanduser(given)).absolute()
        if not path.is_file():
            kind = 'it is a directory' if path.is_dir() else 'it does not exist'
            raise InputError(
                f'{argument_prefix}{name}:={given}; expected an existing file ({path}: {kind})'
            )
        found.append(str(path))
    return found
