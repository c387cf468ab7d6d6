# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was given is what the running node has, however it is started."""

import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0


@pytest.mark.process
def test_as_ros2_launch_starts_it_in_a_namespace_under_another_name(start, observer, tmp_path):
    """Launch remaps the name first, and writes parameters into files of its own, in order."""
    first, second = tmp_path / 'launch_params_a', tmp_path / 'launch_params_b'
    first.write_text('/**:\n  ros__parameters:\n    alert_limit_deg: 5\n'
                     '    geometry.alpha_deg: 39.1\n    use_sim_time: true\n')
    second.write_text('/left/forward:\n  ros__parameters:\n    geometry.alpha_deg: 39.2\n')
    start('fkm', '--ros-args', '-r', '__node:=forward', '-r', '__ns:=/left', '--params-file',
          str(first), '--params-file', str(second), '-p', 'alert_limit_deg:=1.5')

    def call(kind, service, **fields):
        client = observer.node.create_client(kind, f'/left/forward/{service}')
        assert observer.spin_until(client.service_is_ready, PATIENCE)
        answer = client.call_async(kind.Request(**fields))
        assert observer.spin_until(answer.done, PATIENCE)
        return answer.result()

    def get(*names):
        return [parameter_value_to_python(value) for value in call(
            GetParameters, 'get_parameters', names=names).values]

    def change(name, value):
        return call(SetParameters, 'set_parameters', parameters=[
            Parameter(name, value=value).to_parameter_msg()]).results[0]

    assert get('alert_limit_deg', 'geometry.alpha_deg', 'use_sim_time') == [1.5, 39.2, True]
    # Live: a value in range changes, all else is refused by name.
    assert change('alert_limit_deg', 3).successful and get('alert_limit_deg') == [3.0]
    for name, value, reason in (
            ('alert_limit_deg', 99.0, 'alert_limit_deg out of range'),
            ('alert_limit', 2.0, "'alert_limit' is 2.0; expected a parameter of this node, such "
             'as alert_limit_deg'), ('window', 0.1, 'read-only')):
        assert reason in change(name, value).reason
