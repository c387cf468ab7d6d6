# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings as ROS parameters: the package's configuration files, declaration, live changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import difflib

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.geometry_settings import GEOMETRY_SETTINGS, WORKING_MODE_SETTING
from spm_haptic_master.settings import Setting
from spm_haptic_master.source_factory import SOURCE_SETTINGS
from spm_haptic_master.supervision.settings import SUPERVISION_SETTINGS

SOURCE_SETTING = Setting(
    'source', str, 'where the joint angles come from', default='sim',
    allowed=tuple(sorted(SOURCE_SETTINGS)))

FKM_SETTINGS = (
    Setting('frame_id', str, 'reference (base) frame of the orientation', default='spm_base'),
    Setting('rate', float, 'samples a second that should come; fewer are reported',
            default=1000.0, minimum=1.0, maximum=10000.0),
    Setting('latency_limit', float, 's; a larger p99 from sample to publication is an overload',
            default=0.005, minimum=1e-5, maximum=10.0),
    Setting('max_age', float, 's; an older joint sample is stale, and gives no orientation',
            default=0.1, minimum=0.001, maximum=10.0),
    Setting('sample_timeout', float, 's without a joint sample until that is reported',
            default=0.05, minimum=0.002, maximum=60.0),
    Setting('velocity_window', float, 's of orientations behind the angular velocity; two and a '
            'half sample periods at least', default=0.02, minimum=0.002, maximum=1.0),
    *SUPERVISION_SETTINGS,
)

DIAGNOSTICS_SETTINGS = (
    Setting('dexterity_rate', float, 'Hz of the dexterity',
            default=50.0, minimum=0.1, maximum=1000.0),
    Setting('dexterity_warn', float, 'three-sensor dexterity below which the level is WARN',
            default=0.059, minimum=0.0, maximum=1.0, live=True),
    Setting('dexterity_error', float, 'three-sensor dexterity below which the level is ERROR',
            default=0.033, minimum=0.0, maximum=1.0, live=True),
    Setting('dexterity_hysteresis', float,
            'fraction above a threshold at which its level is left again',
            default=0.1, minimum=0.0, maximum=10.0, live=True),
    Setting('orientation_timeout', float, 's without an orientation until that is reported',
            default=0.1, minimum=0.002, maximum=60.0),
    *GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
)

# Of the process that a node runs in; off unless a rig asks for them.
REALTIME_SETTINGS = (
    Setting('realtime.priority', int, 'SCHED_FIFO priority of all threads; 0: normal scheduling',
            default=0, minimum=0, maximum=98),
    Setting('realtime.cpus', str, "cores to run on, such as '0,2-3'; empty: any (a single one on a "
            "command line: \"'2'\", else it is read as a number)", default=''),
    Setting('realtime.lock_memory', bool, 'no page of the process is ever swapped out (mlockall)',
            default=False),
    Setting('realtime.gc', str, "garbage collection, after start-up: 'normal'; 'freeze': not of "
            "what start-up made; 'disable': none (reference counting frees what the nodes "
            'make)',
            default='normal', allowed=('normal', 'freeze', 'disable')),
)

RECORDER_SETTINGS = (
    Setting('directory', str, 'where orientation.csv and measured_js.csv go',
            default='recording'),
)

# Names that rclpy itself declares, or takes as overrides, on every node.
ROS_NAMES = ('use_sim_time', 'start_type_description_service')
ROS_PREFIXES = ('qos_overrides.',)

_ALL_NAMES = {setting.name for settings in (
    (SOURCE_SETTING,), FKM_SETTINGS, DIAGNOSTICS_SETTINGS, RECORDER_SETTINGS, REALTIME_SETTINGS,
    *SOURCE_SETTINGS.values())
    for setting in settings}


def declare(node: Node, settings: tuple[Setting, ...],
            defaults: Mapping[str, object] | None = None) -> dict[str, object]:
    """
    Declare each setting as a parameter of `node` and return the checked values by name.

    Parameters
    ----------
    node : Node
        The node that gets the parameters.
    settings : tuple of Setting
        What to declare.
    defaults : mapping, optional
        Values that stand before the settings' own defaults (a configuration file's).

    Raises
    ------
    SettingError
        For a value that the setting cannot have, and for an override that no node of the package
        knows: a misspelt name would otherwise be ignored without a word.

    """
    # rclpy has no public way to see the overrides before it declares; they are needed so that a
    # wrong one is refused in our words, and a misspelt one at all.
    overrides = {name: parameter.value for name, parameter in node._parameter_overrides.items()}
    _refuse_unknown(overrides)
    values = {}
    for setting in settings:
        default = (defaults or {}).get(setting.name, setting.default)
        value = setting.check(overrides.get(setting.name, default))
        values[setting.name] = value
        node.declare_parameter(
            setting.name, list(value) if setting.count else value,
            _descriptor(setting), ignore_override=True)
    return values


def on_change(node: Node, settings: tuple[Setting, ...],
              apply: Callable[[dict[str, object]], None]) -> None:
    """
    Let live settings change while the node runs.

    `apply` gets the new values by name, and may refuse them with SettingError.
    """
    by_name = {setting.name: setting for setting in settings}

    def check(parameters):
        try:
            apply({parameter.name: by_name[parameter.name].check(parameter.value)
                   for parameter in parameters if parameter.name in by_name})
        except SettingError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def _refuse_unknown(overrides: Mapping[str, object]) -> None:
    for name, value in overrides.items():
        if name in _ALL_NAMES or name in ROS_NAMES or name.startswith(ROS_PREFIXES):
            continue
        near = difflib.get_close_matches(name, _ALL_NAMES, n=3) or sorted(_ALL_NAMES)
        raise SettingError(name, value, 'a parameter of this package, such as ' + ', '.join(near))


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
