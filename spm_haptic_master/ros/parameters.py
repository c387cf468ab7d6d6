# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings as ROS parameters: the resolved values of a node, their declaration, live changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import time
from typing import Any

from rcl_interfaces import msg
from rcl_interfaces.msg import ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.nodes import ROS_SETTINGS, VIEW_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters, resolve, similar
from spm_haptic_master.parameters.setting import Setting

# Exported to the nodes of other rooms.
__all__ = ('ParameterNode', 'Parameters', 'VIEW_SETTINGS')


class ParameterNode(Node):
    """
    A node with the values that the package has resolved, in place of those of rclpy.

    Parameters
    ----------
    name : str
        Name of the node before remapping.
    parameters : Parameters
        Files and arguments of the process.

    Raises
    ------
    InputError
        As of `Parameters`: a file or an argument is refused.

    """

    def __init__(self, name: str, parameters: Parameters) -> None:
        # Values from files and command line for this node (before remapping), by name.
        self.given = parameters.of(name)
        # Checked values of the parameters declared so far, by name.
        self.values: dict[str, Any] = {}
        # Declared settings by name, and those of them that change while the node runs.
        self._settings: dict[str, Setting] = {}
        self._applied: set[str] = set()
        overrides = []
        for setting in ROS_SETTINGS:
            if setting.name in self.given:
                value = setting.check(self.given[setting.name])
                overrides.append(Parameter(setting.name, value=value))
        super().__init__(
            name,
            start_parameter_services=False,
            parameter_overrides=overrides,
        )
        # Its callbacks refer to the node weakly; the node keeps them.
        _ParameterServices(self)

    def destroy_node(self) -> None:
        """Destroy the node with its publishers, subscriptions, timers and services."""
        super().destroy_node()  # type: ignore[no-untyped-call]

    def declare(
        self,
        settings: tuple[Setting, ...],
        defaults: Mapping[str, object] | None = None,
    ) -> dict[str, Any]:
        """
        Declare settings as parameters of the node.

        Parameters
        ----------
        settings : tuple of Setting
            The settings, such as a table of `parameters/nodes.py`.
        defaults : mapping, optional
            Values that replace the defaults of the settings, by name.

        Returns
        -------
        dict
            The checked value of each setting, by name; `values` has them too.

        Raises
        ------
        SettingError
            A value is missing or not among those that its setting allows.

        """
        declared, values = resolve(self.given, settings, defaults)
        for setting in declared:
            value = values[setting.name]
            if setting.count is not None:
                value = list(value)
            self.declare_parameter(
                setting.name,
                value,
                _descriptor(setting),
                ignore_override=True,
            )
            self._settings[setting.name] = setting
        self.values |= values
        return values

    def on_change(self, names: Sequence[str], apply: Callable[[dict[str, Any]], None]) -> None:
        """
        Let `apply` take new values of live settings while the node runs.

        Parameters
        ----------
        names : sequence of str
            Declared settings that `apply` can change; their `Setting` has `live`.
        apply : callable
            Gets the new values by name, checked; it refuses them by a SettingError.

        """
        self._applied.update(names)

        def check(parameters: list[Parameter]) -> SetParametersResult:
            try:
                changed = {}
                for parameter in parameters:
                    if parameter.name in names:
                        setting = self._settings[parameter.name]
                        changed[parameter.name] = setting.check(parameter.value)
                apply(changed)
            except SettingError as error:
                return SetParametersResult(successful=False, reason=str(error))
            return SetParametersResult(successful=True)

        self.add_on_set_parameters_callback(check)

    def check_live_settings(self) -> None:
        """Raise RuntimeError unless the node applies each setting that is live, and no other."""
        live = {name for name, setting in self._settings.items() if setting.live}
        different = live ^ self._applied
        if different:
            raise RuntimeError(
                f'{self.get_name()}: live settings that no code applies (by `on_change`), or '
                f'applied settings that are not live: {", ".join(sorted(different))}'
            )

    def clock_reader(self) -> Callable[[], int]:
        """Return a reader of the time, ns; ask again now and then: use_sim_time may change."""
        clock: Any = self.get_clock()
        if clock.ros_time_is_active:
            return lambda: int(clock.now().nanoseconds)
        return time.time_ns

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters: an unknown name is reported with those like it, 5 is taken as 5.0."""
        wanted = []
        for parameter in parameter_list:
            name = parameter.name
            value = parameter.value
            if not self.has_parameter(name):
                return SetParametersResult(successful=False, reason=self._unknown(name, value))
            is_float = isinstance(self.get_parameter(name).value, float)
            if is_float and type(value) is int:
                parameter = Parameter(name, value=float(value))
            wanted.append(parameter)
        return super().set_parameters_atomically(wanted)

    def _unknown(self, name: str, value: object) -> str:
        """Return why a parameter is refused that the node does not have."""
        near = ', '.join(similar(name, self.get_parameters_by_prefix('')))
        return str(SettingError(name, value, f'a parameter of this node, such as {near}'))


class _ParameterServices(ParameterService):
    """The parameter services of a node: those of rclpy raise where a type is not valid."""

    def _set_parameters_callback(
        self,
        request: SetParameters.Request,
        response: SetParameters.Response,
    ) -> SetParameters.Response:
        response.results = [self._set([message]) for message in request.parameters]
        return response

    def _set_parameters_atomically_callback(
        self,
        request: SetParametersAtomically.Request,
        response: SetParametersAtomically.Response,
    ) -> SetParametersAtomically.Response:
        response.result = self._set(request.parameters)
        return response

    def _set(self, messages: Sequence[msg.Parameter]) -> SetParametersResult:
        """Set parameters, or return which of them has a type that ROS does not have."""
        parameters = []
        for message in messages:
            try:
                parameters.append(Parameter.from_parameter_msg(message))
            except ValueError:
                return SetParametersResult(
                    successful=False,
                    reason=(
                        f'parameter {message.name!r} is of type {message.value.type}; expected '
                        f'{ParameterType.PARAMETER_BOOL} to '
                        f'{ParameterType.PARAMETER_STRING_ARRAY}, '
                        'as in rcl_interfaces/msg/ParameterType'
                    ),
                )
        node: Node = self._get_node()
        return node.set_parameters_atomically(parameters)


def _descriptor(setting: Setting) -> msg.ParameterDescriptor:
    """Return description and range of a setting, as `ros2 param describe` prints them."""
    descriptor = msg.ParameterDescriptor(
        description=setting.description, read_only=not setting.live
    )
    has_range = setting.minimum is not None and setting.maximum is not None
    if setting.allowed or setting.count is not None or not has_range:
        descriptor.additional_constraints = setting.expected
    elif setting.kind is float:
        floats = msg.FloatingPointRange(
            from_value=setting.minimum,
            to_value=setting.maximum,
        )
        descriptor.floating_point_range = [floats]
    else:
        integers = msg.IntegerRange(
            from_value=setting.minimum,
            to_value=setting.maximum,
            step=1,
        )
        descriptor.integer_range = [integers]
    return descriptor
