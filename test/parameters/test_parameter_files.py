# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameter files and values on the command line: what is read, and what is refused."""

import math
from pathlib import Path
import sys

import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters import files
from spm_haptic_master.parameters.files import argument_section, read_sections, Section


@pytest.fixture
def read(tmp_path):
    """Read the sections of a file with a content."""

    def read(content):
        path = tmp_path / 'rig.yaml'
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_sections(path)

    return read


def value_of(text):
    return argument_section(f'a:={text}').values['a']


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('1', 1),
        ('-7', -7),
        ('+5', 5),
        ('0x80', 128),
        ('-0x8000000000000000', -1 << 63),
        ('1.0', 1.0),
        ('1e3', 1000.0),
        ('-2.5E-3', -0.0025),
        ('.5e1', 5.0),
        ('5.', 5.0),
        ('-.inf', -math.inf),
        ('true', True),
        ('no', False),
        ('On', True),
        ('can0', 'can0'),
        ("'2'", '2'),
        ('"~"', '~'),
        ("''", ''),
        ('2026-01-01', '2026-01-01'),
        ('239.74.1.99', '239.74.1.99'),
        ('/dev/ttyS0', '/dev/ttyS0'),
        ('[1, 2]', [1, 2]),
        ("['y', n1]", ['y', 'n1']),
        ('[]', []),
    ],
)
def test_a_value_is_read(text, value):
    found = value_of(text)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    'text',
    [
        '8:20',
        '1_000.0',
        '1_000',
        '0b11',
        'y',
        'N',
        '~',
        'null',
        '010',
        '08',
        '0x1.8p3',
        'inf',
        '-Infinity',
        'nan',
        '=',
        '<<',
    ],
)
@pytest.mark.parametrize('place', ['{}', '[{}]'])
def test_a_value_that_yaml_and_ros_read_differently_is_refused(read, text, place):
    shown = place.format(text)
    with pytest.raises(InputError, match='which YAML and ROS read differently') as error:
        value_of(shown)
    assert f'is {text},' in str(error.value)
    with pytest.raises(InputError, match='rig.yaml:4: a is '):
        read(f'/**:\n  ros__parameters:\n    b: 1\n    a: {shown}\n')


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('a:=[1', 'expected a value in YAML'),
        ('a:=[[[[', 'expected a value in YAML'),
        ('a:=' + '[' * 500 + ']' * 500, 'nested too deeply'),
        ('a:=!!python/name:os.system', r'a tag \(!\); expected a plain value$'),
        ('a:=&x [*x]', 'an anchor'),
        ('a:=*x', 'an alias'),
        ('a:=', "a has no value; expected one, or '' for an empty text"),
        ('a:=[1, a]', r"a is \[1, 'a'\]; expected a list of one type"),
        ('a:=[0.040, 1, 2]', r'whole numbers beside decimal ones; expected 1.0 for 1'),
        ('a:=[[1]]', 'a list of lists; expected a list of single values'),
        pytest.param('a:=' + '9' * 5000, 'a is too large; expected .* at most 64 bits', id='9...'),
        ('//fkm:a:=1', "section '//fkm'; expected a node's name"),
        ('a:=9223372036854775808', 'expected .* at most 64 bits'),
        ('a:=-0x8000000000000001', 'expected .* at most 64 bits'),
        (r'a:="\UFFFFFFFF"', 'no such character'),
        (r'a:="\ud800"', r"'\\ud800' has a NUL or half a character"),
    ],
)
def test_a_wrong_argument_is_refused_in_one_line(text, reason):
    with pytest.raises(InputError, match=reason) as error:
        argument_section(text)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        ('a: {b: 1}', 'section /a/b has no ros__parameters'),
        ('a: {ros__parameters: 1}', 'ros__parameters has no parameters'),
        ('a: {}', 'section /a has no ros__parameters'),
        ('', 'not a ROS parameter file'),
        ('- 1', 'not a ROS parameter file'),
        (
            'a: {ros__parameters: {x: 1}}\n/a: {ros__parameters: {x: 2}}',
            'section /a is given twice',
        ),
        ('a: {ros__parameters: {x: {y: 1, y: 2}}}', "key 'y' is given twice"),
        ('a: {ros__parameters: {x.y: 1, x: {y: 1}}}', 'x.y is given twice in section /a'),
        (
            '/**:\n  ros__parameters:\n    source:can\n',
            "'source:can' has no space after the colon",
        ),
        (
            '/**:\n  ros__parameters:\n    rate: 1.0\n    can:\n      channel:can1\n      '
            'bitrate: 1\n',
            "rig.yaml:5: 'channel:can1'; expected a space after the colon",
        ),
        ('/**:\n\tros__parameters: {a: 1}\n', 'rig.yaml:2: a tab; expected spaces'),
        ('a: {ros__parameters: {x: [1, 2}}', 'rig.yaml:1: not valid YAML'),
        ('a: {ros__parameters: {x: 1}}\n---\nb: {}\n', 'rig.yaml:2: not valid YAML'),
        ('a: &x {ros__parameters: {y: *x}}', 'rig.yaml:1: not valid YAML: an anchor'),
        ('? [a, b]\n: 1\n', 'rig.yaml:1: a key that is not a name'),
        (b'\xff\xfe\x00', 'cannot be read'),
        (b'a: \x07', 'not valid YAML'),
        ("'': {ros__parameters: {x: 1}}", 'rig.yaml:1: an empty key'),
        ('a: {ros__parameters: {x: {"": 1}}}', 'rig.yaml:1: an empty key'),
        ('a/: {ros__parameters: {x: 1}}', "section 'a/'"),
        ('/: {ros__parameters: {x: 1}}', "'/'"),
        ('a:\n  ros__parameters:\n    x: |-\n      5\n', 'rig.yaml:3: x is a block of text'),
        ('#' * (1 << 20) + '\n', 'larger than 1048576 bytes'),
    ],
)
def test_a_file_that_could_be_misread_is_refused(read, content, reason):
    with pytest.raises(InputError) as error:
        read(content)
    message = str(error.value)
    assert reason in message
    assert 'rig.yaml' in message
    assert '\n' not in message


def test_names_may_be_nested_or_dotted(read):
    (left, right) = read(
        'left: {encoder_driver: {ros__parameters: {can: {channel: can1}}}}\n'
        '/right/encoder_driver: {ros__parameters: {can.channel: can2}}\n'
    )
    assert (left.nodes, left.values) == ('/left/encoder_driver', {'can.channel': 'can1'})
    assert (right.nodes, right.values) == ('/right/encoder_driver', {'can.channel': 'can2'})


@pytest.mark.parametrize(
    ('pattern', 'node', 'reaches'),
    [
        ('/**', '/a', True),
        ('/**', '/a/b/c', True),
        ('/*', '/a', True),
        ('/*', '/a/b', False),
        ('/**/b', '/b', True),
        ('/**/b', '/x/y/b', True),
        ('/**/b', '/x/b/y', False),
        ('/*/b', '/x/b', True),
        ('/*/b', '/b', False),
        ('/a', '/a', True),
        ('/a', '/x/a', False),
        ('/**' * 500 + '/x', '/a/b/c/d', False),
        ('/a/**/**', '/a', True),
        ('/**x', '/x', False),
        ('/a/**', '/a/b', True),
        ('/a.b', '/axb', False),
    ],
)
def test_wildcards_are_those_of_rcl(pattern, node, reaches):
    assert Section('f', pattern, {}).reaches(node) is reaches


def test_the_config_files_are_those_of_the_checkout_or_below_a_prefix(tmp_path, monkeypatch):
    assert files.config_directory() == Path(files.__file__).parents[2] / 'config'
    monkeypatch.setattr(files, '__file__', str(tmp_path / 'site' / 'package' / 'files.py'))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'python'))
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/none:{tmp_path}/ros')
    share = 'share/spm_haptic_master/config'
    with pytest.raises(FileNotFoundError, match=f'{tmp_path}/config, /none/{share}, {tmp_path}'):
        files.config_directory()
    for prefix in 'python', 'ros':
        found = tmp_path / prefix / share
        found.mkdir(parents=True)
        (found / 'sim.yaml').touch()
        assert files.config_directory() == found
