# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings that cannot be read, and rigs that cannot be simulated."""

from refusals.refusal import parameter, Refusal, REPLAY, REPLAY_OF_NOTHING, SIM

SOURCES = (
    parameter(
        'encoder_driver',
        REPLAY_OF_NOTHING,
        'replay.path',
        'not given',
        'there is nothing to play',
        message="parameter 'replay.path' is ''; expected an existing file",
    ),
    parameter(
        'encoder_driver',
        {**REPLAY, 'replay.path': '/no/such/file.log'},
        'replay.path',
        'a file that does not exist',
        'there is nothing to play',
        message="parameter 'replay.path' is '/no/such/file.log'; expected an existing file",
    ),
    parameter(
        'encoder_driver',
        {**REPLAY, 'replay.path': __file__},
        'replay.path',
        'a format that python-can does not read',
        'there is nothing to play',
        message=(
            "parameter 'replay.path' is '...sources.py'; expected a log in a format that "
            'keeps all frames (.log, .asc, .blf, .csv, .trc, each also with .gz)'
        ),
    ),
    parameter(
        'encoder_driver',
        {
            **SIM,
            'sim.trajectory': 'fixed',
            'sim.pose_deg': [0.0, 170.0, 0.0],
        },
        'sim.pose_deg',
        'out of reach',
        'the mechanism has no such pose',
        message="parameter 'sim.pose_deg' is [0.0, 170.0, 0.0]; expected a pose within reach",
    ),
    Refusal(
        'encoder_driver',
        ('-p', 'source:=sim', '-p', 'sim.rig_file:=nowhere.json'),
        'sim.rig_file',
        'a file that does not exist',
        'there is nothing to simulate',
        message=(
            "nowhere.json: cannot be read: [Errno 2] No such file or directory: 'nowhere.json'"
        ),
    ),
    Refusal(
        'sim_bus',
        ('-p', 'sim.rig_file:=rig.json'),
        'sim.rig_file',
        'a file with a key that no rig has',
        'what it means would not be simulated',
        files={'rig.json': '{"alpha": [39.3, 39.3, 39.3]}'},
        message=(
            "rig.json: key 'alpha' is [39.3, 39.3, 39.3]; expected one of the keys alpha_deg, "
            'beta_deg, base_axes, platform_axes, eccentricity_deg_cos_sin, '
            'second_harmonic_deg, play_deg, noise_deg, resolution_deg, delay, zero, direction'
        ),
    ),
    Refusal(
        'encoder_driver',
        ('-p', 'source:=sim', '-p', 'sim.rig_file:=rig.json'),
        'sim.rig_file',
        'a file with a value that no rig has',
        'no such rig exists',
        files={'rig.json': '{"play_deg": [-0.1, 0, 0, 0]}'},
        message=(
            "rig.json: key 'play_deg' is [-0.1, 0, 0, 0]; expected a list of 4, each a number "
            'from 0 to 10'
        ),
    ),
    parameter(
        'encoder_driver',
        {
            **SIM,
            'sim.trajectory': 'sweep',
            'sim.tilt_max_deg': 26.0,
            'geometry.alpha_deg': 31.0,
        },
        'sim.trajectory',
        "a motion beyond the mechanism's reach",
        'the mechanism has no such pose',
        message=(
            "parameter 'sim.trajectory' is 'sweep'; expected a motion within reach of the "
            'simulated mechanism'
        ),
    ),
    Refusal(
        'sim_bus',
        ('-p', 'sim.rig_file:=rig.json', '-p', 'sim.rig_seed:=3'),
        'sim.rig_seed',
        'beside a `sim.rig_file`',
        'it is unclear which one counts',
        files={'rig.json': '{}'},
        message="parameter 'sim.rig_seed' is 3; expected 0 with a sim.rig_file (rig.json)",
    ),
)
