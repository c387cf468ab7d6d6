# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated drives: conversations as CiA 301 and 402 have them, their heat, and their faults."""

from benchmarks.pipeline.child_process import wait_until
import can
import numpy as np
import pytest
from spm_haptic_master.drives.plan import make_plan
from spm_haptic_master.parameters.nodes import DRIVE_SETTINGS
from spm_haptic_master.parameters.setting import complete, RATE_SETTING
from spm_haptic_master.simulation.bus_runner import DriveLoop
from spm_haptic_master.simulation.fault_injection import parse_fault
from spm_haptic_master.simulation.simulated_drive import SimulatedDrives

# Longest wait for a frame (s).
PATIENCE = 20.0
# Time, s, and frame of the master, and the answers of the drive of node 11; without a frame what
# it sends by itself.
CONVERSATIONS = {
    'set up': """
0      60B#4000100000000000 -> 58B#4300100092010200
0      60B#4041600000000000 -> 58B#4B41600050020000
0      60B#4000180100000000 -> 58B#430018018B010000
0      60B#4002650000000000 -> 58B#4302650008020000
0      20B#0600C800 ->
0      -> 70B#7F
0.0015 ->
0.0015 60B#2F60600008000000 -> 58B#8060600030000906
0.0015 60B#2F60600003000000 -> 58B#8060600030000906
0.0015 60B#2B72600090010000 -> 58B#6072600000000000
0.0015 60B#2B416000FFFF0000 -> 58B#8041600002000106
0.0015 000#010C ->
0.0015 000#010B00 ->
0.0015 ->
0.0015 000#010B ->
0.002  -> 18B#5002000000
0.002  20B#0F00F401 ->
0.003  20B#0700F401 ->
0.007  -> 18B#5002000000
0.007  20B#0600F401 ->
0.008  20B#0F00F401 ->
0.012  -> 18B#3302000000
0.012  20B#0F00F401 ->
0.017  -> 18B#3302000000
0.017  60B#2F6060000A000000 -> 58B#6060600000000000
0.017  20B#0F000CFE ->
0.0225 -> 70B#05 18B#370270FE0A
0.0225 77E#05 ->
0.0255 20B#0700F401 ->
0.0275 -> 18B#330200000A
0.0285 20B#0F00F401 ->
0.0335 -> 18B#370290010A
0.0395 -> 08B#5082010000000000 18B#500200000A
0.0405 ->
0.0405 20B#0600C800 ->
0.0405 20B#0700C800 ->
0.0405 20B#0F00C800 ->
0.0445 -> 70B#05 18B#3702C8000A
0.0505 20B#0F00C800 ->
0.0605 20B#0F00C800 ->
0.0705 20B#0F00C800 ->
0.0795 20B#0F00C800 ->
0.0815 -> 70B#05 18B#3702C8000A
0.0835 -> 08B#3081010000000000
0.0835 20B#00000000 ->
0.0865 -> 18B#500200000A
0.0955 -> 08B#5082010000000000 18B#500200000A
0.0955 60B#2B07600001000000 -> 58B#6007600000000000
0.0955 60B#2F29100100000000 -> 58B#6029100100000000
0.0955 20B#0600C800 ->
0.0955 20B#0700C800 ->
0.0955 20B#0F00C800 ->
0.1025 -> 70B#05 18B#3702C8000A
0.1065 -> 08B#5082010000000000 18B#180200000A
0.1065 77E#05 ->
0.1065 20B#0600C800 ->
0.1085 20B#8000C800 -> 08B#0000000000000000
0.1115 -> 18B#500200000A
0.1225 -> 08B#5082010000000000 70B#05 18B#180200000A
0.1225 20B#8000C800 ->
0.1225 20B#00000000 ->
0.1225 20B#8000C800 -> 08B#0000000000000000
0.1675 -> 08B#5082010000000000 08B#3081010000000000 70B#7F
0.1675 000#020B ->
0.1675 000#800B ->
0.1905 -> 70B#7F
0.1905 60B#4072600000000000 -> 58B#4B72600090010000
0.1905 000#810B -> 70B#00
0.1905 60B#4072600000000000 -> 58B#4B726000E8030000
0.2815 -> 70B#7F""",
    'of its maker': """
0      60B#4007600000000000 -> 58B#4B07600001000000
0      60B#4000160000000000 -> 58B#4F00160000000000
0      60B#4017100000000000 -> 58B#4B17100000000000
0      60B#4000140100000000 -> 58B#430014010B020080
0      60B#4076600000000000 -> 58B#43766000F4010000
0      60B#230014010B020000 -> 58B#6000140100000000
0      60B#2300160110004060 -> 58B#6000160100000000
0      60B#2300160210007160 -> 58B#6000160200000000
0      60B#2F00160002000000 -> 58B#6000160000000000
0      000#0100 ->
0      20B#0600C800 ->
0.005  ->
0.5    ->""",
    'with a frame of all torques': """
0      60B#2F6060000A000000 -> 58B#6060600000000000
0      000#010B ->
0      20B#0600 ->
0      20B#0700 ->
0      20B#0F00 ->
0.005  -> 70B#05 18B#370200000A
0.005  30B#C800 ->
0.01   -> 18B#3702C8000A
0.0155 -> 08B#5082010000000000 18B#500200000A""",
}


def plan(**settings):
    """Return the plan of one drive, node 11."""
    return make_plan(
        complete(
            (*DRIVE_SETTINGS, RATE_SETTING),
            {
                'drives.channel': 'x',
                'drives.rated_torque': [0.5],
                'drives.node_id': [11],
                **settings,
            },
        )
    )


def frame(row):
    identifier, _, data = row.partition('#')
    return can.Message(
        arbitration_id=int(identifier, 16), data=bytes.fromhex(data), is_extended_id=False
    )


def text(messages):
    return ' '.join(f'{each.arbitration_id:03X}#{each.data.hex().upper()}' for each in messages)


@pytest.mark.parametrize('name', CONVERSATIONS)
def test_a_conversation_as_cia_402_has_it(name):
    drives = SimulatedDrives(
        plan(**{'drives.combined': name == 'with a frame of all torques'}),
        factory=name == 'of its maker',
    )
    assert text(drives.boot()) == '70B#00'
    for row in CONVERSATIONS[name].strip().splitlines():
        time, asked, *answers = (
            row.replace('->', '').split()
            if '#' in row.partition('->')[0]
            else (row.split()[0], '', *row.split()[2:])
        )
        found = drives.receive(frame(asked), float(time)) if asked else drives.tend(float(time))
        assert text(found) == ' '.join(answers), row


def test_drives_answer_on_a_bus_until_it_ends():
    with can.Bus(interface='virtual', channel='loop') as master:
        with can.Bus(interface='virtual', channel='loop') as bus:
            loop = DriveLoop(bus, SimulatedDrives(plan()))
            heard = (text([master.recv(PATIENCE)]) for _ in range(1000))
            assert next(heard) == '70B#00'
            for asked, answer in (
                ('60B#4041600000000000', '58B#4B41600050020000'),
                ('000#010B', '70B#05'),
            ):
                master.send(frame(asked))
                assert answer in heard
            assert loop.error is None
        assert wait_until(lambda: loop.error, PATIENCE)
        loop.close()


def operated(drives, since, until, torque='C800'):
    """Have a started drive operate at a torque; return what it sends by itself, in words."""
    sent = []
    for now in np.arange(since, until, 0.005):
        for row in ('77E#05', '20B#0600', '20B#0700', '20B#0F00'):
            drives.receive(frame(row + torque * row.startswith('20B')), now)
        sent += drives.tend(now)
    return text(sent)


def started(*faults, **settings):
    """Return a drive that was started at 10 s, in the cyclic mode, with twice its rated torque."""
    drives = SimulatedDrives(plan(**settings), tuple(map(parse_fault, faults)))
    for row in ('60B#2F6060000A000000', '60B#2B726000D0070000', '000#010B'):
        drives.receive(frame(row), 10.0)
    return drives


def test_a_motor_at_twice_its_rated_torque_is_too_hot_after_a_second():
    drives = started()
    assert '08B#' not in operated(drives, 10.0, 10.98, 'D007')
    assert operated(drives, 10.98, 11.02, '30F8').count('08B#5023010000000000') == 1
    drives.receive(frame('20B#8000C800'), 11.02)
    assert '08B#' not in operated(drives, 11.03, 13.0, 'E803')


def test_faults_are_timed_from_the_first_start_and_end():
    """Also two of one kind, one after the other; one of a drive that is not there is no news."""
    faults = (
        'drive:joint_1a@1+1=0x2310',
        'drive:joint_1a@3+1=0x2320',
        'drive_torque:joint_1a@5+1=30',
        'drive_unplug:joint_1a@7+1',
        'drive:joint_1b@0=1',
    )
    drives, failed, enabled = started(*faults), '18B#180200000A', '18B#3702C8000A'
    for k, (present, words) in enumerate(
        zip(
            (None, 0, None, 1, None, 2, None, 3, None),
            (
                (enabled,),
                ('08B#1023010000000000', failed),
                (failed, enabled),
                ('08B#2023010000000000', failed),
                (failed, enabled),
                ('18B#370204010A',),
                (enabled,),
                (),
                (enabled,),
            ),
            strict=True,
        )
    ):
        found = operated(drives, 10.0 + k, 10.003 + k)
        drives.receive(frame('20B#8000C800'), 10.003 + k)
        found += ' ' + operated(drives, 10.005 + k, 10.97 + k)
        assert set(found.split()) - {'70B#05', '18B#500200000A'} == set(words), k
        assert drives.faults.take_news() == (
            *([f'{faults[k // 2 - 1]} ends'] if present is None and k else []),
            *([f'{faults[present]} begins'] if present is not None else []),
        )
