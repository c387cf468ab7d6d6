# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options of the tools."""

from refusals.refusal import argument, option, Refusal

CALIBRATION = """/**:
  ros__parameters:
    encoders: {direction: [1, 1, 2, 1], zero_count: [1, 2, 3, 4]}
calibration_record:
  ros__parameters: {date: "2026-01-02"}
"""

TOOLS = (
    option(
        'calibrate',
        '--pose',
        '0 0 0',
        'out of reach of the manipulator',
        message='--pose 0 0 0: out of reach of the manipulator',
    ),
    *(
        option(
            program,
            name,
            value,
            'not above 0',
            message=(
                f"argument {name}: '{value}'; expected a number above 0 "
                '(--help lists the arguments)'
            ),
        )
        for program, name, value in (
            ('calibrate', '--seconds', '0'),
            ('calibrate', '--noise-limit', '-1'),
            ('calibrate', '--tolerance', '0'),
            ('can_scan', '--seconds', '-3'),
            ('sim_bus', '--heartbeat', '0'),
        )
    ),
    *(
        option(
            program,
            name,
            value,
            'not finite',
            message=(
                f"argument {name}: '{value.split()[0]}'; expected a finite number "
                '(--help lists the arguments)'
            ),
        )
        for program, name, value in (
            ('calibrate', '--pose', 'nan 0 0'),
            ('calibrate', '--seconds', 'inf'),
            ('calibrate', '--drift-limit', 'nan'),
            ('calibrate', '--jig-error', '1e999'),
            ('sim_bus', '--seconds', 'nan'),
            ('can_setup', '--heartbeat', 'nan'),
        )
    ),
    option(
        'sim_bus',
        '--fault',
        'noise:joint_1a@1=1e400',
        'not finite',
        message="fault 'noise:joint_1a@1=1e400': VALUE is inf; expected a finite number",
    ),
    option(
        'sim_bus',
        '--fault',
        'offset:joint_1a@1=nan',
        'not finite',
        message="fault 'offset:joint_1a@1=nan': VALUE is nan; expected a finite number",
    ),
    option(
        'calibrate',
        '-o',
        '/dev/full',
        'not a regular file',
        message='-o: /dev/full exists; expected a regular file, or none',
    ),
    option(
        'calibrate',
        '-o',
        '/no/such/a.yaml',
        'its directory does not exist',
        message='-o /no/such/a.yaml; expected a file in an existing directory',
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml'),
        '-o',
        'a file that exists, without `--force`',
        'it is not overwritten',
        files={'a.yaml': 'a: 1\n'},
        message=(
            '-o: a.yaml already exists; expected --force to overwrite it, or --motion --check '
            'to compare a motion with a calibration'
        ),
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml', '--force'),
        '-o',
        'a file that `calibrate` did not write',
        'it is not overwritten',
        files={'a.yaml': 'a: 1\n'},
        message='a.yaml:1: section /a has no ros__parameters',
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml', '--force'),
        '-o',
        'a calibration with a direction other than 1 and -1',
        'it was edited',
        files={'a.yaml': CALIBRATION},
        message=(
            "a.yaml: not a calibration that calibrate wrote: parameter 'encoders.direction' is "
            '[1, 1, 2, 1]; expected a list of 4, each one of 1, -1'
        ),
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml', '-p', 'source:=sim'),
        'source',
        '`sim` for `calibrate`',
        'a simulation has nothing to calibrate',
        message=(
            "parameter 'source' is 'sim'; expected can or replay (a simulation has nothing to "
            'calibrate)'
        ),
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml', '-p', 'source:=replay', *('--pose', '0', '0', '0') * 2),
        '--pose',
        'twice for a recording',
        'a recording has one pose',
        message=(
            '--pose is given 2 times; expected once for a recording: run calibrate again, with '
            '--force, for the recording at the next pose'
        ),
    ),
    argument(
        'can_scan',
        '--start --passive',
        '--passive',
        'with `--start`',
        '`--start` sends frames',
        message='--start with --passive, which sends nothing; expected one of the two',
    ),
    option(
        'sim_bus',
        '--fault',
        'melt:joint_1a@1',
        'no such fault',
        message=(
            "fault 'melt:joint_1a@1': kind 'melt'; expected one of dropout, unplug, late, "
            'loss, stuck, offset, jump, noise, counter, emcy, reboot, silence, busoff, drive, '
            'drive_unplug, drive_deaf, drive_torque'
        ),
    ),
    option(
        'sim_bus',
        '--fault',
        'stuck:joint_3b@1',
        'there are four `sensors`',
        message=(
            "fault 'stuck:joint_3b@1': joint 'joint_3b'; expected one of joint_1a, joint_1b, "
            'joint_1c, joint_3a'
        ),
    ),
    option(
        'sim_bus',
        '--fault',
        'noise:joint_1a@1=-1',
        'noise is not negative',
        message="fault 'noise:joint_1a@1=-1': VALUE is -1; expected 0 or more (deg, 1 sigma)",
    ),
    option(
        'sim_bus',
        '--fault',
        'dropout:joint_1a@1+0',
        'it would never begin',
        message="fault 'dropout:joint_1a@1+0': +0; expected a duration above 0",
    ),
    Refusal(
        'validate',
        ('r.csv', 'c.csv', '--marker-azimuths', '0', 'inf'),
        '--marker-azimuths',
        '0 inf',
        'not finite',
        message=(
            "argument --marker-azimuths: 'inf'; expected a finite number (--help lists the "
            'arguments)'
        ),
    ),
    *(
        Refusal(
            program,
            files,
            'RECORDING',
            'a file that does not exist',
            f'there is nothing to {verb}',
            message="r.csv: cannot be read: [Errno 2] No such file or directory: 'r.csv'",
        )
        for program, verb, files in (
            ('validate', 'compare', ('r.csv', 'c.csv')),
            ('supervise', 'supervise', ('r.csv',)),
        )
    ),
)
