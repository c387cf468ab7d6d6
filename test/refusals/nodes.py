# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of single nodes."""

from refusals.refusal import argument, parameter

NODES = (
    parameter(
        'fkm',
        {'frame_id': "''"},
        'frame_id',
        'empty',
        'no frame has that name',
        message="parameter 'frame_id' is ''; expected a text that is not empty",
    ),
    parameter(
        'fkm',
        {'mounting.base_zxz_deg': [10.0, 0.0, 0.0], 'mounting.table_frame_id': 'spm_base'},
        'mounting.table_frame_id',
        "another frame's name, with a mounting",
        'a frame cannot be mounted on itself',
        message=(
            "parameter 'mounting.table_frame_id' is 'spm_base'; expected another frame than "
            'that of frame_id'
        ),
    ),
    parameter(
        'diagnostics',
        {'dexterity_error': 0.2},
        'dexterity_error',
        'above `dexterity_warn`',
        'ERROR comes after WARN',
        message=(
            "parameter 'dexterity_error' is 0.2; expected a number of at most dexterity_warn "
            '(0.059)'
        ),
    ),
    parameter(
        'teleop',
        {'teleop.speed_limit': 0.1},
        'teleop.align_speed',
        'above `teleop.speed_limit`',
        'it would never be reached',
        message=(
            "parameter 'teleop.align_speed' is 0.2; expected at most teleop.speed_limit (0.1)"
        ),
    ),
    parameter(
        'teleop',
        {'teleop.insertion_scale': 0.01},
        'teleop.insertion_scale',
        'above 0 and below 0.05',
        'the tip would hardly move',
        message=(
            "parameter 'teleop.insertion_scale' is 0.01; expected at least 0.05, or 0 for a "
            'depth that stays'
        ),
    ),
    parameter(
        'teleop',
        {'teleop.depth_range': [0.2, 0.1]},
        'teleop.depth_range',
        'the larger depth first',
        'no depth would be allowed',
        message=(
            "parameter 'teleop.depth_range' is [0.2, 0.1]; expected the smaller depth before "
            'the larger one'
        ),
    ),
    parameter(
        'teleop',
        {'teleop.trocar': [0.1, 0.2]},
        'teleop.trocar',
        'another number of values than 1 or 3',
        'it is no place',
        message=(
            "parameter 'teleop.trocar' is [0.1, 0.2]; expected three numbers x, y, z (m), or "
            '0.0 for none'
        ),
    ),
    parameter(
        'teleop',
        {'teleop.shaft_axis': [0.0, 0.0, 0.5]},
        'teleop.shaft_axis',
        'another length than 1',
        'a slip of the pen would be another direction',
        message=(
            "parameter 'teleop.shaft_axis' is [0.0, 0.0, 0.5]; expected a vector of length 1, "
            'or zeros where it is not known'
        ),
    ),
    argument(
        'master',
        '-r __node:=x',
        '`-r __node:=NAME` of several nodes',
        'a name for all of them',
        'they would be one to every client',
        message=(
            'remapping __node: several nodes would be /x; expected one node of encoder_driver, '
            'fkm, diagnostics, teleop, such as encoder_driver:__node:=NAME'
        ),
    ),
    parameter(
        'fkm',
        {'realtime.cpus': '0-999999999'},
        'realtime.cpus',
        'cores that there are not',
        'the process would run elsewhere',
        message=(
            "parameter 'realtime.cpus' is '0-999999999'; expected cores such as '0' or "
            "'0,2-3', of those allowed: ..."
        ),
    ),
    parameter(
        'fkm',
        {'realtime.slice': 0.00005},
        'realtime.slice',
        'below 0.0001, but not 0',
        'Linux has no such slice',
        message="parameter 'realtime.slice' is 5e-05; expected 0, or 0.0001 to 0.1",
    ),
)
