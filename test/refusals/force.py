# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback without what keeps it safe."""

from pathlib import Path

from benchmarks.pipeline.child_process import parameter_arguments

from refusals.refusal import argument, CAN, parameter, Refusal, SIM

FORCE = {
    'force.enabled': True,
    'force.without_drives': True,
    'crtk_rate': 0.0,
}
CHECK = Path(__file__).resolve().parents[2] / 'config' / 'simulated_check.json'
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

FORCE_FEEDBACK = (
    parameter(
        'fkm',
        {'force.enabled': True},
        'force.without_drives',
        'false without drives',
        'no motor would get a torque',
        message=(
            "parameter 'force.without_drives' is False; expected with force.enabled the bus of "
            'the drives in drives.channel, or true for another motor controller, not both'
        ),
    ),
    parameter(
        'fkm',
        {**FORCE, 'crtk_rate': 200.0},
        'crtk_rate',
        'above 0 with `force.without_drives`',
        'the other motor controller would miss torques',
        message=(
            "parameter 'crtk_rate' is 200.0; expected 0 with force.without_drives: the other "
            'motor controller needs the torque of each sample'
        ),
    ),
    parameter(
        'fkm',
        {**FORCE, 'rate': 100.0},
        'rate',
        'below 250 Hz with `force.enabled`',
        'each sample would begin with zero torque',
        message=(
            "parameter 'rate' is 100.0; expected at least 250 Hz with force.enabled: torque "
            'begins from zero after 0.01 s without a sample'
        ),
    ),
    parameter(
        'fkm',
        {**FORCE, 'force.sigma_full': 0.05},
        'force.sigma_full',
        'not above `force.sigma_off`',
        'the torque would jump',
        message="parameter 'force.sigma_full' is 0.05; expected above force.sigma_off (0.05)",
    ),
    Refusal(
        'master',
        ('-r', '__ns:=/two', *parameter_arguments(DRIVEN)),
        'drives.check_file',
        'empty with the drives of force feedback',
        'a motor that is wired wrong lets the device run away',
        message=(
            "parameter 'drives.check_file' is ''; expected the file that force_check --record "
            '--output has written for these drives: no torque without a passed check'
        ),
    ),
    # Its nodes exist when it is refused: in a namespace, beside the other cases.
    Refusal(
        'master',
        ('-r', '__ns:=/one', *parameter_arguments(ONE_BUS)),
        'drives.bitrate',
        'that of one bus with the encoders, without `drives.combined`',
        'frames would come late',
        message=(
            "parameter 'drives.bitrate' is 1000000; expected a second bus (drives.channel) or "
            'one frame with all torques (drives.combined) or a lower rate: SYNC and encoders '
            '435 bits x 1000 Hz + torque 285 bits x 1000 Hz + status 315 bits x 250 Hz + '
            'heartbeats 260 bits x 50 Hz = 81 % bus load, beyond 70 %'
        ),
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
        message=(
            "parameter 'drives.event_timer' is 0.002; expected at least 0.003 s: 3 samples at "
            'rate 1000 Hz'
        ),
    ),
    argument(
        'sim_bus',
        '--fault drive:joint_1a@1=0x2310',
        '--fault',
        'a fault of a drive without drives',
        'it would never begin',
        message=(
            "fault 'drive:joint_1a@1=0x2310' without drives; expected --drives or drives.channel"
        ),
    ),
    argument(
        'can_setup',
        '--drives',
        'drives.channel',
        'empty with `--drives`',
        'there are no drives',
        message="parameter 'drives.channel' is ''; expected the channel of the drives' bus",
    ),
)
