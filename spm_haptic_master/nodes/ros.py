# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The few commands of `ros2` that a rig needs, where no `ros2` command line is installed."""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Iterator
from functools import reduce
from importlib import import_module
from math import inf
import sys
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.arguments import OneLineParser, positive
from spm_haptic_master.parameters.files import argument_section
from spm_haptic_master.ros.client import Client, run

# Messages that wait to be printed.
DEPTH = 100
# Groups of commands, the commands of each, and what they take.
COMMANDS: dict[str, dict[str, tuple[str, ...]]] = {
    'topic': {
        'list': (),
        'echo': ('topic',),
        'pub': ('topic', 'type', 'values'),
    },
    'param': {
        'get': ('node', 'name'),
        'set': ('node', 'name', 'value'),
    },
    'service': {
        'call': ('service',),
    },
}


class Commands(Client):
    """
    The commands: `do_VERB` of each; they raise InputError.

    `given` has the arguments of the command line. Names of topics, nodes and services may lack
    their first slash.
    """

    def do_list(self, given: argparse.Namespace) -> None:
        """Print all topics and their types."""
        self.wait(lambda: False, 1.0)
        for name, kinds in self.node.get_topic_names_and_types():
            print(f'{name}: {", ".join(kinds)}')

    def do_echo(self, given: argparse.Namespace) -> None:
        """
        Print the messages of a topic.

        Parameters
        ----------
        given : argparse.Namespace
            `topic`, and `once`: end after the first message.

        Raises
        ------
        InputError
            Nobody publishes the topic, or the package of its type is not installed.

        """
        topic = _absolute(given.topic)
        if not self.wait(lambda: self.node.get_publishers_info_by_topic(topic), self.PATIENCE):
            raise InputError(f'{topic}: nobody publishes it (`ros topic list` shows the topics)')
        first = self.node.get_publishers_info_by_topic(topic)[0]
        offered = first.qos_profile
        qos = QoSProfile(
            depth=DEPTH,
            durability=offered.durability,
            reliability=offered.reliability,
        )
        received: deque[Any] = deque(maxlen=DEPTH)
        self.node.create_subscription(
            _type(first.topic_type), topic, lambda message: received.append(message), qos
        )
        while True:
            # Not printed in the callback: rclpy logs what a closed pipe raises there.
            self.wait(lambda: received, inf)
            lines = [*_lines(received.popleft()), '---']
            print('\n'.join(lines), flush=True)
            if given.once:
                return

    def do_pub(self, given: argparse.Namespace) -> None:
        """
        Publish a message again and again.

        Parameters
        ----------
        given : argparse.Namespace
            `topic`, `type` such as std_msgs/msg/Bool, `values` in YAML, and `rate`, Hz.

        Raises
        ------
        InputError
            The package of the type is not installed, or the message has no such field.

        """
        kind = _type(given.type)
        message = kind()
        given_values = argument_section(f'message:={given.values}').values
        for name, value in given_values.items():
            _, *path = name.split('.')
            _set_field(message, path, value)
        out = self.node.create_publisher(kind, _absolute(given.topic), DEPTH)
        while True:
            out.publish(message)
            self.wait(lambda: False, 1.0 / given.rate)

    def do_get(self, given: argparse.Namespace) -> None:
        """
        Print the value of a parameter.

        Parameters
        ----------
        given : argparse.Namespace
            `node` and `name` of the parameter.

        Raises
        ------
        InputError
            The node does not answer, or has no such parameter.

        """
        service = f'{_absolute(given.node)}/get_parameters'
        answer = self.ask(service, GetParameters, names=[given.name])
        values = answer.values
        if not values:
            raise InputError(f"{given.node} has no parameter '{given.name}'")
        print(f'{given.name}: {parameter_value_to_python(values[0])}')

    def do_set(self, given: argparse.Namespace) -> None:
        """
        Set a parameter.

        Parameters
        ----------
        given : argparse.Namespace
            `node`, `name` of the parameter, and `value` in YAML.

        Raises
        ------
        InputError
            The node does not answer or refuses the value, or the value is neither a single one nor
            a list.

        """
        values = argument_section(f'{given.name}:={given.value}').values
        if len(values) != 1:
            raise InputError(f'{given.name} is {given.value}; expected a single value or a list')
        ((name, value),) = values.items()
        parameter = Parameter(name, value=value).to_parameter_msg()
        service = f'{_absolute(given.node)}/set_parameters'
        answer = self.ask(service, SetParameters, parameters=[parameter])
        (result,) = answer.results
        if not result.successful:
            raise InputError(result.reason)
        print(f'{name}: {value}')

    def do_call(self, given: argparse.Namespace) -> None:
        """
        Call a service that takes no arguments, and print its answer.

        Parameters
        ----------
        given : argparse.Namespace
            `service`; its type is found.

        Raises
        ------
        InputError
            There is no such service, or it does not answer.

        """
        service = _absolute(given.service)
        found = self.wait(lambda: self._kinds_of(service), self.PATIENCE)
        if not found:
            raise InputError(f'{service}: no such service')
        answer = self.ask(service, _type(found[0]))
        print('\n'.join(_lines(answer)))

    def _kinds_of(self, service: str) -> list[str] | None:
        """Return the types of a service; None where nobody offers it."""
        offered = dict(self.node.get_service_names_and_types())
        return offered.get(service)


def _absolute(name: str) -> str:
    """Return a name with the slash that users leave out."""
    return f'/{name.lstrip("/")}'


def _type(name: str) -> Any:
    """
    Return the class of a type.

    Parameters
    ----------
    name : str
        Name such as std_msgs/msg/String.

    Returns
    -------
    type
        Class of messages or of a service.

    Raises
    ------
    InputError
        Its package is not installed.

    """
    package, part, kind = name.split('/')
    try:
        return getattr(import_module(f'{package}.{part}'), kind)
    except (ImportError, AttributeError) as error:
        raise InputError(f'{name}: its package is not installed') from error


def _set_field(
    message: Any,
    names: list[str],
    value: object,
) -> None:
    """
    Set a field of a message.

    Parameters
    ----------
    message : message
        The message.
    names : list of str
        Path of the field.
    value : object
        Value; a whole number becomes a float if the field is one.

    Raises
    ------
    InputError
        There is no such field, or it cannot have the value.

    """
    *path, last = names or ['']
    try:
        message = reduce(getattr, path, message)
        field = getattr(message, last)
        if isinstance(field, float):
            value = float(value)  # type: ignore[arg-type]
        setattr(message, last, value)
    except (AttributeError, AssertionError, TypeError, ValueError) as error:
        raise InputError(
            f'{".".join(names)} is {value!r}; expected a field of '
            f'{type(message).__name__}, such as data: true'
        ) from error


def _lines(message: Any, indent: str = '') -> Iterator[str]:
    """
    Yield the fields of a message in lines, as `ros2 topic echo` does.

    Parameters
    ----------
    message : message
        A message of any type.
    indent : str
        Blanks before each line.

    Yields
    ------
    str
        A field and its value; elements of a list begin with a dash.

    """
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if hasattr(value, 'get_fields_and_field_types'):
            yield f'{indent}{name}:'
            yield from _lines(value, f'{indent}  ')
        elif isinstance(value, bytes):  # one byte, such as the level of a diagnostic status
            yield f'{indent}{name}: {value[0]}'
        elif isinstance(value, (str, bool, int, float)) or not len(value):
            yield f'{indent}{name}: {value}'
        else:
            yield f'{indent}{name}:'
            for each in value:
                is_message = hasattr(each, 'get_fields_and_field_types')
                if is_message:
                    first, *more = _lines(each, f'{indent}  ')
                else:
                    first, *more = [str(each)]
                yield f'{indent}- {first.strip()}'
                yield from more


def _parser() -> argparse.ArgumentParser:
    """Return the parser of all commands, as `ros2` has them."""
    parser = OneLineParser('ros', description=__doc__)
    groups = parser.add_subparsers(required=True, metavar='topic | param | service')
    for group, commands in COMMANDS.items():
        verbs = groups.add_parser(group).add_subparsers(
            required=True,
            dest='verb',
            metavar=' | '.join(commands),
        )
        for verb, names in commands.items():
            command = verbs.add_parser(verb)
            for name in names:
                command.add_argument(name)
            if verb == 'echo':
                command.add_argument('--once', action='store_true', help='end after one message')
            elif verb == 'pub':
                command.add_argument('-r', '--rate', type=positive, default=1.0, help='Hz')
            elif verb == 'call':
                command.add_argument('type', nargs='?', help='not needed')
    return parser


def main(args: list[str] | None = None) -> int:
    """Run a command; an error is one line on stderr and exit code 1."""

    def command() -> int:
        words = sys.argv if args is None else args
        given = _parser().parse_args(words[1:])
        commands = Commands('ros_command')
        run_command = getattr(commands, f'do_{given.verb}')
        run_command(given)
        return 0

    return run('ros', command)
