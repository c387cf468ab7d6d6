# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command lines with and without --ros-args, and what reaches which node."""

import pytest
from spm_haptic_master.arguments import full_name, node_command_line, Parser, sections
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.executables import PIPELINE
from spm_haptic_master.parameter_files import (
    effective,
    parse_value,
    read_parameters,
    read_sections,
    Section,
)

DRIVER = '/encoder_driver'


def command_line(*args, nodes=PIPELINE):
    return node_command_line('master', '', nodes, ['program', *args])


@pytest.mark.parametrize('args', [
    ('-p', 'source:=sim', '-r', '__ns:=/left'),
    ('--ros-args', '-p', 'source:=sim', '-r', '__ns:=/left'),
    ('--ros-args', '-r', '__ns:=/left', '--', '-p', 'source:=sim'),
    ('--param', 'source:=sim', '--ros-args', '--remap', '__ns:=/left', '--ros-args'),
])
def test_both_styles_are_one(args):
    assert command_line(*args) == [
        'program', '--ros-args', '--param', 'source:=sim', '--remap', '__ns:=/left']


def test_every_argument_of_ros_is_passed_on(tmp_path):
    path = tmp_path / 'rig.yaml'
    path.write_text('/**:\n  ros__parameters: {rate: 1.0}\n')
    given = ['--params-file', str(path), '--param', 'source:=sim', '--remap', 'a:=b',
             '--remap', 'fkm:measured_js:=c', '--log-level', 'debug', '--log-level', 'rcl:=info',
             '--log-config-file', 'x', '--enclave', '/e', '--enable-rosout-logs',
             '--disable-stdout-logs']
    assert command_line(*given) == ['program', '--ros-args', *given]
    # Files come before parameters, which override them.
    assert command_line(*given[2:4], *given[:2]) == ['program', '--ros-args', *given[:4]]


@pytest.mark.parametrize(('args', 'reason'), [
    (('source:=sim',), "argument 'source:=sim'; expected -p NAME:=VALUE"),
    (('-p', 'source:=sim', 'x'), "argument 'x'"),
    (('--params-fil', 'x'), "argument '--params-fil'"),
    (('--rate', '3'), "argument '--rate'"),
    (('-p',), 'argument -p/--param: expected one argument'),
    (('-p', ':=1'), "-p ':=1'; expected NAME:=VALUE"),
    (('-p', 'a:=[1'), r"value '\[1'; expected YAML"),
    (('-r', 'a'), "-r 'a'; expected FROM:=TO"),
    (('-r', '__ns:='), "-r '__ns:='; expected FROM:=TO"),
    (('-p', 'other:rate:=1.0'), '-p rate:=1.0: none of its entries reaches a node .* /other'),
])
def test_what_ros_would_ignore_is_refused(args, reason):
    with pytest.raises(InputError, match=reason) as error:
        command_line(*args)
    assert '\n' not in str(error.value)


def test_help_lists_the_arguments(capsys):
    with pytest.raises(SystemExit) as end:
        command_line('--help')
    assert end.value.code == 0
    assert '--params-file' in capsys.readouterr().out


@pytest.mark.parametrize(('remaps', 'name'), [
    ([], '/fkm'), (['__ns:=/'], '/fkm'), (['__ns:=/left'], '/left/fkm'),
    (['__ns:=left/arm'], '/left/arm/fkm'), (['__node:=f'], '/f'), (['__name:=f'], '/f'),
    (['other:__ns:=/a', 'fkm:__ns:=/b', '__ns:=/c'], '/b/fkm'),
    (['__ns:=/a', 'fkm:__ns:=/b'], '/a/fkm'), (['measured_js:=x', 'fkm:__node:=g'], '/g'),
])
def test_names_of_nodes_are_those_of_rcl(remaps, name):
    assert full_name('fkm', remaps) == name


@pytest.mark.parametrize(('pattern', 'node', 'reaches'), [
    ('/**', '/a', True), ('/**', '/a/b/c', True), ('/*', '/a', True), ('/*', '/a/b', False),
    ('/**/b', '/b', True), ('/**/b', '/x/y/b', True), ('/**/b', '/x/b/y', False),
    ('/*/b', '/x/b', True), ('/*/b', '/b', False), ('/a', '/a', True), ('/a', '/x/a', False),
    ('/a/**', '/a/b', True), ('/a.b', '/axb', False),
])
def test_wildcards_are_those_of_rcl(pattern, node, reaches):
    assert Section('f', pattern, {}).reaches(node) is reaches


def section(origin, nodes, **values):
    return Section(origin, nodes, values)


def test_what_counts_is_what_ros_takes():
    """Sections of one name merge in the place of the first; a later name overrides."""
    assert effective([section('f', '/**', a=1, b=1), section('f', '/encoder_driver', a=2),
                      section('f', '/fkm', a=9)], DRIVER) == {'a': 2, 'b': 1}
    assert effective([section('f', '/encoder_driver', a=2), section('f', '/**', a=1)],
                     DRIVER) == {'a': 1}
    assert effective([section('f', '/encoder_driver', a=1), section('g', '/**', a=2),
                      section('-p', '/**', a=3)], DRIVER) == {'a': 3}
    assert effective([section('f', '/**', a=1), section('g', '/**', a=2)], DRIVER) == {'a': 2}


@pytest.mark.parametrize('later', [
    [section('-p a:=3', '/**', a=3)], [section('g', '/**', a=3)],
    [section('g', '/**/encoder_driver', b=1), section('g', '/**', a=3)]])
def test_a_later_value_without_effect_is_refused(later):
    with pytest.raises(InputError, match='a has no effect, because section /encoder_driver of f'):
        effective([section('f', '/**', b=1), section('f', DRIVER, a=2), *later], DRIVER)
    # It has one on other nodes.
    effective([section('f', '/**', b=1), section('f', DRIVER, a=2), *later], '/fkm')


@pytest.mark.parametrize(('text', 'value'), [
    ('1', 1), ('1.0', 1.0), ('1e3', 1000.0), ('-2.5E-3', -0.0025), ('.5e1', 5.0), ('0x80', 128),
    ('true', True), ('can0', 'can0'), ("'2'", '2'), ('2026-01-01', '2026-01-01'),
    ('[1, 2]', [1, 2]), ('', None)])
def test_values_are_read_as_rcl_reads_them(text, value):
    found = parse_value(text)
    assert found == value
    assert type(found) is type(value)


def test_a_tool_takes_the_section_of_its_namespace(tmp_path):
    path = tmp_path / 'rig.yaml'
    path.write_text('left: {encoder_driver: {ros__parameters: {can: {channel: can1}}}}\n'
                    '/right/encoder_driver: {ros__parameters: {can.channel: can2}}\n')
    found = Parser('t', '').parse(['--params-file', str(path), '-p', 'rate:=5.0', '-p',
                                   'rate:=6.0'])
    given = sections(found)
    assert effective(given, '/left/encoder_driver') == {'can.channel': 'can1', 'rate': 6.0}
    assert effective(given, '/right/encoder_driver') == {'can.channel': 'can2', 'rate': 6.0}
    assert read_parameters(path, '/left/encoder_driver') == {'can.channel': 'can1'}
    with pytest.raises(InputError, match='it has /left/encoder_driver, /right/encoder_driver'):
        read_parameters(path)


@pytest.mark.parametrize(('text', 'reason'), [
    ('a: {b: 1}', 'has no ros__parameters'), ('a: {ros__parameters: 1}', 'no ros__parameters'),
    ('a: {}', 'section /a has no ros__parameters'), ('', 'not a ROS parameter file'),
    ('a: {ros__parameters: {x: 1}}\n/a: {ros__parameters: {x: 2}}', 'section /a is given twice'),
    ('a: {ros__parameters: {x: {y: 1, y: 2}}}', "key 'y' is given twice"),
    ('a: {ros__parameters: {x: [[1]]}}', r'x is \[\[1\]\]; expected a list of single values'),
    ('a: {ros__parameters: {x: [{a: 1}]}}', 'expected a list of single values'),
    ('a: {ros__parameters: {x: [1, a]}}', 'expected a list of one type'),
    ('a: {ros__parameters: {x: ~}}', 'x has no value'),
])
def test_a_file_that_ros_would_misread_is_refused(tmp_path, text, reason):
    path = tmp_path / 'rig.yaml'
    path.write_text(text)
    with pytest.raises(InputError, match=reason) as error:
        read_sections(path)
    assert str(path) in str(error.value)
    assert '\n' not in str(error.value)
