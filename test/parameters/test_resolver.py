# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Package defaults < parameter files in their order < `-p`; what disagrees is refused."""

import pytest
import rclpy
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.parameters.resolver import Parameters, read_parameters, resolve_source


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a file of sections and parameters in the working directory; return its name."""
    monkeypatch.chdir(tmp_path)

    def write(name, content):
        (tmp_path / name).write_text(
            ''.join(
                f'{nodes}:\n  ros__parameters: {values}\n' for nodes, values in content.items()
            )
        )
        return name

    return write


def test_a_later_file_wins_and_p_wins_over_all(write):
    # A calibration that is given later overrides what it has measured.
    first = write(
        'a.yaml',
        {
            '/**/fkm': '{alert_limit_deg: 5, geometry: {alpha_deg: 39.0}, '
            'encoders: {direction: [1, 1, 1, 1]}}'
        },
    )
    second = write(
        'b.yaml',
        {'/**': '{geometry.alpha_deg: 39.1, window: 0.03, encoders: {direction: [1, -1, 1, 1]}}'},
    )
    found = Parameters([first, second]).of('fkm')
    assert found == {
        'alert_limit_deg': 5,
        'geometry.alpha_deg': 39.1,
        'window': 0.03,
        'encoders.direction': [1, -1, 1, 1],
    }
    assert Parameters([second, first]).of('fkm')['geometry.alpha_deg'] == 39.0
    # And a later section of a file.
    for sections, rate in (
        ({'/**': '{rate: 1.0}', '/fkm': '{rate: 2.0}'}, 2.0),
        ({'/fkm': '{rate: 2.0}', '/**': '{rate: 1.0}'}, 1.0),
    ):
        assert Parameters([write('c.yaml', sections)]).of('fkm') == {'rate': rate}
    found = Parameters(
        [first, second],
        [
            'geometry.alpha_deg:=39.2',
            'alert_limit_deg:=fast',
            'fkm:window:=1',
            'diagnostics:window:=2',
        ],
    ).of('fkm')
    assert found == {
        'alert_limit_deg': 'fast',
        'geometry.alpha_deg': 39.2,
        'window': 1,
        'encoders.direction': [1, -1, 1, 1],
    }


@pytest.mark.parametrize(
    ('one', 'other'),
    [
        ('can: {channel: can0}', 'can.channel: can1'),
        ('source: can', 'source: sim'),
        ('encoders: {id: [1, 2, 3, 4]}', 'encoders: {id: [1, 2, 3, 5]}'),
        ('sensors: 4', 'sensors: 6'),
        ('encoders.counts_per_turn: [2, 2, 2, 2]', 'encoders.counts_per_turn: [4, 2, 2, 2]'),
    ],
)
def test_two_files_that_disagree_about_bus_or_layout_are_named(write, one, other):
    files = [
        write('rig.yaml', {'/**/encoder_driver': f'{{{one}}}'}),
        write('calibration.yaml', {'/**': f'{{{other}}}'}),
    ]
    with pytest.raises(InputError, match='rig.yaml and .* in calibration.yaml') as error:
        Parameters(files).of('encoder_driver')
    assert '\n' not in str(error.value)
    assert ('[0x1, 0x2, 0x3, 0x4]' in str(error.value)) == ('id:' in one)
    # The same value in both is no contradiction, and the command line decides.
    files[1] = write('calibration.yaml', {'/**': f'{{{one}}}'})
    assert len(Parameters(files).of('encoder_driver')) == 1
    files[1] = write('calibration.yaml', {'/**': f'{{{other}}}'})
    name = next(iter(Parameters(files[1:]).of('encoder_driver')))
    given = Parameters(files, [f"{name}:='x'"]).of('encoder_driver')
    assert given == {name: 'x'}


@pytest.mark.parametrize(
    ('remaps', 'name'),
    [
        ([], '/fkm'),
        (['__ns:=/'], '/fkm'),
        (['__ns:=/left'], '/left/fkm'),
        (['__ns:=/left/arm'], '/left/arm/fkm'),
        (['__node:=f'], '/f'),
        (['__name:=f'], '/f'),
        (['other:__ns:=/a', 'fkm:__ns:=/b', '__ns:=/c'], '/b/fkm'),
        (['fkm:__node:=f', 'fkm:__ns:=/b'], '/f'),
        (['fkm:__node:=f', 'f:__ns:=/b'], '/b/f'),
        (['f:__ns:=/b', '__node:=f', 'f:__node:=g'], '/b/f'),
        (['__ns:=/a', 'fkm:__ns:=/b'], '/a/fkm'),
        (['measured_js:=x', 'fkm:__node:=g'], '/g'),
    ],
)
def test_names_of_nodes_are_those_of_rcl(remaps, name):
    arguments = ['--ros-args', *(word for remap in remaps for word in ('-r', remap))]
    with rclpy.Context() as context:
        node = rclpy.create_node('fkm', context=context, cli_args=arguments)
        assert node.get_fully_qualified_name() == name
        node.destroy_node()
    assert Parameters(remaps=remaps).full_name('fkm') == name


def test_a_section_reaches_the_node_by_its_name_after_remapping(write):
    path = write('rig.yaml', {'/left/encoder_driver': '{rate: 1.0}', '/right/d': '{rate: 2.0}'})
    assert Parameters([path], (), ['__ns:=/left']).of('encoder_driver') == {'rate': 1.0}
    found = Parameters(
        [path],
        ['d:rate:=3.0', '/right/d:sensors:=5'],
        ['__ns:=/right', 'encoder_driver:__node:=d'],
    )
    assert found.of('encoder_driver') == {'rate': 2.0, 'sensors': 5}
    with pytest.raises(InputError, match='it has /left/encoder_driver, /right/d, expected /'):
        read_parameters(path)


def test_a_file_may_have_what_other_nodes_of_the_package_take_but_no_other_name(write):
    names = {'alert_limit_deg'}
    path = write('rig.yaml', {'/**': '{alert_limit_deg: 1.0, can.channel: can0}'})
    Parameters([path]).check(['fkm'], names)
    # An argument for another node is known, and counted as one without effect.
    given = Parameters([path], ['can.channel:=can1', 'alert_limit_deg:=2.0'])
    given.check(['fkm'], names)
    assert given.unused({'/fkm': names}) == ['-p can.channel:=can1']
    path = write('rig.yaml', {'/**': '{alert_limit: 1.0}', '/other': '{rat: 1.0}'})
    with pytest.raises(SettingError, match=r"'alert_limit' is 1.0.*such as alert_limit_deg"):
        Parameters([path]).check(['fkm'], names)


def test_a_name_of_another_node_is_proposed_only_where_it_is_accepted(write):
    """A section of one node has only its own names; one of all nodes has those of each."""
    path = write('rig.yaml', {'/**/diagnostics': '{rate: 100.0}'})
    with pytest.raises(SettingError, match='the section of a node that has it: diagnostics does'):
        Parameters([path]).check(['diagnostics'], {'dexterity_error'})
    path = write('rig.yaml', {'/**': '{alert_limt_deg: 1.0}'})
    with pytest.raises(SettingError, match='such as alert_limit_deg'):
        Parameters([path]).check(['encoder_driver'], {'rate'})


@pytest.mark.parametrize(
    ('nodes', 'values', 'reason'),
    [
        (
            '/**/encoder_driver',
            '{source: sim, alert_limit_deg: 0.5}',
            "'alert_limit_deg' is 0.5; .* encoder_driver does not .*/encoder_driver",
        ),
        ('/**/fkm', '{sim.trajectory: fixed}', "'sim.trajectory' is 'fixed'; .* fkm does not"),
        ('/**/f', '{source: can}', "'source' is 'can'; .* fkm does not"),
        ('/**/fmk', '{rate: 1.0}', r'section /\*\*/fmk reaches no node; expected /\*\*/fkm'),
        (
            '/encoders_driver',
            '{rate: 1.0}',
            'section /encoders_driver .* expected /encoder_driver',
        ),
        ('/left/teleopp', '{rate: 1.0}', 'expected /left/teleop'),
        ('/**/master', '{rate: 1.0}', r'section /\*\*/master .* expected /\*\*,'),
    ],
)
def test_a_section_that_would_have_no_effect_is_refused(write, nodes, values, reason):
    path = write('rig.yaml', {'/**': '{rate: 1.0}', nodes: values})
    remaps = ['fkm:__node:=f'] if nodes == '/**/f' else []
    with pytest.raises(InputError, match=reason) as error:
        Parameters([path], (), remaps).check(['encoder_driver', 'fkm'], {'rate'})
    assert '\n' not in str(error.value)


def test_a_shared_file_may_have_sections_for_other_programs(write):
    path = write(
        'rig.yaml',
        {
            '/**': '{rate: 1.0}',
            '/**/encoder_driver': '{source: sim, realtime.priority: 1}',
            '/**/fkm': '{teleop.run: true, use_sim_time: true}',
            '/**/teleop': '{rate: 1.0}',
            '/slave_controller': '{kp: 1.0}',
            '/right/fkm_right': '{rate: 1.0}',
            '/*/view': '{a: 1}',
            'calibration_record': '{date: a}',
            '/diagnostic_aggregator': '{path: a}',
            '/joy': '{a: 1}',
            '/robot_state_publisher': '{a: 1}',
            '/controller_manager': '{a: 1}',
            '/rviz2': '{a: 1}',
        },
    )
    Parameters([path]).check(['encoder_driver', 'fkm'], {'rate'})


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_the_driver_has_the_defaults_of_its_source(sensors):
    settings, values = resolve_source(
        {
            'source': 'can',
            **simulated_rig(sensors),
            'rate': 500.0,
            'sensors': sensors,
        }
    )
    assert {setting.name for setting in settings} == set(values)
    # Identifiers count up, all else of further sensors is as of the fourth.
    assert values['encoders.id'] == tuple(0x181 + k for k in range(sensors))
    assert values['encoders.node_id'] == tuple(range(1, sensors + 1))
    assert values['encoders.counts_per_turn'] == (16384,) * sensors
    assert len(values['encoders.zero_count']) == sensors
    assert len([name for name in values if '.table_deg.' in name]) == sensors
    assert (values['rate'], values['can.protocol']) == (500.0, 'canopen')
    with pytest.raises(SettingError, match="'source' is not set; expected one of can"):
        resolve_source({})
