# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings as parameters of a node: their values, descriptors, live changes and refusals."""

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
import rclpy
from rclpy.parameter import Parameter
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.parameters.setting import Setting
from spm_haptic_master.ros.parameters import ParameterNode

SETTINGS = (
    Setting(
        'speed',
        float,
        'Speed (m/s)',
        1.0,
        minimum=0.5,
        maximum=9.0,
        live=True,
    ),
    Setting(
        'number',
        int,
        'Number of things',
        3,
        minimum=1,
        maximum=5,
        live=True,
    ),
    Setting(
        'word',
        str,
        'A word',
        'a',
        allowed=('a', 'b'),
        live=True,
    ),
    Setting('fixed', float, 'Never changes', 2.0, minimum=0.0),
    Setting('angles', float, 'Angles (deg)', [1.0, 2.0], count=2),
)


@pytest.fixture
def node():
    """Give a node that has got a speed, and refuses one above 8."""
    # What rclpy is given besides has no effect.
    rclpy.init(args=['--ros-args', '-p', 'number:=2'])
    node = ParameterNode('fkm', Parameters((), ['fkm:speed:=2']))
    node.applied = []

    def apply(values):
        if values.get('speed', 0.0) > 8.0:
            raise SettingError('speed', values['speed'], '8 or less')
        node.applied.append(values)

    node.declared = node.declare(SETTINGS, {'number': 4})
    node.on_change(('speed', 'number', 'word'), apply)
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def test_parameters_have_the_resolved_values_and_say_what_is_allowed(node):
    assert (
        node.declared
        == node.values
        == {'speed': 2.0, 'number': 4, 'word': 'a', 'fixed': 2.0, 'angles': (1.0, 2.0)}
    )
    assert node.declare(SETTINGS[:0]) == {}
    for setting in SETTINGS:
        value = node.get_parameter(setting.name).value
        assert (tuple(value) if setting.count else value) == node.values[setting.name]
        found = node.describe_parameter(setting.name)
        assert (found.description, found.read_only) == (setting.description, not setting.live)
        ranges = [
            (each.from_value, each.to_value, each.step)
            for each in (*found.floating_point_range, *found.integer_range)
        ]
        expected = {'speed': [(0.5, 9.0, 0.0)], 'number': [(1, 5, 1)]}.get(setting.name, [])
        assert ranges == expected
        assert found.additional_constraints == ('' if expected else setting.expected)


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('speed', 5.0, ''),
        ('speed', 5, ''),
        ('number', 5, ''),
        ('word', 'b', ''),
        ('speed', 8.5, "'speed' is 8.5; expected 8 or less"),
        ('speed', 'fast', 'Type.DOUBLE'),
        ('number', 1.5, 'Type.INTEGER'),
        ('word', 'c', "'word' is 'c'"),
        ('fixed', 3.0, 'fixed'),
        ('sped', 3.0, "'sped' is 3.0; expected a parameter of this node, such as speed"),
        # A name of another node is not proposed.
        ('rate', 3.0, "'rate' is 3.0; expected a parameter of this node, such as angles, fixed"),
        (
            'speed',
            ParameterValue(type=77),
            "parameter 'speed' is of type 77; expected 1 to 9, as in "
            'rcl_interfaces/msg/ParameterType',
        ),
    ],
)
def test_the_services_change_a_live_setting_and_refuse_all_else(node, name, value, reason):
    messages = [
        ParameterMessage(
            name=name,
            value=value
            if isinstance(value, ParameterValue)
            else Parameter(name, value=value).get_parameter_value(),
        )
    ]
    # There is one service of each type: none of rclpy beside those of the package.
    services = {service.srv_type: service.callback for service in node.services}
    assert len(services) == len(list(node.services))
    one = services[SetParameters](
        SetParameters.Request(parameters=messages), SetParameters.Response()
    ).results[0]
    whole = services[SetParametersAtomically](
        SetParametersAtomically.Request(parameters=messages), SetParametersAtomically.Response()
    ).result
    for result in one, whole:
        assert result.successful == (not reason)
        assert reason in result.reason
    expected = [] if reason else [{name: float(value) if name == 'speed' else value}] * 2
    assert node.applied == expected
    assert reason or node.get_parameter(name).value == value


def test_a_node_ends_at_its_start_where_a_live_setting_is_applied_by_no_code(node):
    """Else `ros2 param set` would accept a value that has no effect."""
    node.check_live_settings()
    node.declare((Setting('level', float, 'A level', 1.0, live=True),))
    with pytest.raises(RuntimeError, match='live settings that no code applies.*: level'):
        node.check_live_settings()
    node.on_change(('level', 'fixed'), lambda values: None)
    with pytest.raises(RuntimeError, match='applied settings that are not live: fixed'):
        node.check_live_settings()
