# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The one resolver of parameters: package defaults < parameter files in their order < `-p`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
import difflib
from itertools import pairwise
from pathlib import Path
import re
from typing import Any, NoReturn

from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.parameters.encoders import extended, for_sensors, sensors_of
from spm_haptic_master.parameters.files import (
    argument_section,
    read_sections,
    Section,
    source_defaults,
)
from spm_haptic_master.parameters.nodes import (
    ALL_NAMES,
    BUS_AND_LAYOUT,
    MASTER_SETTINGS,
    NODE_SETTINGS,
    process_settings,
    SOURCE_SETTING,
    SOURCE_SETTINGS,
)
from spm_haptic_master.parameters.setting import REMOVED, Setting

DRIVER = 'encoder_driver'  # node whose parameters most tools take
# Prefix of the names that ROS has for a node's QoS; no publisher or subscription here takes them.
QOS_PREFIX = 'qos_overrides.'
# Fault of an argument for another program or source.
NO_EFFECT = 'ignored: this program has no such parameter as started (see --help)'
# Part of a name; a node, a namespace, a topic, the left side of a remapping, as in ROS.
PART = r'(?!\w*__)[A-Za-z_]\w*'
NODE_NAME = re.compile(PART, re.ASCII)
NAMESPACE = re.compile(f'/|(/{PART})+', re.ASCII)
TOPIC = re.compile(f'(~?/)?{PART}(/{PART})*', re.ASCII)
REMAPPED = re.compile(
    f'(({PART}):)?(__ns|__node|__name|(ros(topic|service)://)?{TOPIC.pattern})', re.ASCII
)
# Most characters of a new name: DDS has 247 for namespace, node and service together.
LONGEST_NAME = 100


class Parameters:
    """
    Values of the nodes of one process, from files and arguments.

    Parameters
    ----------
    files : iterable of str or Path
        Parameter files; a later one overrides an earlier one.
    arguments : iterable of str
        What stands behind `-p`: NAME:=VALUE or NODE:NAME:=VALUE; they override the files.
    remaps : sequence of str
        What stands behind `-r`: FROM:=TO, such as __ns:=/left.

    Raises
    ------
    InputError
        A file or an argument cannot be read, as of `read_sections`; a remapping is not valid.

    """

    def __init__(
        self,
        files: Iterable[str | Path] = (),
        arguments: Iterable[str] = (),
        remaps: Sequence[str] = (),
    ) -> None:
        self._sections = [
            *(section for path in files for section in read_sections(path)),
            *map(argument_section, arguments),
        ]
        self._remaps = [_remap(text) for text in remaps]

    def full_name(self, node: str) -> str:
        """
        Return the fully qualified name of a node after remapping.

        As in rcl, the first remapping that fits is used.

        Parameters
        ----------
        node : str
            Name before remapping.

        Returns
        -------
        str
            Namespace and name, such as /left/fkm.

        """
        name = self._remapped('__node', node, node)
        return f'{self._remapped("__ns", name, "/").rstrip("/")}/{name}'

    def _remapped(
        self,
        what: str,
        node: str,
        default: str,
    ) -> str:
        """
        Return the first value for a node; rcl asks for `__ns` by its name after `__node`.

        Parameters
        ----------
        what : str
            `__node` or `__ns`.
        node : str
            Name of the node: for `__ns` the one after `__node`.
        default : str
            Value without a remapping.

        Returns
        -------
        str
            Name or namespace.

        """
        return next(
            (
                value
                for of_node, name, value in self._remaps
                if name == what and of_node in ('', node)
            ),
            default,
        )

    def of(self, node: str) -> dict[str, object]:
        """
        Return what was given to a node.

        Parameters
        ----------
        node : str
            Name of the node before remapping.

        Returns
        -------
        dict
            The values by name, not yet checked by a setting.

        Raises
        ------
        InputError
            Two files differ in the bus or the layout of the encoders.

        """
        reaching = self._reaching([node])
        for name in sorted(BUS_AND_LAYOUT):
            _check_files(name, [section for section in reaching if name in section.values])
        return {name: value for section in reaching for name, value in section.values.items()}

    def check(self, nodes: Sequence[str], names: Collection[str]) -> None:
        """
        Refuse what was given and has no effect.

        Parameters
        ----------
        nodes : sequence of str
            Names of the nodes of the process before remapping.
        names : collection of str
            Names of the parameters that they have.

        Raises
        ------
        InputError
            A file or an argument reaches none of the nodes, or two nodes have one name.
        SettingError
            A name is no parameter of the node that it is given to.

        """
        by_name = self._by_full_name(nodes)
        reaching = self._reaching(nodes)
        reached = {section.origin for section in reaching}
        for section in self._sections:
            if section.origin not in reached:
                self._refuse_origin(section.origin, list(by_name))
        for section in self._sections:
            if section not in reaching:
                _check_other(section)
            elif section.nodes.endswith('*'):
                _check_names(section, 'this program', names, ALL_NAMES)
            else:
                node = next(by_name[name] for name in by_name if section.reaches(name))
                _check_names(section, node, _own_names(node))

    def _by_full_name(self, nodes: Sequence[str]) -> dict[str, str]:
        """Return the nodes by their full names; InputError where two have one name."""
        by_name: dict[str, str] = {}
        for node in nodes:
            name = self.full_name(node)
            if name in by_name:
                raise InputError(
                    f'remapping __node: several nodes would be {name}; expected one node of '
                    f'{", ".join(nodes)}, such as {nodes[0]}:__node:=NAME'
                )
            by_name[name] = node
        return by_name

    def _refuse_origin(self, origin: str, names: Sequence[str]) -> NoReturn:
        """
        Raise InputError for a file or an argument that reaches none of the nodes.

        Parameters
        ----------
        origin : str
            The file or the argument.
        names : sequence of str
            Fully qualified names of the nodes of the process.

        Raises
        ------
        InputError
            In every case.

        """
        found = ', '.join(each.nodes for each in self._sections if each.origin == origin)
        raise InputError(
            f'{origin}: none of its entries reaches a node of this process; '
            f'it has {found}, expected /** or {" or ".join(names)}'
        )

    def unused(self, nodes: Mapping[str, Collection[str]]) -> list[str]:
        """
        Return the arguments that reach no node (fully qualified) with such a parameter.

        Parameters
        ----------
        nodes : mapping
            Names of the parameters of each node, by its fully qualified name.

        Returns
        -------
        list of str
            Arguments as `-p NAME:=VALUE`; entries of files may be for other programs.

        """
        return [
            section.origin
            for section in self._sections
            if section.is_argument
            and not any(
                section.values.keys() & names
                for node, names in nodes.items()
                if section.reaches(node)
            )
        ]

    def _reaching(self, nodes: Sequence[str]) -> list[Section]:
        """Return the sections that at least one of the nodes takes, in their order."""
        full_names = [self.full_name(node) for node in nodes]
        return [section for section in self._sections if any(map(section.reaches, full_names))]


def _own_names(node: str) -> set[str]:
    """Return the names of the parameters of a node, those of its process included."""
    # `master` asks fkm for its own parameters.
    own = (*process_settings(node), *(MASTER_SETTINGS if node == 'fkm' else ()))
    return {setting.name for setting in own}


def _check_files(name: str, sections: Sequence[Section]) -> None:
    """
    Raise InputError where two files differ in the value of a name that no argument gives.

    Parameters
    ----------
    name : str
        A name of BUS_AND_LAYOUT.
    sections : sequence of Section
        Sections that have a value of it, in their order.

    """
    if any(section.is_argument for section in sections):
        return
    by_origin = {section.origin: section.values[name] for section in sections}
    for (first, one), (second, other) in pairwise(by_origin.items()):
        if one != other:
            raise InputError(
                f'{name} is {_as_written(name, one)} in {first} and {_as_written(name, other)} '
                f'in {second}; expected the same: a '
                'calibration holds for the bus and the encoders that it was measured with (undo '
                'the change, or calibrate again)'
            )


def _as_written(name: str, value: object) -> str:
    """Return a value as files have it: identifiers in hexadecimal digits."""
    if not name.endswith('id'):
        return str(value)
    return re.sub(r'\d+', lambda found: f'{int(found[0]):#x}', str(value))


def _check_other(section: Section) -> None:
    """
    Raise InputError where a section for no node of the process seems a slip of the pen.

    A node of this package with a prefix or suffix, such as fkm_left, is not a slip.

    Parameters
    ----------
    section : Section
        A section that reaches no node of the process.

    """
    last = section.nodes.rpartition('/')[2]
    if any(f'_{node}_' in f'_{last}_' for node in NODE_SETTINGS):
        return  # such as fkm of another process or arm, or fkm_left
    near = [
        node
        for node in difflib.get_close_matches(last, NODE_SETTINGS, cutoff=0.65)
        if abs(len(node) - len(last)) <= 2
    ]
    if last == 'master':
        near = ['**']
    if near:
        expected = f'{section.nodes.removesuffix(last)}{near[0]}'.replace('/**/**', '/**')
        raise InputError(
            f'{section.origin}: section {section.nodes} reaches no node; expected '
            f'{expected}, or a name less like it'
        )


def _check_names(
    section: Section,
    owner: str,
    names: Collection[str],
    others: Collection[str] = (),
) -> None:
    """
    Raise SettingError for the first name of a section that is not known.

    Parameters
    ----------
    section : Section
        The section.
    owner : str
        Whose parameters they are, in the error message.
    names : collection of str
        Names that are accepted.
    others : collection of str
        Names that are accepted, too, and proposed last.

    """
    for name, value in section.values.items():
        if name.startswith(QOS_PREFIX):
            raise SettingError(name, value, 'no override: the QoS of this package is fixed')
        if name in REMOVED:
            raise SettingError(name, value, f'{REMOVED[name]} ({section.origin}, {section.nodes})')
        if name not in names and name not in others:
            expected = f'the section of a node that has it: {owner} does not'
            if name not in ALL_NAMES:
                near = ', '.join(similar(name, names, others))
                expected = f'a parameter of {owner}, such as {near}'
            raise SettingError(name, value, f'{expected} ({section.origin}, {section.nodes})')


def similar(name: str, names: Collection[str], others: Collection[str] = ()) -> list[str]:
    """
    Return the names most like one that nobody has: those beginning with it first.

    Parameters
    ----------
    name : str
        The unknown name.
    names : collection of str
        Names of the program, or of the node.
    others : collection of str
        Names that are accepted, too: proposed where none of the first is like it.

    Returns
    -------
    list of str
        One to three of these names, if there are any.

    """
    return (
        [each for each in sorted(names) if each.startswith(name)]
        or difflib.get_close_matches(name, names, n=3)
        or difflib.get_close_matches(name, others, n=3)
        or sorted(names)
    )[:3]


def resolve(
    given: Mapping[str, object],
    settings: tuple[Setting, ...],
    defaults: Mapping[str, object] | None = None,
) -> tuple[tuple[Setting, ...], dict[str, Any]]:
    """
    Return a checked value of each setting, for the number of sensors that was given.

    Parameters
    ----------
    given : mapping
        Given values by name; `sensors` is the number of sensors.
    settings : tuple of Setting
        The settings, with lists for four sensors.
    defaults : mapping, optional
        Values that replace the defaults of the settings.

    Returns
    -------
    tuple of tuple and dict
        The settings with lists for `sensors`, and the values by name.

    Raises
    ------
    SettingError
        A value is missing or invalid.

    """
    settings = for_sensors(settings, sensors_of(given))
    defaults = extended(defaults or {}, settings)
    return settings, {
        each.name: each.check(given.get(each.name, defaults.get(each.name, each.default)))
        for each in settings
    }


def source_of(given: Mapping[str, object]) -> str:
    """
    Return the source of a driver's parameters.

    Parameters
    ----------
    given : mapping
        Given values by name.

    Returns
    -------
    str
        can, replay or sim.

    Raises
    ------
    SettingError
        The source is missing or unknown.

    """
    return str(SOURCE_SETTING.check(given.get(SOURCE_SETTING.name)))


def resolve_source(
    given: Mapping[str, object],
) -> tuple[tuple[Setting, ...], dict[str, Any]]:
    """
    Return the settings of the driver's source and their values, as `resolve`.

    Parameters
    ----------
    given : mapping
        Given values of the driver by name; those that are missing are of config/SOURCE.yaml.

    Returns
    -------
    tuple of tuple and dict
        The settings of the source, and the values by name.

    Raises
    ------
    SettingError
        A value is missing or invalid.

    """
    source = source_of(given)
    return resolve(given, SOURCE_SETTINGS[source], source_defaults(source))


def check_agreement(values: Mapping[str, Mapping[str, object]]) -> None:
    """
    Check that the nodes of a device have the same values of the parameters that they share.

    Parameters
    ----------
    values : mapping
        The checked values by name, of each node by its name.

    Raises
    ------
    SettingError
        Two nodes differ in a parameter; those of the process (`realtime.*`) may.

    """
    first: dict[str, tuple[str, object]] = {}
    for node, of_node in values.items():
        for name, value in of_node.items():
            other, expected = first.setdefault(name, (node, value))
            if value != expected and not name.startswith('realtime.'):
                raise SettingError(
                    name,
                    value,
                    f'the same value in {node} as in {other} '
                    f'({expected!r}): give it for all nodes, /**',
                )


def read_parameters(path: str | Path) -> dict[str, object]:
    """
    Return the encoder driver's parameters in a ROS parameter file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    dict
        Values by name, not yet checked by a setting.

    Raises
    ------
    InputError
        The file cannot be read, or has nothing for the driver.
    SettingError
        A name is no parameter of the driver, or under a wildcard that of no node.

    """
    found = Parameters([path])
    found.check([DRIVER], ALL_NAMES)
    return found.of(DRIVER)


def _remap(text: str) -> tuple[str, str, str]:
    """
    Return node, topic or `__ns` or `__node`, and new name of a remapping.

    Parameters
    ----------
    text : str
        FROM:=TO, as after `-r`.

    Returns
    -------
    tuple of three str
        The node comes from NODE:FROM:=TO, and is empty without one.

    Raises
    ------
    InputError
        The text is not a remapping, or a name is not valid in ROS.

    """
    left, separator, value = text.partition(':=')
    if not separator or not left or not value:
        raise InputError(f"-r '{text}'; expected FROM:=TO")
    found = REMAPPED.fullmatch(left)
    node, what = (found[2] or '', found[3]) if found else ('', '')
    what = '__node' if what == '__name' else what
    pattern, expected = {
        '__ns': (
            NAMESPACE,
            'a namespace such as __ns:=/left, of letters, digits and single _, '
            'with a slash before each part',
        ),
        '__node': (NODE_NAME, 'a name of letters, digits and single _'),
    }.get(
        what,
        (
            TOPIC,
            'FROM:=TO with names of letters, digits and single _, such as '
            'orientation:=/left/orientation',
        ),
    )
    if not found or not pattern.fullmatch(value) or len(value) > LONGEST_NAME:
        raise InputError(f"-r '{text}'; expected {expected}, of at most {LONGEST_NAME} characters")
    return node, what, value
