# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS parameter files read without ROS: the package's configuration, and a rig's own."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import re
import sys
from typing import Any

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import NUMBER_WORDS
import yaml

PACKAGE = 'spm_haptic_master'
# Node whose parameters the tools and the sources take.
NODE = '/encoder_driver'
# Source that describes the encoders; the other sources replay or simulate them.
ENCODERS_SOURCE = 'can'
# Key below a node's name in a parameter file.
PARAMETERS = 'ros__parameters'
# Regular expressions of the wildcards in a node's name, as rcl has them.
WILDCARDS = {'/**': r'(/\w+)*', '/*': r'/\w+'}


@dataclass(frozen=True, slots=True)
class Section:
    """
    Parameters for the nodes of one name, from a parameter file or from the command line.

    Attributes
    ----------
    origin : str
        The file or argument, for error messages.
    nodes : str
        Name of the nodes, absolute, with wildcards.
    values : mapping of str to object
        Values by dotted name.

    """

    origin: str
    nodes: str
    values: Mapping[str, object]

    def reaches(self, node: str) -> bool:
        """Return whether a node, by its fully qualified name, takes the section."""
        pattern = ''.join(WILDCARDS.get(token, re.escape(token))
                          for token in re.findall(r'/[^/]*', self.nodes))
        return re.fullmatch(pattern, node) is not None


def config_directory() -> Path:
    """Return the directory of the package's config files: of a checkout or an installation."""
    prefixes = [*filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)),
                sys.prefix]
    candidates = [Path(__file__).resolve().parents[1] / 'config',
                  *(Path(prefix) / 'share' / PACKAGE / 'config' for prefix in prefixes)]
    for candidate in candidates:
        if (candidate / 'sim.yaml').is_file():
            return candidate
    raise FileNotFoundError(f'{PACKAGE}: no config/sim.yaml in '
                            + ', '.join(str(candidate) for candidate in candidates))


def source_defaults(source: str) -> dict[str, object]:
    """
    Return the encoder driver's defaults for a source, by parameter name.

    They are those of config/SOURCE.yaml, and for the encoders those of config/can.yaml.
    """
    defaults: dict[str, object] = {}
    for name in dict.fromkeys((ENCODERS_SOURCE, source)):
        defaults |= read_parameters(config_directory() / f'{name}.yaml')
    return defaults


def simulated_rig(sensors: int = 4) -> dict[str, object]:
    """Return the zero counts and directions of simulated encoders, by parameter name."""
    name = f'simulated_rig_{NUMBER_WORDS[sensors]}' if sensors > 4 else 'simulated_rig'
    return read_parameters(config_directory() / f'{name}.yaml')


def read_parameters(path: str | Path, node: str = NODE) -> dict[str, object]:
    """
    Return a node's parameters in a ROS parameter file, by dotted name.

    Raises
    ------
    InputError
        The file cannot be read, is not a parameter file, or has nothing for the node.

    """
    sections = read_sections(path)
    check_reach(sections, [node])
    return effective(sections, node)


def read_sections(path: str | Path) -> list[Section]:
    """
    Return the sections of a ROS parameter file, in their order.

    Raises
    ------
    InputError
        The file cannot be read, or is not a parameter file; a key is given twice, or a value is
        nothing that a parameter can be.

    """
    try:
        with open(path, encoding='utf-8') as file:
            # The loader is SafeLoader's, with fewer kinds of values.
            content = yaml.load(file, _Loader)  # noqa: S506
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InputError(f'{path}: cannot be read: {" ".join(str(error).split())}') from error
    if not isinstance(content, Mapping):
        raise InputError(f'{path}: not a ROS parameter file (NODE: {PARAMETERS}: ...)')
    sections = list(_sections(str(path), '', content))
    names = [section.nodes for section in sections]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f'{path}: section {name} is given twice')
    return sections


def check_reach(sections: Sequence[Section], nodes: Sequence[str]) -> None:
    """
    Refuse a file or an argument of which nothing reaches a node.

    Parameters
    ----------
    sections : sequence of Section
        Sections of all files and arguments.
    nodes : sequence of str
        Fully qualified names of the nodes of the process.

    Raises
    ------
    InputError
        It names the file, its sections and the nodes.

    """
    for origin in dict.fromkeys(section.origin for section in sections):
        own = [section for section in sections if section.origin == origin]
        if not any(section.reaches(node) for section in own for node in nodes):
            raise InputError(
                f'{origin}: none of its entries reaches a node of this process; it has '
                f'{", ".join(section.nodes for section in own)}, expected /** or '
                f'{" or ".join(nodes)}')


def effective(sections: Sequence[Section], node: str) -> dict[str, object]:
    """
    Return the parameters that ROS gives a node, by name, from sections in their order.

    ROS merges sections of one name, in the place of the first, and lets a later name override an
    earlier one. So a value given later, or on the command line, can be overridden by an earlier
    file: that is refused.

    Raises
    ------
    InputError
        A value has no effect because an earlier file overrides it.

    """
    reaching = [section for section in sections if section.reaches(node)]
    by_name: dict[str, dict[str, Section]] = {}
    for section in reaching:
        by_name.setdefault(section.nodes, {}).update(dict.fromkeys(section.values, section))
    winners: dict[str, Section] = {}
    for merged in by_name.values():
        winners |= merged
    order = list(dict.fromkeys(section.origin for section in sections))
    for section in reaching:
        for name in section.values:
            winner = winners[name]
            if order.index(winner.origin) < order.index(section.origin):
                raise InputError(
                    f'{section.origin}: {name} has no effect, because section {winner.nodes} of '
                    f'{winner.origin} overrides it; expected it in that section, or in that of '
                    f'{section.nodes} only')
    return {name: section.values[name] for name, section in winners.items()}


class _Loader(yaml.SafeLoader):
    """A loader that refuses a key given twice, and reads numbers as rcl does."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        """Return the mapping of a node."""
        keys = [key.value for key, _ in node.value]
        for (key, _), name in zip(node.value, keys, strict=True):
            if isinstance(name, str) and keys.count(name) > 1:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key '{name}' is given twice", key.start_mark)
        return super().construct_mapping(node, deep)


# SafeLoader reads 1e3 as a text, and 2026-01-01 as a date.
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith(':timestamp')]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()}
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
    [*'-+.0123456789'])


def parse_value(text: str) -> object:
    """
    Return the value of a parameter on the command line.

    Raises
    ------
    InputError
        It is not valid YAML.

    """
    try:
        return yaml.load(text, _Loader)  # noqa: S506, as above
    except yaml.YAMLError as error:
        raise InputError(f"value '{text}'; expected YAML") from error


def _sections(path: str, prefix: str, tree: Mapping[object, object]) -> Iterator[Section]:
    """Yield the sections of a file; names may be nested, a namespace above its nodes."""
    for name, content in tree.items():
        nodes = f'{prefix}/{str(name).strip("/")}'
        if not isinstance(content, Mapping):
            raise InputError(f'{path}: section {nodes} has no {PARAMETERS}')
        inner = {key: value for key, value in content.items() if key != PARAMETERS}
        if PARAMETERS in content:
            parameters = content[PARAMETERS]
            if not isinstance(parameters, Mapping):
                raise InputError(f'{path}: section {nodes} has no {PARAMETERS}')
            yield Section(path, nodes, dict(_flat(f'{path}: ', parameters)))
        elif not inner:
            raise InputError(f'{path}: section {nodes} has no {PARAMETERS}')
        yield from _sections(path, nodes, inner)


def _flat(origin: str, tree: Mapping[object, object],
          prefix: str = '') -> Iterator[tuple[str, object]]:
    """Yield nested mappings as dotted names and values."""
    for key, value in tree.items():
        name = f'{prefix}{key}'
        if isinstance(value, Mapping):
            yield from _flat(origin, value, f'{name}.')
        else:
            _check_value(f'{origin}{name}', value)
            yield name, value


def _check_value(what: str, value: object) -> None:
    """Raise InputError for a value that no parameter can have."""
    if value is None:
        raise InputError(f'{what} has no value')
    if isinstance(value, list):
        if any(isinstance(element, list | Mapping | None) for element in value):
            raise InputError(f'{what} is {value}; expected a list of single values')
        if len({type(element) for element in value}) > 1:
            raise InputError(f'{what} is {value}; expected a list of one type '
                             '(1.0 beside 2.5, not 1)')


def flat_sections(given: Iterable[tuple[str, str, str]]) -> list[Section]:
    """Return the sections of (node, name, value) on the command line."""
    return [Section(f'-p {name}:={text}', f'/{node.strip("/")}' if node else '/**',
                    {name: parse_value(text)}) for node, name, text in given]
