# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the programs refuse at their start: the cases of test_refusals, and the table in refused.md.

Values outside the range of a parameter are refused as well; they are in docs/parameters.md.
"""

from pathlib import Path
from typing import NamedTuple

from benchmarks.pipeline.child_process import parameter_arguments
from spm_haptic_master.parameters.files import simulated_rig


class Refusal(NamedTuple):
    """One refusal."""

    program: str  # executable
    arguments: tuple  # its command line, without the name, in the working directory
    what: str  # parameter or argument, as in the table
    refused: str  # value that is refused, as in the table
    why: str  # reason, as in the table
    files: dict = {}  # content of files by name  # noqa: RUF012


SIM = {'source': 'sim'}
CAN = {
    'source': 'can',
    'can.interface': 'udp_multicast',
    'can.channel': '239.74.0.0',
    **simulated_rig(),
}
FORCE = {'force.enabled': True, 'force.without_drives': True, 'crtk_rate': 0.0}
CHECK = Path(__file__).resolve().parents[1] / 'config' / 'simulated_check.json'
ONE_BUS = {
    **CAN,
    'force.enabled': True,
    'drives.interface': 'udp_multicast',
    'drives.channel': '239.74.0.0',
    'drives.rated_torque': [0.5],
    'drives.bitrate': 1000000,
    'drives.check_file': CHECK,
    'encoders.accept_unverified_directions': True,
}
DRIVEN = {
    **SIM,
    'force.enabled': True,
    'drives.interface': 'virtual',
    'drives.channel': 'x',
    'drives.rated_torque': [0.5],
}
LOG = Path(__file__).with_name('data') / 'fig9_canopen.log.gz'
REPLAY = {'source': 'replay', 'replay.path': LOG, **simulated_rig()}


def argument(program, given, what, refused, why):
    """Return the refusal of a command line of words without blanks."""
    return Refusal(program, given.split(), what, refused, why)


def parameter(program, parameters, what, refused, why):
    """Return the refusal of a parameter."""
    return Refusal(program, parameter_arguments(parameters), what, refused, why)


def driver(what, value, refused, why, **others):
    """Return the refusal of a parameter of a driver on a bus; in names, __ stands for a dot."""
    given = {name.replace('__', '.'): value for name, value in others.items()}
    return parameter('encoder_driver', {**CAN, **given, what: value}, what, refused, why)


def of_file(program, content, refused, why, arguments=()):
    """Return the refusal of a parameter file."""
    return Refusal(
        program,
        ('--params-file', 'rig.yaml', *arguments),
        '--params-file',
        refused,
        why,
        {'rig.yaml': content},
    )


def option(program, name, value, why):
    """Return the refusal of an option of a tool."""
    needed = ('-o', 'a.yaml') if program == 'calibrate' and name != '-o' else ()
    return Refusal(program, (*needed, name, *value.split()), name, value, why)


CALIBRATION = """/**:
  ros__parameters:
    encoders: {direction: [1, 1, 2, 1], zero_count: [1, 2, 3, 4]}
calibration_record:
  ros__parameters: {date: "2026-01-02"}
"""
SECTION = '  ros__parameters: {source: sim}\n'

REFUSALS = (
    # What simulates, replays or leaves out something that nobody asked for.
    *(
        argument(name, '', 'source', 'not given', 'a simulation must not pass for a rig')
        for name in ('master', 'encoder_driver')
    ),
    argument('master', 'source:=can', 'an argument', 'without `-p`', 'ROS ignores it'),
    argument('fkm', 'rig -p rate:=500.0', 'an argument', 'a stray word', 'ROS ignores it'),
    argument('can_scan', 'channel can1', 'an argument', 'a stray word', 'it would have no effect'),
    *(
        argument(name, f'-p {given}', '-p', 'a name without a value', 'expected NAME:=VALUE')
        for name, given in (('encoder_driver', 'source'), ('can_scan', 'can.channel'))
    ),
    argument(
        'encoder_driver',
        '-p source:=sim -p sim.nois_deg:=0.1',
        '-p',
        'a name that no node of the package has',
        'ROS ignores it',
    ),
    argument(
        'can_scan',
        '-p can.chanel:=can1',
        '-p',
        'a name that no node of the package has',
        'ROS ignores it',
    ),
    parameter(
        'fkm',
        {'qos_overrides./orientation.publisher.depth': 1},
        'qos_overrides./orientation.publisher.depth',
        'any value',
        'no topic of the package takes it',
    ),
    of_file(
        'master',
        '/**/encoders_driver:\n' + SECTION,
        'sections for other nodes only',
        'ROS ignores them',
    ),
    of_file(
        'master',
        '/**:\n' + SECTION + '/**/fmk:\n  ros__parameters: {rate: 500.0}\n',
        "a section whose name is almost a node's",
        'its values would have no effect',
    ),
    of_file(
        'encoder_driver',
        '/**/encoder_driver:\n  ros__parameters: {source: sim, alert_limit_deg: 0.5}\n',
        "another node's parameter in the section of one",
        'it would have no effect',
    ),
    argument(
        'supervise',
        '-p fkm:rate:=1000.0 -p encoder_driver:rate:=250.0 a.csv',
        'rate',
        'different values for the two nodes of a tool',
        'they belong to one rig',
    ),
    of_file(
        'master',
        'encoder_driver:\n' + SECTION,
        'a section without the namespace',
        'ROS ignores it',
        arguments=('-r', '__ns:=/left'),
    ),
    of_file(
        'fkm',
        '/**/encoder_driver:\n' + SECTION,
        "another process's sections only",
        'nothing of it reaches this process',
    ),
    of_file(
        'calibrate',
        '/left/encoder_driver:\n' + SECTION,
        'sections for other nodes only',
        'the defaults of can0 would be taken',
        arguments=('-o', 'a.yaml'),
    ),
    Refusal(
        'encoder_driver',
        ('--params-file', 'rig.yaml', '--params-file', 'calibration.yaml'),
        '--params-file',
        'two files with another bus or layout',
        'a calibration holds for the bus and the encoders that it was measured with',
        {
            'rig.yaml': '/**/encoder_driver:\n  ros__parameters: {can.channel: can1}\n',
            'calibration.yaml': '/**:\n  ros__parameters: {can: {channel: can0}}\n',
        },
    ),
    of_file(
        'encoder_driver',
        '/**:\n  ros__parameters:\n    source:can\n    rate: 100.0\n',
        'a colon without a space, a tab, or other text that is not valid YAML',
        'nothing can be read from it',
    ),
    of_file(
        'encoder_driver',
        '/**:\n  ros__parameters: {rate: 1_000.0}\n',
        'a value such as '
        '`1_000.0`, `8:20`, `0b11`, `010`, `y` or `~`, a block of text, a NUL, more than 64 '
        'bits, an anchor, alias or tag of YAML',
        'YAML and ROS read it differently',
    ),
    of_file(
        'fkm',
        '/**:\n  ros__parameters:\n    geometry.beta_deg: 34.0\n    geometry: {beta_deg: 34.1}\n',
        'a name, key or section given twice, also in two spellings',
        'one of the values would be lost',
    ),
    of_file(
        'fkm',
        '/**:\n  ros__parameters: {sigma_deg: [1, 0.5, 1, 1]}\n',
        'a list of lists or '
        'of several types, a name without a value, a section or name with an empty part',
        'no parameter has such a value or name',
    ),
    argument('fkm', '-p rate:=[[[[', '-p', 'a value that is not valid YAML', 'it has no value'),
    argument(
        'fkm',
        '-p use_sim_time:=1',
        'use_sim_time',
        'other than true and false',
        'ROS would end with a traceback',
    ),
    argument(
        'fkm',
        '-r __ns:=left',
        '-r',
        '`__ns` without a slash, or another name that begins with a digit or has other characters',
        'ROS has no such name',
    ),
    argument('fkm', '--log-level loud', '--log-level', 'no level of ROS', 'ROS has no such level'),
    of_file('fkm', '- 1\n', 'no parameter file', 'nothing can be read from it'),
    Refusal(
        'fkm',
        ('--params-file', 'nowhere.yaml'),
        '--params-file',
        'a file that does not exist',
        'nothing can be read from it',
    ),
    *(
        parameter(
            'master',
            {**SIM, **given},
            what,
            'different values in two nodes of `master`',
            'they belong to one rig',
        )
        for what, given in (
            ('rate', {'encoder_driver:rate': 500.0}),
            ('sensors', {'encoder_driver:sensors': 6}),
            ('geometry.alpha_deg', {'fkm:geometry.alpha_deg': 40.0}),
            (
                'geometry.distal_deg',
                {
                    'geometry.distal_deg': [34.0, 34.1, 34.2],
                    'fkm:geometry.distal_deg': [34.1, 34.1, 34.1],
                },
            ),
        )
    ),
    parameter(
        'master',
        {**CAN, 'calibration': 'a', 'fkm:calibration': 'b'},
        'calibration',
        'different values in two nodes of `master`',
        'zero counts, sigma and bias are of one calibration',
    ),
    # A mechanism that nobody can build.
    parameter(
        'fkm',
        {'geometry.base_axes': [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0]},
        'geometry.base_axes',
        'no unit vectors, or two parallel ones',
        'they are no axes',
    ),
    parameter(
        'fkm',
        {'geometry.platform_axes': [0.0, 0.6, 0.8, 0.0, 0.6, 0.8, 0.0, 0.0, 1.0]},
        'geometry.platform_axes',
        'no unit vectors, or two parallel ones',
        'they are no axes',
    ),
    parameter(
        'encoder_driver',
        {**REPLAY, 'geometry.proximal_deg': [39.3, 3.0, 80.0]},
        'geometry.proximal_deg',
        "links and axes that do not meet at the workspace's centre",
        'no such mechanism can be assembled',
    ),
    # An encoder that nobody has calibrated.
    parameter(
        'encoder_driver',
        {'source': 'can'},
        'encoders.zero_count',
        'not given',
        "another rig's zero counts give wrong orientations",
    ),
    parameter(
        'encoder_driver',
        {**REPLAY, 'encoders.direction_verified': [True, True, True, False]},
        'encoders.direction_verified',
        'false for a joint',
        'a wrong sign of joint_3a is invisible on the centre line',
    ),
    # Settings of the bus.
    driver('can.interface', 'carrier_pigeon', 'unknown to python-can', 'it cannot be opened'),
    *(
        parameter(
            name,
            {'can.interface': 'nonsense'},
            'can.interface',
            'unknown to python-can',
            'it cannot be opened',
        )
        for name in ('can_scan', 'sim_bus')
    ),
    driver('can.channel', "''", 'empty', 'it names no bus'),
    driver('can.protocol', 'j1939', 'another protocol', 'canopen or raw'),
    driver(
        'can.timeout',
        0.002,
        'shorter than two periods',
        'every jitter would be a fault',
        rate=100.0,
    ),
    driver(
        'can.sync',
        'produce',
        '`produce` where `encoders.sync_id` is 0',
        'there is no SYNC to produce',
        encoders__sync_id=0,
    ),
    driver(
        'rate',
        1000.0,
        'more than `can.bitrate` can carry',
        'frames would be lost',
        can__bitrate=250000,
    ),
    # Identifiers.
    driver('encoders.id', [385, 386, 385, 388], 'the same twice', 'two joints would be one'),
    driver(
        'encoders.id',
        [385, 386, 0x800, 388],
        'more than 11 bits, not `encoders.extended`',
        'no such frame exists',
    ),
    driver(
        'encoders.id',
        [385, 386, 0x581, 388],
        '0x580 .. 0x67F, unless `can.protocol` is raw',
        'CANopen uses them for SDO',
    ),
    driver(
        'encoders.id',
        [385, 386, 0x77F, 388],
        '0x700 .. 0x77F, unless `can.protocol` is raw',
        'CANopen uses them for heartbeats',
    ),
    driver(
        'encoders.id',
        [385, 386, 0x85, 388],
        '0x080 .. 0x0FF, 0x100, 0x7E4, 0x7E5, unless `can.protocol` is raw',
        'CANopen uses them for SYNC, EMCY, TIME and LSS',
    ),
    driver('encoders.sync_id', 0x181, "an encoder's identifier", 'a SYNC would be counts'),
    *(
        driver(
            'encoders.sync_id',
            identifier,
            "a heartbeat's or EMCY's identifier",
            'it would open a cycle',
        )
        for identifier in (0x702, 0x83)
    ),
    driver('encoders.node_id', [1, 2, 2, 4], 'the same twice', 'two nodes would be one'),
    # Layout of the frames.
    driver('encoders.byte_offset', [0, 0, 0, 1], 'beyond the frame', 'there are no such bytes'),
    driver('encoders.mask', [0, 0, 11, 0], 'bits with a gap', 'they are not one number'),
    driver(
        'encoders.counts_per_turn',
        [16384, 16384, 16384, 65536],
        'more than mask or bit length can hold',
        'most of the turn would be missing',
        encoders__mask=[0, 0, 0, 0x3FFF],
    ),
    driver(
        'encoders.counts_per_turn',
        [16384, 4096, 16384, 16384],
        'half or less of what mask or odd bit length select',
        'most counts would be beyond a turn',
        encoders__mask=[0, 0x3FFF, 0, 0],
    ),
    driver(
        'encoders.zero_count',
        [0, 0, 16384, 0],
        '`encoders.counts_per_turn` or more',
        'there is no such count',
    ),
    driver('encoders.direction', [1, 1, 0, 1], 'other than 1 and -1', 'it is a sign'),
    driver(
        'encoders.harmonic_cos_deg',
        [0.1, 0.1, 0.1],
        'not as many values as `sensors`',
        'each encoder has its own',
    ),
    driver(
        'encoders.counts_per_turn',
        [16384] * 4,
        'not as many values as `sensors`',
        'each encoder has its own',
        sensors=6,
    ),
    driver(
        'encoders.table_deg.joint_3a',
        [0.1, 0.2],
        'a table of fewer than 5 values',
        'they show no second harmonic',
    ),
    driver(
        'encoders.table_deg.joint_3a',
        [5.0, -5.0] * 16,
        'a table that is not monotonic',
        'a reading would be of two angles',
    ),
    driver(
        'encoders.counter_mask',
        [0, 15, 0, 0],
        'bits of the counts',
        'a counter would be part of the angle',
        encoders__counter_byte=[0, 3, 0, 0],
    ),
    driver(
        'encoders.status_mask', [0, 1, 0, 0], 'bits of the counts', 'an angle would be an error'
    ),
    driver(
        'encoders.status_mask',
        [0, 8, 0, 0],
        'bits of the counter',
        'every other frame would be an error',
        encoders__data_length=[4, 5, 4, 4],
        encoders__counter_byte=[0, 4, 0, 0],
        encoders__counter_mask=[0, 15, 0, 0],
        encoders__status_byte=[0, 4, 0, 0],
    ),
    driver(
        'encoders.status_good',
        [0, 1, 0, 0],
        'bits that `encoders.status_mask` has not',
        'no frame would be good',
    ),
    driver(
        'encoders.window',
        0.005,
        'more than 3 periods',
        'after a lost frame sets wait for the end of their cycle for as long',
    ),
    driver('encoders.window', 1e-6, 'less than 10 us, but not 0', 'no answer would be in time'),
    # Recording and simulation.
    parameter(
        'encoder_driver',
        {'source': 'replay', **simulated_rig()},
        'replay.path',
        'not given',
        'there is nothing to play',
    ),
    parameter(
        'encoder_driver',
        {**REPLAY, 'replay.path': '/no/such/file.log'},
        'replay.path',
        'a file that does not exist',
        'there is nothing to play',
    ),
    parameter(
        'encoder_driver',
        {**REPLAY, 'replay.path': __file__},
        'replay.path',
        'a format that python-can does not read',
        'there is nothing to play',
    ),
    parameter(
        'encoder_driver',
        {**SIM, 'sim.trajectory': 'fixed', 'sim.pose_deg': [0.0, 170.0, 0.0]},
        'sim.pose_deg',
        'out of reach',
        'the mechanism has no such pose',
    ),
    Refusal(
        'encoder_driver',
        ('-p', 'source:=sim', '-p', 'sim.rig_file:=nowhere.json'),
        'sim.rig_file',
        'a file that does not exist',
        'there is nothing to simulate',
    ),
    Refusal(
        'sim_bus',
        ('-p', 'sim.rig_file:=rig.json'),
        'sim.rig_file',
        'a file with a key that no rig has',
        'what it means would not be simulated',
        {'rig.json': '{"alpha": [39.3, 39.3, 39.3]}'},
    ),
    Refusal(
        'encoder_driver',
        ('-p', 'source:=sim', '-p', 'sim.rig_file:=rig.json'),
        'sim.rig_file',
        'a file with a value that no rig has',
        'no such rig exists',
        {'rig.json': '{"play_deg": [-0.1, 0, 0, 0]}'},
    ),
    parameter(
        'encoder_driver',
        {**SIM, 'sim.trajectory': 'sweep', 'sim.tilt_max_deg': 26.0, 'geometry.alpha_deg': 31.0},
        'sim.trajectory',
        "a motion beyond the mechanism's reach",
        'the mechanism has no such pose',
    ),
    Refusal(
        'sim_bus',
        ('-p', 'sim.rig_file:=rig.json', '-p', 'sim.rig_seed:=3'),
        'sim.rig_seed',
        'beside a `sim.rig_file`',
        'it is unclear which one counts',
        {'rig.json': '{}'},
    ),
    # Other nodes.
    parameter('fkm', {'frame_id': "''"}, 'frame_id', 'empty', 'no frame has that name'),
    parameter(
        'fkm',
        {'mounting.base_zxz_deg': [10.0, 0.0, 0.0], 'mounting.table_frame_id': 'spm_base'},
        'mounting.table_frame_id',
        "another frame's name, with a mounting",
        'a frame cannot be mounted on itself',
    ),
    parameter(
        'diagnostics',
        {'dexterity_error': 0.2},
        'dexterity_error',
        'above `dexterity_warn`',
        'ERROR comes after WARN',
    ),
    parameter(
        'teleop',
        {'teleop.speed_limit': 0.1},
        'teleop.align_speed',
        'above `teleop.speed_limit`',
        'it would never be reached',
    ),
    parameter(
        'teleop',
        {'teleop.insertion_scale': 0.01},
        'teleop.insertion_scale',
        'above 0 and below 0.05',
        'the tip would hardly move',
    ),
    parameter(
        'teleop',
        {'teleop.depth_range': [0.2, 0.1]},
        'teleop.depth_range',
        'the larger depth first',
        'no depth would be allowed',
    ),
    parameter(
        'teleop',
        {'teleop.trocar': [0.1, 0.2]},
        'teleop.trocar',
        'another number of values than 1 or 3',
        'it is no place',
    ),
    parameter(
        'teleop',
        {'teleop.shaft_axis': [0.0, 0.0, 0.5]},
        'teleop.shaft_axis',
        'another length than 1',
        'a slip of the pen would be another direction',
    ),
    argument(
        'master',
        '-r __node:=x',
        '`-r __node:=NAME` of several nodes',
        'a name for all of them',
        'they would be one to every client',
    ),
    parameter(
        'fkm',
        {'realtime.cpus': '0-999999999'},
        'realtime.cpus',
        'cores that there are not',
        'the process would run elsewhere',
    ),
    parameter(
        'fkm',
        {'realtime.slice': 0.00005},
        'realtime.slice',
        'below 0.0001, but not 0',
        'Linux has no such slice',
    ),
    # Options of the tools.
    option('calibrate', '--pose', '0 0 0', 'out of reach of the manipulator'),
    *(
        option(program, name, value, 'not above 0')
        for program, name, value in (
            ('calibrate', '--seconds', '0'),
            ('calibrate', '--noise-limit', '-1'),
            ('calibrate', '--tolerance', '0'),
            ('can_scan', '--seconds', '-3'),
            ('sim_bus', '--heartbeat', '0'),
        )
    ),
    *(
        option(program, name, value, 'not finite')
        for program, name, value in (
            ('calibrate', '--pose', 'nan 0 0'),
            ('calibrate', '--seconds', 'inf'),
            ('calibrate', '--drift-limit', 'nan'),
            ('calibrate', '--jig-error', '1e999'),
            ('sim_bus', '--seconds', 'nan'),
            ('can_setup', '--heartbeat', 'nan'),
            ('sim_bus', '--fault', 'noise:joint_1a@1=1e400'),
            ('sim_bus', '--fault', 'offset:joint_1a@1=nan'),
        )
    ),
    option('calibrate', '-o', '/dev/full', 'not a regular file'),
    option('calibrate', '-o', '/no/such/a.yaml', 'its directory does not exist'),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml'),
        '-o',
        'a file that exists, without `--force`',
        'it is not overwritten',
        {'a.yaml': 'a: 1\n'},
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml', '--force'),
        '-o',
        'a file that `calibrate` did not write',
        'it is not overwritten',
        {'a.yaml': 'a: 1\n'},
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml', '--force'),
        '-o',
        'a calibration with a direction other than 1 and -1',
        'it was edited',
        {'a.yaml': CALIBRATION},
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml', '-p', 'source:=sim'),
        'source',
        '`sim` for `calibrate`',
        'a simulation has nothing to calibrate',
    ),
    Refusal(
        'calibrate',
        ('-o', 'a.yaml', '-p', 'source:=replay', *('--pose', '0', '0', '0') * 2),
        '--pose',
        'twice for a recording',
        'a recording has one pose',
    ),
    argument(
        'can_scan', '--start --passive', '--passive', 'with `--start`', '`--start` sends frames'
    ),
    option('sim_bus', '--fault', 'melt:joint_1a@1', 'no such fault'),
    option('sim_bus', '--fault', 'stuck:joint_3b@1', 'there are four `sensors`'),
    option('sim_bus', '--fault', 'noise:joint_1a@1=-1', 'noise is not negative'),
    option('sim_bus', '--fault', 'dropout:joint_1a@1+0', 'it would never begin'),
    Refusal(
        'validate',
        ('r.csv', 'c.csv', '--marker-azimuths', '0', 'inf'),
        '--marker-azimuths',
        '0 inf',
        'not finite',
    ),
    *(
        Refusal(
            program,
            files,
            'RECORDING',
            'a file that does not exist',
            f'there is nothing to {verb}',
        )
        for program, verb, files in (
            ('validate', 'compare', ('r.csv', 'c.csv')),
            ('supervise', 'supervise', ('r.csv',)),
        )
    ),
    parameter(
        'fkm',
        {'force.enabled': True},
        'force.without_drives',
        'false without drives',
        'no motor would get a torque',
    ),
    parameter(
        'fkm',
        {**FORCE, 'crtk_rate': 200.0},
        'crtk_rate',
        'above 0 with `force.without_drives`',
        'the other motor controller would miss torques',
    ),
    parameter(
        'fkm',
        {**FORCE, 'rate': 100.0},
        'rate',
        'below 250 Hz with `force.enabled`',
        'each sample would begin with zero torque',
    ),
    parameter(
        'fkm',
        {**FORCE, 'force.sigma_full': 0.05},
        'force.sigma_full',
        'not above `force.sigma_off`',
        'the torque would jump',
    ),
    Refusal(
        'master',
        ('-r', '__ns:=/two', *parameter_arguments(DRIVEN)),
        'drives.check_file',
        'empty with the drives of force feedback',
        'a motor that is wired wrong lets the device run away',
    ),
    # Its nodes exist when it is refused: in a namespace, beside the other cases.
    Refusal(
        'master',
        ('-r', '__ns:=/one', *parameter_arguments(ONE_BUS)),
        'drives.bitrate',
        'that of one bus with the encoders, without `drives.combined`',
        'frames would come late',
    ),
    parameter(
        'sim_bus',
        {
            'drives.channel': '239.74.0.0',
            'drives.interface': 'udp_multicast',
            'drives.event_timer': 0.002,
        },
        'drives.event_timer',
        'less than three samples',
        'the drives would fall out by themselves',
    ),
    argument(
        'sim_bus',
        '--fault drive:joint_1a@1=0x2310',
        '--fault',
        'a fault of a drive without drives',
        'it would never begin',
    ),
    argument(
        'can_setup', '--drives', 'drives.channel', 'empty with `--drives`', 'there are no drives'
    ),
)
