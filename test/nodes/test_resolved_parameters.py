# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was given is what the running node has, however it is started."""


from in_process import ros
import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.nodes.teleop import Teleop
from spm_haptic_master.parameters.arguments import node_command_line

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# Values of parameters of each type, as they are written in a file or as an argument, and as the
# node has them; and those that may change while it runs.
GIVEN = {
    'fkm': (Fkm, {
        'alert_limit_deg': ('5', 5.0), 'start_checked': ('true', True),
        'frozen_samples': ('0x10', 16), 'solver': ("'theta3a'", 'theta3a'),
        'frame_id': ("'2'", '2'), 'geometry.alpha_deg': ('39', 39.0),
        'sigma_deg': ('[1, 2, 3, 4]', [1.0, 2.0, 3.0, 4.0]), 'working_mode': (
            '[1, 1, 1]', [1, 1, 1])}, {'alert_limit_deg'}),
    'encoder_driver': (lambda given: EncoderDriver(given, Future()), {
        'source': ('sim', 'sim'), 'sim.trajectory': ('sweep', 'sweep'), 'sim.seed': ('99', 99),
        'sim.noise_deg': ('0', 0.0), 'sim.tolerance_deg': ('[1, 2]', [1.0, 2.0])}, set()),
    'diagnostics': (Diagnostics, {
        'dexterity_rate': ('20.0', 20.0), 'dexterity_warn': ('1', 1.0),
        'mounting.base_zxz_deg': ('[1, 2, 3]', [1.0, 2.0, 3.0])},
        {'dexterity_warn', 'dexterity_error', 'dexterity_hysteresis'}),
    'teleop': (Teleop, {
        'teleop.alignment': ('absolute', 'absolute'), 'teleop.command_rate': ('0', 0.0),
        'teleop.frame_id': ("''", '')}, set()),
}


@pytest.mark.parametrize('by_file', [True, False])
@pytest.mark.parametrize('node', GIVEN)
def test_a_node_has_what_it_was_given_and_describes_each_parameter(tmp_path, node, by_file):
    make, values, live = GIVEN[node]
    if by_file:
        path = tmp_path / 'rig.yaml'
        path.write_text(f'/**/{node}:\n  ros__parameters:\n' + ''.join(
            f'    {name}: {text}\n' for name, (text, _) in values.items()))
        words = ['--params-file', str(path)]
    else:
        words = [word for name, (text, _) in values.items() for word in ('-p', f'{name}:={text}')]
    with ros():
        made = make(node_command_line(node, '', [node], ['program', *words])[1])
        for name, (_, expected) in values.items():
            value = made.get_parameter(name).value
            assert (list(value) if isinstance(expected, list) else value) == expected
        for descriptor in made.describe_parameters(list(made.values)):
            assert len(descriptor.description) > 5, descriptor.name
            assert (descriptor.floating_point_range or descriptor.integer_range
                    or descriptor.additional_constraints), descriptor.name
            assert descriptor.read_only == (descriptor.name not in live), descriptor.name
        made.destroy_node()


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
