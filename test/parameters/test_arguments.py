# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command lines with and without --ros-args: what rclpy gets, and what the resolver."""

from argparse import ArgumentTypeError

import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.executables import PIPELINE
from spm_haptic_master.parameters.arguments import finite, help_text, node_command_line, positive
from spm_haptic_master.parameters.nodes import process_settings


def command_line(*args, name='master', nodes=PIPELINE):
    return node_command_line(name, 'what it is', nodes, ['program', *args])


@pytest.mark.parametrize(
    'args',
    [
        ('-p', 'source:=sim', '-r', '__ns:=/left'),
        ('--ros-args', '-r', '__ns:=/left', '--', '-p', 'source:=sim'),
        ('--param', 'source:=sim', '--ros-args', '--remap', '__ns:=/left', '--ros-args'),
    ],
)
def test_both_styles_are_one(args):
    found, parameters = command_line(*args)
    assert found == ['program', '--ros-args', '--remap', '__ns:=/left']
    assert parameters.of('fkm') == {'source': 'sim'}
    assert parameters.full_name('fkm') == '/left/fkm'


def test_ros_arguments_are_passed_on(tmp_path):
    path = tmp_path / 'rig.yaml'
    path.write_text('/**:\n  ros__parameters: {rate: 1.0}\n')
    passed = [
        *(
            word
            for text in (
                'a:=b',
                '~/a:=b',
                'a:=~/b',
                'a/b:=/c/d',
                'rostopic://a:=b',
                'rosservice:///a/b:=c',
                'fkm:a:=b',
                '_a:=_b',
                'fkm:__name:=b',
                'fkm:~/a:=b',
                '__ns:=/',
                'fkm:measured_js:=c',
            )
            for word in ('--remap', text)
        ),
        '--log-level',
        'debug',
        '--log-level',
        'rcl:=INFO',
        '--log-config-file',
        'x',
        '--enclave',
        '/e',
        '--enable-rosout-logs',
        '--disable-stdout-logs',
    ]
    found, parameters = command_line('--param', 'rate:=2.0', '--params-file', str(path), *passed)
    assert found == ['program', '--ros-args', *passed]
    assert parameters.of('fkm') == {'rate': 2.0}


@pytest.mark.parametrize(
    ('args', 'reason'),
    [
        (('source:=sim',), "argument 'source:=sim'; expected -p NAME:=VALUE"),
        (('--params-fil', 'x'), "argument '--params-fil'"),
        (('--rate', '3'), "argument '--rate'"),
        (('-p',), 'argument -p/--param: expected one argument'),
        (('-p', ':=1'), "-p ':=1'; expected NAME:=VALUE"),
        (('-r', 'a'), "-r 'a'; expected FROM:=TO"),
        (('-r', '__ns:='), "-r '__ns:='; expected FROM:=TO"),
        (('-r', '__ns:=left'), "-r '__ns:=left'; expected a namespace such as __ns:=/left"),
        (('-r', '__node:=1 a'), "-r '__node:=1 a'; expected a name of letters"),
        (('-r', '__ns:=/a__b'), 'expected a namespace'),
        (('-r', '__ns:=/a/'), 'a namespace'),
        (('--log-level', 'rcl:=infos'), "'rcl:=infos'; expected debug"),
        (('-r', '__ns:=/' + 'a' * 300), 'of at most 100 characters'),
        (
            ('-r', 'orientation:=1a'),
            "-r 'orientation:=1a'; expected FROM:=TO with names of letters",
        ),
        (('-r', 'a:=\udcff'), r"-r 'a:=\\udcff'; expected FROM:=TO"),
        *(
            (('-r', text), 'expected FROM:=TO with names')
            for text in (
                'a:=b__c',
                'a__b:=c',
                '~:=b',
                '*:=b',
                'a:=b/',
                'a/:=b',
                '/fkm:a:=b',
                'a:=~',
                '__x:=b',
                'a:=b:=c',
                'a:=\n',
            )
        ),
        (('--params-file', 'no\nwhere'), r'no\\nwhere: cannot be read'),
        (('--params-file', 'a\0b'), 'cannot be read: embedded null'),
        (
            ('-p', 'other:rate:=1.0'),
            '-p other:rate:=1.0: none of its entries reaches a node .* /other',
        ),
        (('-p', 'dexterity_wran:=1.0'), 'such as dexterity_warn'),
        (('-p', 'qos_overrides./x.depth:=1'), 'the QoS of this package is fixed'),
    ],
)
def test_an_argument_without_effect_is_refused(args, reason):
    with pytest.raises(InputError, match=reason) as error:
        command_line(*args)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize('name', ['master', 'recorder'])
def test_help_lists_the_parameters_before_the_arguments(capsys, name):
    with pytest.raises(SystemExit, match='0'):
        command_line('--help', name=name, nodes=[name])
    shown = capsys.readouterr().out
    assert (
        shown.index(help_text(process_settings(name)).strip())
        < shown.index('options:')
        < shown.index('--params-file FILE  ')
    )


def test_a_number_of_an_option_is_finite_and_may_have_to_be_positive():
    for kind, good in (finite, {'1e-300', '2', '-1', '0'}), (positive, {'1e-300', '2'}):
        for text in good:
            assert kind(text) == float(text)
        for text in {'-1', '0', 'nan', 'inf', 'x', ''} - good:
            with pytest.raises(ArgumentTypeError, match=f"^'{text}'; expected a .*number"):
                kind(text)
