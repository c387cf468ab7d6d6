# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a command line or a parameter file has that has no effect, or no meaning."""

from refusals.refusal import argument, CAN, of_file, parameter, Refusal, SIM

SECTION = '  ros__parameters: {source: sim}\n'

COMMAND_LINE = (
    *(
        argument(
            name,
            '',
            'source',
            'not given',
            'a simulation must not pass for a rig',
            message="parameter 'source' is not set; expected one of can, replay, sim",
        )
        for name in ('master', 'encoder_driver')
    ),
    argument(
        'master',
        'source:=can',
        'an argument',
        'without `-p`',
        'ROS ignores it',
        message=(
            "argument 'source:=can'; expected -p NAME:=VALUE, --params-file FILE or another "
            'argument that --help lists'
        ),
    ),
    argument(
        'fkm',
        'rig -p rate:=500.0',
        'an argument',
        'a stray word',
        'ROS ignores it',
        message=(
            "argument 'rig'; expected -p NAME:=VALUE, --params-file FILE or another argument "
            'that --help lists'
        ),
    ),
    argument(
        'can_scan',
        'channel can1',
        'an argument',
        'a stray word',
        'it would have no effect',
        message=(
            "argument 'channel'; expected -p NAME:=VALUE, --params-file FILE or another "
            'argument that --help lists'
        ),
    ),
    *(
        argument(
            name,
            f'-p {given}',
            '-p',
            'a name without a value',
            'expected NAME:=VALUE',
            message=f"-p '{given}'; expected NAME:=VALUE",
        )
        for name, given in (('encoder_driver', 'source'), ('can_scan', 'can.channel'))
    ),
    argument(
        'encoder_driver',
        '-p source:=sim -p sim.nois_deg:=0.1',
        '-p',
        'a name that no node of the package has',
        'ROS ignores it',
        message=(
            "parameter 'sim.nois_deg' is 0.1; expected a parameter of this program, such as "
            'sim.noise_deg, sim.pose_deg, sim.harmonics_deg (-p sim.nois_deg:=0.1, /**)'
        ),
    ),
    argument(
        'can_scan',
        '-p can.chanel:=can1',
        '-p',
        'a name that no node of the package has',
        'ROS ignores it',
        message=(
            "parameter 'can.chanel' is 'can1'; expected a parameter of this program, such as "
            'can.channel (-p can.chanel:=can1, /**)'
        ),
    ),
    parameter(
        'fkm',
        {'qos_overrides./orientation.publisher.depth': 1},
        'qos_overrides./orientation.publisher.depth',
        'any value',
        'no topic of the package takes it',
        message=(
            "parameter 'qos_overrides./orientation.publisher.depth' is 1; expected no "
            'override: the QoS of this package is fixed'
        ),
    ),
    of_file(
        'master',
        '/**/encoders_driver:\n' + SECTION,
        'sections for other nodes only',
        'ROS ignores them',
        message=(
            'rig.yaml: none of its entries reaches a node of this process; it has '
            '/**/encoders_driver, expected /** or /encoder_driver or /fkm or /diagnostics or '
            '/teleop'
        ),
    ),
    of_file(
        'master',
        '/**:\n' + SECTION + '/**/fmk:\n  ros__parameters: {rate: 500.0}\n',
        "a section whose name is almost a node's",
        'its values would have no effect',
        message=(
            'rig.yaml: section /**/fmk reaches no node; expected /**/fkm, or a name less like it'
        ),
    ),
    of_file(
        'encoder_driver',
        '/**/encoder_driver:\n  ros__parameters: {source: sim, alert_limit_deg: 0.5}\n',
        "another node's parameter in the section of one",
        'it would have no effect',
        message=(
            "parameter 'alert_limit_deg' is 0.5; expected the section of a node that has it: "
            'encoder_driver does not (rig.yaml, /**/encoder_driver)'
        ),
    ),
    argument(
        'supervise',
        '-p fkm:rate:=1000.0 -p encoder_driver:rate:=250.0 a.csv',
        'rate',
        'different values for the two nodes of a tool',
        'they belong to one rig',
        message=(
            "parameter 'rate' is 1000.0; expected the same value in fkm as in encoder_driver "
            '(250.0): give it for all nodes, /**'
        ),
    ),
    of_file(
        'master',
        'encoder_driver:\n' + SECTION,
        'a section without the namespace',
        'ROS ignores it',
        arguments=('-r', '__ns:=/left'),
        message=(
            'rig.yaml: none of its entries reaches a node of this process; it has '
            '/encoder_driver, expected /** or /left/encoder_driver or /left/fkm or '
            '/left/diagnostics or /left/teleop'
        ),
    ),
    of_file(
        'fkm',
        '/**/encoder_driver:\n' + SECTION,
        "another process's sections only",
        'nothing of it reaches this process',
        message=(
            'rig.yaml: none of its entries reaches a node of this process; it has '
            '/**/encoder_driver, expected /** or /fkm'
        ),
    ),
    of_file(
        'calibrate',
        '/left/encoder_driver:\n' + SECTION,
        'sections for other nodes only',
        'the defaults of can0 would be taken',
        arguments=('-o', 'a.yaml'),
        message=(
            'rig.yaml: none of its entries reaches a node of this process; it has '
            '/left/encoder_driver, expected /** or /encoder_driver'
        ),
    ),
    Refusal(
        'encoder_driver',
        ('--params-file', 'rig.yaml', '--params-file', 'calibration.yaml'),
        '--params-file',
        'two files with another bus or layout',
        'a calibration holds for the bus and the encoders that it was measured with',
        files={
            'rig.yaml': '/**/encoder_driver:\n  ros__parameters: {can.channel: can1}\n',
            'calibration.yaml': '/**:\n  ros__parameters: {can: {channel: can0}}\n',
        },
        message=(
            'can.channel is can1 in rig.yaml and can0 in calibration.yaml; expected the same: '
            'a calibration holds for the bus and the encoders that it was measured with (undo '
            'the change, or calibrate again)'
        ),
    ),
    of_file(
        'encoder_driver',
        '/**:\n  ros__parameters:\n    source:can\n    rate: 100.0\n',
        'a colon without a space, a tab, or other text that is not valid YAML',
        'nothing can be read from it',
        message="rig.yaml:3: 'source:can'; expected a space after the colon",
    ),
    of_file(
        'encoder_driver',
        '/**:\n  ros__parameters: {rate: 1_000.0}\n',
        'a value such as '
        '`1_000.0`, `8:20`, `0b11`, `010`, `y` or `~`, a block of text, a NUL, more than 64 '
        'bits, an anchor, alias or tag of YAML',
        'YAML and ROS read it differently',
        message=(
            'rig.yaml:2: rate is 1_000.0, which YAML and ROS read differently; expected a '
            "plain number, true, false, or '1_000.0' for a text"
        ),
    ),
    of_file(
        'fkm',
        '/**:\n  ros__parameters:\n    geometry.beta_deg: 34.0\n    geometry: {beta_deg: 34.1}\n',
        'a name, key or section given twice, also in two spellings',
        'one of the values would be lost',
        message='rig.yaml: geometry.beta_deg is given twice in section /**',
    ),
    of_file(
        'fkm',
        '/**:\n  ros__parameters: {sigma_deg: [1, 0.5, 1, 1]}\n',
        'a list of lists or '
        'of several types, a name without a value, a section or name with an empty part',
        'no parameter has such a value or name',
        message=(
            'rig.yaml:2: sigma_deg has whole numbers beside decimal ones; expected 1.0 for 1'
        ),
    ),
    argument(
        'fkm',
        '-p rate:=[[[[',
        '-p',
        'a value that is not valid YAML',
        'it has no value',
        message=(
            "-p rate:=[[[[: expected the node content, but found '<stream end>'; expected a "
            'value in YAML'
        ),
    ),
    argument(
        'fkm',
        '-p use_sim_time:=1',
        'use_sim_time',
        'other than true and false',
        'ROS would end with a traceback',
        message="parameter 'use_sim_time' is 1; expected true or false",
    ),
    argument(
        'fkm',
        '-r __ns:=left',
        '-r',
        '`__ns` without a slash, or another name that begins with a digit or has other characters',
        'ROS has no such name',
        message=(
            "-r '__ns:=left'; expected a namespace such as __ns:=/left, of letters, digits and "
            'single _, with a slash before each part, of at most 100 characters'
        ),
    ),
    argument(
        'fkm',
        '--log-level loud',
        '--log-level',
        'no level of ROS',
        'ROS has no such level',
        message=(
            "--log-level 'loud'; expected debug, info, warn, error, fatal or unset, or "
            'LOGGER:= and one of them'
        ),
    ),
    of_file(
        'fkm',
        '- 1\n',
        'no parameter file',
        'nothing can be read from it',
        message='rig.yaml: not a ROS parameter file (NODE: ros__parameters: ...)',
    ),
    Refusal(
        'fkm',
        ('--params-file', 'nowhere.yaml'),
        '--params-file',
        'a file that does not exist',
        'nothing can be read from it',
        message=(
            "nowhere.yaml: cannot be read: [Errno 2] No such file or directory: 'nowhere.yaml'"
        ),
    ),
    *(
        parameter(
            'master',
            {**SIM, **given},
            what,
            'different values in two nodes of `master`',
            'they belong to one rig',
            message=(
                f"parameter '{what}' is {value}; expected the same value in fkm as in "
                f'encoder_driver ({other}): give it for all nodes, /**'
            ),
        )
        for what, given, value, other in (
            ('rate', {'encoder_driver:rate': 500.0}, '1000.0', '500.0'),
            ('sensors', {'encoder_driver:sensors': 6}, '4', '6'),
            ('geometry.alpha_deg', {'fkm:geometry.alpha_deg': 40.0}, '40.0', '39.3'),
            (
                'geometry.distal_deg',
                {
                    'geometry.distal_deg': [34.0, 34.1, 34.2],
                    'fkm:geometry.distal_deg': [34.1, 34.1, 34.1],
                },
                '(34.1, 34.1, 34.1)',
                '(34.0, 34.1, 34.2)',
            ),
        )
    ),
    parameter(
        'master',
        {**CAN, 'calibration': 'a', 'fkm:calibration': 'b'},
        'calibration',
        'different values in two nodes of `master`',
        'zero counts, sigma and bias are of one calibration',
        message=(
            "parameter 'calibration' is 'b'; expected the same value in fkm as in "
            "encoder_driver ('a'): give it for all nodes, /**"
        ),
    ),
)
