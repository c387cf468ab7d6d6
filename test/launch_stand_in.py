# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the launch files use of `launch` and `launch_ros`, which are in no package registry.

It takes the arguments that those take and no others, and visits actions in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
import runpy
import sys
import types
from typing import Any


class Context:
    """LaunchContext: the values of the arguments, what was started and logged."""

    def __init__(self, given: dict[str, str]) -> None:
        self.launch_configurations = dict(given)
        self.started: list[Node] = []
        self.logged: list[str] = []
        self.is_shutdown = False


@dataclass
class LaunchConfiguration:
    variable_name: str

    def perform(self, context: Context) -> str:
        return context.launch_configurations[self.variable_name]


@dataclass
class IfCondition:
    """Whether a value is true, as launch reads it."""

    predicate_expression: LaunchConfiguration

    def holds(self, context: Context) -> bool:
        return {'true': True, '1': True, 'false': False, '0': False}[
            self.predicate_expression.perform(context).lower()]


@dataclass(kw_only=True)
class Action:
    condition: IfCondition | None = None

    def visit(self, context: Context) -> None:
        if self.condition is None or self.condition.holds(context):
            self.execute(context)


@dataclass
class LaunchDescription:
    entities: Sequence[Action]

    def visit(self, context: Context) -> None:
        for entity in self.entities:
            entity.visit(context)


@dataclass
class DeclareLaunchArgument(Action):
    name: str
    default_value: str | None = field(default=None, kw_only=True)
    description: str = field(default='', kw_only=True)
    choices: list[str] | None = field(default=None, kw_only=True)

    def execute(self, context: Context) -> None:
        value = context.launch_configurations.setdefault(self.name, self.default_value)
        if value is None or self.choices is not None and value not in self.choices:
            raise RuntimeError(f'Argument "{self.name}" provided value "{value}" is not valid')


@dataclass(kw_only=True)
class OpaqueFunction(Action):
    function: Callable[[Context], list[Any] | None]

    def execute(self, context: Context) -> None:
        LaunchDescription(self.function(context) or ()).visit(context)


@dataclass
class PythonLaunchDescriptionSource:
    launch_file_path: str


@dataclass
class IncludeLaunchDescription(Action):
    source: PythonLaunchDescriptionSource
    launch_arguments: Any = field(default=(), kw_only=True)

    def execute(self, context: Context) -> None:
        context.launch_configurations.update(self.launch_arguments)
        run(self.source.launch_file_path, context)


@dataclass(kw_only=True)
class Node(Action):
    """What `ros2 launch` would start."""

    package: str
    executable: str
    namespace: str = ''
    parameters: list[dict[str, object]] = field(default_factory=list)
    arguments: list[str] = field(default_factory=list)
    ros_arguments: list[str] = field(default_factory=list)
    output: str = 'log'
    emulate_tty: bool = False
    on_exit: Callable[[ProcessExited, Context], list[Any] | None] | None = None

    def execute(self, context: Context) -> None:
        context.started.append(self)


@dataclass(kw_only=True)
class LogInfo(Action):
    msg: str

    def execute(self, context: Context) -> None:
        context.logged.append(self.msg)


@dataclass(kw_only=True)
class Shutdown(Action):
    reason: str

    def execute(self, context: Context) -> None:
        context.is_shutdown = True


@dataclass
class ProcessExited:
    process_name: str
    returncode: int


MODULES = {
    'launch': {'LaunchContext': Context, 'LaunchDescription': LaunchDescription,
               'LaunchDescriptionEntity': Action},
    'launch.actions': {each.__name__: each for each in (
        DeclareLaunchArgument, IncludeLaunchDescription, LogInfo, OpaqueFunction, Shutdown)},
    'launch.conditions': {'IfCondition': IfCondition},
    'launch.events': {},
    'launch.events.process': {'ProcessExited': ProcessExited},
    'launch.launch_description_sources': {
        'PythonLaunchDescriptionSource': PythonLaunchDescriptionSource},
    'launch.substitutions': {'LaunchConfiguration': LaunchConfiguration},
    'launch_ros': {}, 'launch_ros.actions': {'Node': Node}}


def install(setitem: Callable[[dict[str, Any], str, object], None]) -> None:
    """Put it in the place of launch and launch_ros; `setitem` is that of a MonkeyPatch."""
    for name, content in MODULES.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        setitem(sys.modules, name, module)


def run(path: str | Path, context: Context) -> None:
    """Execute a launch file as it is."""
    runpy.run_path(str(path))['generate_launch_description']().visit(context)
