# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS parameter files, read strictly: a value that could be read in two ways is refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
import os
from pathlib import Path
import re
import sys
from typing import Any

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import NUMBER_WORDS
import yaml

PACKAGE = 'spm_haptic_master'
PARAMETERS = 'ros__parameters'  # key below a node's name
ARGUMENT = '-p '  # before an argument, where it is named as the origin of a value
# Regular expressions of the wildcards in a node's name, as rcl has them.
WILDCARDS = {'/**': r'(/\w+)*', '/*': r'/\w+'}
LARGEST_FILE = 1 << 20  # bytes; a rig's has some 5,000
LONGEST_INTEGER = 20  # characters, of -9223372036854775808

# Plain numbers that YAML and rcl read alike, and others that one of them reads as a number.
INTEGER = re.compile(r'[-+]?(0|[1-9]\d*|0[xX][0-9a-fA-F]+)', re.ASCII)
FLOAT = re.compile(
    r'[-+]?((\d+\.\d*|\.\d+)([eE][-+]?\d+)?|\d+[eE][-+]?\d+|\.(inf|Inf|INF))'
    r'|\.(nan|NaN|NAN)',
    re.ASCII,
)
RCL_ONLY = re.compile(
    r'[-+]?(\d+|inf|infinity|nan|0x[\da-f.]+(p[-+]?\d+)?)|y|n', re.ASCII | re.IGNORECASE
)
# Characters that YAML can write into a text, but neither a terminal nor ROS can take.
NO_TEXT = re.compile('[\0\ud800-\udfff]')
# A key with its value and no space between them.
NO_SPACE = re.compile(r'\s*([\w./*]+:[^\s:/].*)')


@dataclass(frozen=True, slots=True)
class Section:
    """
    Parameters for the nodes of one name, from a parameter file or from the command line.

    Attributes
    ----------
    origin : str
        The file, or `-p` with the argument, for error messages.
    nodes : str
        Name of the nodes: absolute, with the wildcards `*` for one part of a name and `**` for any
        number of parts.
    values : dict
        Values by dotted name, not yet checked by a setting.

    """

    origin: str  # the file, or the argument, for error messages
    nodes: str  # name of the nodes, absolute, with wildcards
    values: dict[str, object]  # by dotted name

    @property
    def is_argument(self) -> bool:
        """Return whether it is from the command line."""
        return self.origin.startswith(ARGUMENT)

    def reaches(self, node: str) -> bool:
        """
        Return whether a node, by its fully qualified name, takes the section.

        Parameters
        ----------
        node : str
            Name with its namespace, such as /left/fkm, after remapping.

        Returns
        -------
        bool
            Whether the section's name with its wildcards fits.

        """
        # /** after /** adds no name, but a search each.
        nodes = re.sub(r'(/\*\*)+(?=/|$)', '/**', self.nodes)
        tokens = re.findall(r'/[^/]*', nodes)
        pattern = ''.join(WILDCARDS.get(token, re.escape(token)) for token in tokens)
        return re.fullmatch(pattern, node) is not None


def config_directory() -> Path:
    """
    Return the directory of the package's config files.

    Returns
    -------
    Path
        `config/` of a checkout, or `share/spm_haptic_master/config` of an installation.

    Raises
    ------
    FileNotFoundError
        The package is not whole: neither has the files.

    """
    prefixes = *filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(':')), sys.prefix
    candidates = [
        Path(__file__).resolve().parents[2] / 'config',
        *(Path(prefix) / 'share' / PACKAGE / 'config' for prefix in prefixes),
    ]
    for candidate in candidates:
        if (candidate / 'sim.yaml').is_file():
            return candidate
    raise FileNotFoundError(
        f'{PACKAGE}: no config/sim.yaml in '
        + ', '.join(str(candidate) for candidate in candidates)
    )


def source_defaults(source: str) -> dict[str, object]:
    """
    Return the driver's defaults for a source.

    They are those of config/SOURCE.yaml, and what that file does not have, of config/can.yaml.

    Parameters
    ----------
    source : str
        can, replay or sim.

    Returns
    -------
    dict
        Values by parameter name, for four encoders.

    Raises
    ------
    FileNotFoundError
        The package is not whole.

    """
    return _config('can') | (_config(source) if source != 'can' else {})


def simulated_rig(sensors: int = 4) -> dict[str, object]:
    """
    Return the zero counts and directions of simulated encoders, by parameter name.

    Parameters
    ----------
    sensors : int
        Number of sensors, 4 to 6.

    Returns
    -------
    dict
        Values of config/simulated_rig.yaml, or of its variant for five or six encoders.

    """
    return _config(f'simulated_rig_{NUMBER_WORDS[sensors]}' if sensors > 4 else 'simulated_rig')


def _config(name: str) -> dict[str, object]:
    """Return the values of one of the package's config files."""
    (section,) = read_sections(config_directory() / f'{name}.yaml')
    return dict(section.values)


def read_sections(path: str | Path) -> list[Section]:
    """
    Read a ROS parameter file.

    Parameters
    ----------
    path : str or Path
        The file, in YAML.

    Returns
    -------
    list of Section
        Its sections in their order.

    Raises
    ------
    InputError
        The file cannot be read, is too large, is not valid YAML, has a name twice, or a value that
        YAML and ROS read differently. The line is named.

    """
    try:
        with open(path, 'rb') as file:
            content = file.read(LARGEST_FILE + 1)
        text = content.decode('utf-8-sig')
    except (OSError, ValueError) as error:
        raise InputError(f'{path}: cannot be read: {error}') from error
    if len(content) > LARGEST_FILE:
        raise InputError(f'{path}: larger than {LARGEST_FILE} bytes; expected a parameter file')
    tree = _compose(str(path), text)
    if not isinstance(tree, yaml.MappingNode):
        raise InputError(f'{path}: not a ROS parameter file (NODE: {PARAMETERS}: ...)')
    sections = list(_sections(str(path), '', _entries(str(path), tree)))
    for name, count in Counter(section.nodes for section in sections).items():
        if count > 1:
            raise InputError(f'{path}: section {name} is given twice')
    return sections


def argument_section(text: str) -> Section:
    """
    Return the section of an argument behind `-p`.

    Parameters
    ----------
    text : str
        NAME:=VALUE for all nodes, or NODE:NAME:=VALUE for one.

    Returns
    -------
    Section
        The section; its nodes are `/**` without NODE.

    Raises
    ------
    InputError
        As of `read_sections`.

    """
    name, separator, value = text.partition(':=')
    node, _, name = name.rpartition(':')
    if not separator or not name:
        raise InputError(f"-p '{text}'; expected NAME:=VALUE")
    origin = f'{ARGUMENT}{text}'
    tree = _compose(origin, value)
    if tree is None:
        raise InputError(f"{origin}: {name} has no value; expected one, or '' for an empty text")
    return _section(origin, _absolute(origin, node or '**'), name, tree)


def _compose(origin: str, text: str) -> yaml.Node | None:
    """
    Return the tree of a text in YAML, None for an empty one; InputError as `read_sections`.

    Parameters
    ----------
    origin : str
        The file or the argument, for error messages.
    text : str
        Text in YAML.

    Returns
    -------
    yaml.Node or None
        The tree, with the line of each node. Values are still texts.

    Raises
    ------
    InputError
        The text is not valid YAML, or has an anchor, an alias, a tag or a forbidden character.

    """
    event: Any
    try:
        for event in yaml.parse(text, yaml.SafeLoader):
            _check_event(event)
        return yaml.compose(text, yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        # A parser marks each of its errors.
        line: int = error.problem_mark.line  # type: ignore[union-attr]
        raise InputError(_syntax(origin, text, line, str(error.problem))) from error
    except (yaml.YAMLError, RecursionError, OverflowError, ValueError) as error:
        kind = 'nested too deeply' if isinstance(error, RecursionError) else 'no such character'
        reason = getattr(error, 'reason', kind)
        raise InputError(f'{origin}: not valid YAML: {reason}') from error


def _check_event(event: Any) -> None:
    """Raise MarkedYAMLError for what a parameter file needs not have, or ROS cannot take."""
    anchor = getattr(event, 'anchor', None)
    tag = getattr(event, 'tag', None)
    if anchor is not None or tag is not None:
        raise yaml.MarkedYAMLError(
            problem='an anchor (&), an alias (*) or a tag (!); expected a plain value',
            problem_mark=event.start_mark,
        )
    if NO_TEXT.search(getattr(event, 'value', '')):
        raise yaml.MarkedYAMLError(
            problem=f'{ascii(event.value)} has a NUL or half a character',
            problem_mark=event.start_mark,
        )


def _syntax(
    origin: str,
    text: str,
    line: int,
    problem: str,
) -> str:
    """
    Describe the error in a text in YAML, which a parser finds a line or more later.

    Parameters
    ----------
    origin : str
        The file or the argument.
    text : str
        Text in YAML.
    line : int
        Line at which the parser stopped, from 0.
    problem : str
        Words of the parser.

    Returns
    -------
    str
        Place and error. Of a file, the last tab or colon without a space up to that line comes
        before the words of the parser.

    """
    lines = text.splitlines()[: line + 1]
    if origin.startswith(ARGUMENT):
        cure = '' if problem.endswith('expected a plain value') else '; expected a value in YAML'
        return f'{origin}: {problem}{cure}'
    for number, content in reversed(list(enumerate(lines, 1))):
        if '\t' in content:
            return f'{origin}:{number}: a tab; expected spaces'
        if found := NO_SPACE.fullmatch(content):
            return f"{origin}:{number}: '{found[1].strip()}'; expected a space after the colon"
    return f'{origin}:{line + 1}: not valid YAML: {problem}'


def _sections(
    path: str,
    prefix: str,
    tree: dict[str, yaml.Node],
) -> Iterator[Section]:
    """
    Yield the sections of a file; names may be nested, a namespace above its nodes.

    Parameters
    ----------
    path : str
        The file, for error messages.
    prefix : str
        Namespace of the names, '' or '/NAME'.
    tree : dict
        Keys and nodes of the tree at this place.

    Yields
    ------
    Section
        Each with at least one parameter.

    Raises
    ------
    InputError
        A section has no parameters, or a name is given twice.

    """
    for name, node in tree.items():
        nodes = _absolute(path, name, prefix)
        entries = _entries(path, node, f'section {nodes} has no {PARAMETERS}')
        parameters = entries.pop(PARAMETERS, None)
        if parameters is not None:
            _entries(path, parameters, f'section {nodes}: {PARAMETERS} has no parameters')
            yield _section(path, nodes, '', parameters)
        elif not entries:
            raise InputError(f'{path}: section {nodes} has no {PARAMETERS}')
        yield from _sections(path, nodes, entries)


def _section(
    origin: str,
    nodes: str,
    name: str,
    tree: yaml.Node,
) -> Section:
    """Return the section of a tree's parameters; InputError for a name given twice."""
    values: dict[str, object] = {}
    for full, value in _parameters(origin, name, tree):
        if full in values:
            raise InputError(f'{origin}: {full} is given twice in section {nodes}')
        values[full] = value
    return Section(origin, nodes, values)


def _absolute(
    origin: str,
    name: str,
    prefix: str = '',
) -> str:
    """Return the absolute name of nodes; InputError for one with an empty part."""
    nodes = f'{prefix}/{name.removeprefix("/")}'
    if '//' in f'{nodes}/':
        raise InputError(f"{origin}: section '{name}'; expected a node's name such as /fkm")
    return nodes


def _entries(
    origin: str,
    tree: yaml.Node,
    missing: str = '',
) -> dict[str, yaml.Node]:
    """
    Return keys and nodes of a mapping; InputError for a key given twice, or for no mapping.

    Parameters
    ----------
    origin : str
        The file or the argument, for error messages.
    tree : yaml.Node
        A node that has to be a mapping.
    missing : str
        Words of the error if it is not one.

    Returns
    -------
    dict
        Nodes of the values by key, in the order of the text.

    """
    if not isinstance(tree, yaml.MappingNode):
        if isinstance(tree, yaml.ScalarNode):
            text = tree.value
        else:
            text = ''
        cure = f"; '{text}' has no space after the colon" if NO_SPACE.fullmatch(text) else ''
        raise InputError(f'{origin}:{tree.start_mark.line + 1}: {missing}{cure}')
    entries: dict[str, yaml.Node] = {}
    for key, node in tree.value:
        place = f'{origin}:{key.start_mark.line + 1}'
        if not isinstance(key, yaml.ScalarNode):
            raise InputError(f'{place}: a key that is not a name')
        if not key.value:
            raise InputError(f'{place}: an empty key; expected a name')
        if key.value in entries:
            raise InputError(f"{place}: key '{key.value}' is given twice")
        entries[key.value] = node
    return entries


def _parameters(
    origin: str,
    name: str,
    node: yaml.Node,
) -> Iterator[tuple[str, object]]:
    """Yield dotted names and values of a node of the tree."""
    if isinstance(node, yaml.MappingNode):
        for key, inner in _entries(origin, node).items():
            yield from _parameters(origin, f'{name}.{key}' if name else key, inner)
        return
    line = '' if origin.startswith(ARGUMENT) else f':{node.start_mark.line + 1}'
    yield name, _value(f'{origin}{line}: {name}', node)


def _value(what: str, node: yaml.Node) -> object:
    """
    Return the value of a parameter.

    Parameters
    ----------
    what : str
        Place and name of the parameter, for error messages.
    node : yaml.Node
        A single value or a list.

    Returns
    -------
    bool, int, float, str, or list of one of these
        The value; an empty list is possible.

    Raises
    ------
    InputError
        A value could be read in two ways, or a list has several types.

    """
    if isinstance(node, yaml.ScalarNode):
        return _scalar(what, node)
    if not all(isinstance(each, yaml.ScalarNode) for each in node.value):
        raise InputError(f'{what} is a list of lists; expected a list of single values')
    values = [_scalar(what, each) for each in node.value]
    kinds = {type(value) for value in values}
    if kinds == {int, float}:
        whole = next(value for value in values if type(value) is int)
        raise InputError(
            f'{what} has whole numbers beside decimal ones; expected {whole}.0 for {whole}'
        )
    if len(kinds) > 1:
        raise InputError(f'{what} is {values}; expected a list of one type')
    return values


def _scalar(what: str, node: yaml.ScalarNode) -> object:
    """
    Return a single value, as YAML and rcl both read it.

    Parameters
    ----------
    what : str
        Place and name of the parameter, for error messages.
    node : yaml.ScalarNode
        A text in YAML; one in quotes is a text whatever it has.

    Returns
    -------
    bool, int, float or str
        The value.

    Raises
    ------
    InputError
        YAML and ROS read it differently, it is empty, or it is a block of text.

    """
    text: str = node.value
    if node.style in ("'", '"'):
        return text
    if node.style is not None:
        raise InputError(f'{what} is a block of text; expected a text in quotes')
    if not text:
        raise InputError(f"{what} has no value; expected one, or '' for an empty text")
    if INTEGER.fullmatch(text):
        return _integer(what, text)
    if FLOAT.fullmatch(text):
        # Python has no point in inf and nan.
        return float(text.replace('.', '', 1) if text[-1] in 'fFnN' else text)
    return _word(what, node)


def _integer(what: str, text: str) -> int:
    """Return a whole number; InputError for one that ROS cannot take."""
    if len(text) <= LONGEST_INTEGER:
        value = int(text, 0)
    else:
        value = 1 << 63
    if not -1 << 63 <= value < 1 << 63:
        raise InputError(f'{what} is too large; expected a whole number of at most 64 bits')
    return value


def _word(what: str, node: yaml.ScalarNode) -> bool | str:
    """Return a truth value or a text without quotes; InputError where ROS reads another one."""
    text: str = node.value
    kind = node.tag.rpartition(':')[2]
    if kind == 'bool':
        return text.lower() in ('true', 'yes', 'on')
    if kind in ('str', 'timestamp') and not RCL_ONLY.fullmatch(text):
        return text
    raise InputError(
        f'{what} is {text}, which YAML and ROS read differently; expected a plain '
        f"number, true, false, or '{text}' for a text"
    )
