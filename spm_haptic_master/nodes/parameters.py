# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings as ROS parameters: the package's configuration files, declaration, live changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import difflib
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from spm_haptic_master.encoders.settings import extended, for_sensors, sensors_of
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.node_settings import (
    ALL_NAMES,
    DIAGNOSTICS_SETTINGS,
    FKM_SETTINGS,
    MASTER_SETTINGS,
    PRESENCE_SETTINGS,
    REALTIME_SETTINGS,
    RECORDER_SETTINGS,
    SLAVE_SETTINGS,
    SOURCE_SETTING,
    TELEOP_SETTINGS,
    VIEW_SETTINGS,
)
from spm_haptic_master.settings import Setting

# The tables of settings are here for the nodes, which declare them.
__all__ = (
    'DIAGNOSTICS_SETTINGS', 'FKM_SETTINGS', 'MASTER_SETTINGS', 'PRESENCE_SETTINGS',
    'REALTIME_SETTINGS', 'RECORDER_SETTINGS', 'SLAVE_SETTINGS', 'SOURCE_SETTING',
    'TELEOP_SETTINGS', 'VIEW_SETTINGS', 'check_agreement', 'declare', 'on_change')

# Names that rclpy itself declares on every node.
ROS_NAMES = ('use_sim_time', 'start_type_description_service')
# Prefix of the names that ROS has for a node's QoS; no publisher or subscription here takes them.
QOS_PREFIX = 'qos_overrides.'


def declare(node: Node, settings: tuple[Setting, ...],
            defaults: Mapping[str, object] | None = None) -> dict[str, Any]:
    """
    Declare each setting as a parameter of `node` and return the checked values by name.

    Lists with a value for each sensor have as many as `sensors`, and so have their defaults.

    Parameters
    ----------
    node : Node
        Node that gets the parameters.
    settings : tuple of Setting
        Settings to declare.
    defaults : mapping, optional
        Values that override the settings' own defaults (a configuration file's), by name.

    Raises
    ------
    SettingError
        For a value that the setting cannot have, and for an override that no node of the package
        has: rclpy would ignore a misspelt name silently.

    """
    # rclpy has no public access to the overrides before they are declared. They are needed to
    # report a wrong value in this package's words, and a misspelt name at all.
    overrides = {name: parameter.value for name, parameter in node._parameter_overrides.items()}
    _reject_unknown(overrides)
    values: dict[str, Any] = {}
    settings = for_sensors(settings, sensors_of(overrides))
    defaults = extended(defaults or {}, settings)
    for setting in settings:
        default = defaults.get(setting.name, setting.default)
        value: Any = setting.check(overrides.get(setting.name, default))
        values[setting.name] = value
        node.declare_parameter(
            setting.name, value if setting.count is None else list(value),
            _descriptor(setting), ignore_override=True)
    return values


def on_change(node: Node, settings: tuple[Setting, ...],
              apply: Callable[[dict[str, Any]], None]) -> None:
    """
    Allow live settings to change while the node runs.

    Parameters
    ----------
    node : Node
        Node that has declared the settings.
    settings : tuple of Setting
        Settings of the node.
    apply : callable
        Called with the new values by name; rejects them by raising SettingError.

    """
    by_name = {setting.name: setting for setting in settings}

    def check(parameters: list[Parameter]) -> SetParametersResult:
        try:
            apply({parameter.name: by_name[parameter.name].check(parameter.value)
                   for parameter in parameters if parameter.name in by_name})
        except SettingError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def check_agreement(nodes: Sequence[Node]) -> None:
    """
    Refuse different values of one parameter in two nodes of a process.

    Those of the process itself are compared by `realtime.agreed`.

    Raises
    ------
    SettingError
        For the first such parameter.

    """
    first: dict[str, tuple[str, Any]] = {}
    for node in nodes:
        for name in node.get_parameters_by_prefix(''):
            value = node.get_parameter(name).value
            other, expected = first.setdefault(name, (node.get_name(), value))
            if value != expected and not name.startswith('realtime.'):
                raise SettingError(name, value, f'the same value in {node.get_name()} as in '
                                   f'{other} ({expected!r}): give it for all nodes, /**')


def _reject_unknown(overrides: Mapping[str, object]) -> None:
    for name, value in overrides.items():
        if name in ALL_NAMES or name in ROS_NAMES:
            continue
        if name.startswith(QOS_PREFIX):
            raise SettingError(name, value, 'no override: the QoS of this package is fixed')
        similar = difflib.get_close_matches(name, ALL_NAMES, n=3) or sorted(ALL_NAMES)
        raise SettingError(
            name, value, 'a parameter of this package, such as ' + ', '.join(similar))


def _descriptor(setting: Setting) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=setting.description, read_only=not setting.live)
    if setting.allowed:
        descriptor.additional_constraints = setting.expected
    elif setting.count is None and None not in (setting.minimum, setting.maximum):
        if setting.kind is float:
            descriptor.floating_point_range = [FloatingPointRange(
                from_value=setting.minimum, to_value=setting.maximum)]
        else:
            descriptor.integer_range = [IntegerRange(
                from_value=setting.minimum, to_value=setting.maximum, step=1)]
    else:
        descriptor.additional_constraints = setting.expected
    return descriptor
