# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""can_scan, can_setup and urdf in one process with simulated encoders on a virtual bus."""

import os
import re
import subprocess
import sys

import can
import pytest
from spm_haptic_master.tools import calibrate, can_scan, can_setup, urdf


@pytest.fixture
def run(
    capsys,
    channel,
    monkeypatch,
):
    """Run a program on the bus; return its exit code, stdout and stderr."""
    pytest.importorskip('canopen')
    monkeypatch.setattr('spm_haptic_master.encoders.bus_scan.SYNC_LISTEN', 0.4)

    def run(program, *args):
        name = program.__name__.rpartition('.')[2]
        code = program.main(
            [
                name,
                '-p',
                'can.interface:=virtual',
                '-p',
                f'can.channel:={channel}',
                '-p',
                'rate:=100.0',
                *args,
            ]
        )
        return code, *capsys.readouterr()

    return run


SCAN = ('--seconds', '0.3', '--start')


@pytest.fixture
def of_the_maker(encoders, monkeypatch):
    """Have encoders as their maker delivers them on the bus."""
    monkeypatch.setattr(can_setup, 'LISTEN', 0.0)
    with encoders(factory=True):
        yield


@pytest.mark.usefixtures('of_the_maker')
def test_encoders_of_the_maker_are_found_and_are_not_as_configured(run):
    code, out, err = run(can_scan, *SCAN)
    assert code == 1
    assert '\n  joint_1b: 0x182 missing; its node 2 is present' in out
    assert 'can_scan: no SYNC on the bus' in err
    code, out, err = run(can_setup)
    assert (code, err) == (1, '')
    assert '0x6001:00 units per turn: 65536, wanted 16384' in out
    assert out.endswith('4 of 4 encoders not as configured; nothing was written (--write)\n')


@pytest.mark.usefixtures('of_the_maker')
def test_one_encoder_of_the_maker_is_set_up_alone_with_another_heartbeat(run):
    code, out, _ = run(can_setup, '--joint', 'joint_1b', '--write', '--heartbeat', '0.2')
    assert code == 0
    assert 'joint_1a' not in out
    assert out.endswith('1 of 1 encoders as configured, stored and read back after a reset\n')
    code, out, _ = run(can_setup)
    assert code == 1
    assert '3 of 4' not in out
    assert '0x1017:00 heartbeat time, ms: 200' in out


@pytest.mark.usefixtures('of_the_maker')
def test_encoders_of_the_maker_are_set_up_and_found_as_configured(run, channel):
    code, _, _ = run(can_setup, '--write')
    assert code == 0
    code, out, err = run(can_setup)
    assert (code, err) == (0, '')
    assert out.endswith(': 4 of 4 encoders as configured\n')
    assert ' objects as configured\n' in out
    assert 'written' not in out
    code, out, _ = run(can_scan, *SCAN)
    assert code == 0, out
    assert f'virtual {channel}, 0.3 s:\n' in out
    assert 'all four encoders are there, as configured\n' in out
    assert 'lines for rig.yaml, in the order of the node ids: put the lists' in out
    assert channel in out.partition('rig.yaml')[2]


def test_the_lines_of_a_scan_are_a_rig_file_for_all_programs(run, encoders):
    """Other node ids, and a master; a file from process substitution can be read once only."""
    with encoders(
        sync=0.01,
        encoders__node_id=(44, 3, 90, 17),
        encoders__id=(0x1AC, 0x183, 0x1DA, 0x191),
    ):
        code, out, err = run(can_scan, '--seconds', '0.3', '--start')
        assert code == 1
        assert 'no SYNC' not in err
        reader, writer = os.pipe()
        with open(writer, 'w') as pipe:
            pipe.write(out.partition('lines for rig.yaml')[2].partition('\n')[2])
        assert (
            can_scan.main(
                ['can_scan', '--params-file', f'/dev/fd/{reader}', '--start', '--seconds', '0.3']
            )
            == 0
        )
    os.close(reader)


def test_encoders_that_do_not_answer_are_counted(
    run,
    encoders,
    monkeypatch,
):
    monkeypatch.setattr('spm_haptic_master.encoders.canopen_network.ANSWER_TIMEOUT', 0.1)
    with encoders():
        code, out, _ = run(can_setup, '-p', 'encoders.node_id:=[1, 2, 3, 9]')
    assert code == 1
    assert '\njoint_3a: ' in out
    assert '1 of 4 encoders not set up\n' in out


def test_a_running_master_is_heard_and_nothing_is_written(run, encoders):
    with encoders(factory=True, sync=0.01):
        code, _, err = run(can_setup, '--write')
    assert (code, err) == (
        1,
        'can_setup: SYNC 0x80 on the bus: a master is running; stop it '
        'before anything is written\n',
    )


def test_a_scan_that_sends_nothing_of_a_bus_without_frames(run, channel):
    with can.Bus(interface='virtual', channel=channel) as other:
        code, out, err = run(
            can_scan,
            '--passive',
            '--seconds',
            '0.1',
            '-p',
            'encoders.node_id:=[1, 2, 3, 4]',
        )
        assert other.recv(0.0) is None
    assert (code, err) == (1, '')
    assert '0.1 s:\n  nothing\nnot as configured:\n  no frames at all' in out
    assert 'lines for rig.yaml:\n' in out


@pytest.mark.parametrize(
    ('program', 'args', 'words'),
    [
        (
            can_scan,
            ('--start', '--passive'),
            'can_scan: --start with --passive, which sends nothing',
        ),
        (can_scan, ('-p', 'can.interface:=nope'), "can_scan: parameter 'can.interface' is 'nope'"),
        (can_scan, ('-p', 'can.interface:=socketcan'), 'can_scan: socketcan [0-9a-f]+: '),
        (can_scan, ('-p', 'ratte:=1'), "can_scan: .*'ratte'"),
        (
            can_setup,
            ('-p', 'can.protocol:=raw'),
            "'raw'; expected 'canopen': other encoders have no",
        ),
        (
            can_setup,
            ('--joint', 'joint_3c', '-p', 'sensors:=5'),
            'joint joint_3c; expected one of',
        ),
        (can_setup, ('--drives', '-p', 'drives.rated_torque:=[0.5]'), "'drives.channel' is ''"),
        (
            can_setup,
            (
                '--drives',
                '-p',
                'drives.rated_torque:=[0.5]',
                '-p',
                'drives.channel:=can0',
                '-p',
                'can.channel:=can0',
                '-p',
                'drives.interface:=virtual',
                '-p',
                'drives.event_timer:=0.1',
                '-p',
                'drives.node_id:=[11, 2, 13]',
            ),
            r'node ids that no encoder has \(2 is in',
        ),
        (urdf, (), 'urdf: -p can.interface:=virtual: ignored: this program has no such'),
    ],
)
def test_what_is_wrong_is_named_in_one_line(
    run,
    program,
    args,
    words,
):
    code, out, err = run(program, *args)
    assert (code, out) == (1, '') and re.search(words, err) and err.count('\n') == 1, err


def test_a_reader_of_the_output_that_ends_is_no_error_of_the_bus(
    encoders,
    channel,
    capfd,
):
    """Item 7: `can_setup | head`; it prints while its bus is open."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, '-m', 'spm_haptic_master', 'can_setup']
    found = subprocess.run(
        [*command, '-p', 'can.interface:=virtual', '-p', f'can.channel:={channel}'],
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(writer)
    assert (found.returncode, found.stderr) == (1, '')


@pytest.mark.slow
def test_E13_calibrate_names_a_smaller_resolution(
    motion,
    tmp_path,
    capsys,
):
    """The log has 14 bits; configured are 16."""
    given = ('-p', 'encoders.counts_per_turn:=[65536, 65536, 65536, 65536]')
    path = str(tmp_path / 'c.yaml')
    assert calibrate.main(['calibrate', '--motion', *motion, *given, '-o', path]) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert (
        'no count of the motion reaches 16384, and with 16384 counts per turn it is that of the '
        'mechanism: encoders.counts_per_turn is 65536 (can_scan prints what the encoders have)'
        in error
    )


@pytest.mark.slow
@pytest.mark.usefixtures('few_guesses')
def test_E13_no_resolution_is_suggested_that_the_encoders_do_not_have(
    motion,
    tmp_path,
    capsys,
):
    """Two joints are exchanged, and all counts are in the lower half of a turn by chance."""
    *others, path, rate_flag, rate = motion
    exchanged = {
        '181': '182',
        '182': '181',
        '183': '183',
        '184': '184',
    }
    first = {}
    log = tmp_path / 'exchanged.log'
    with open(path.partition('=')[2]) as source, log.open('w') as file:
        for line in source:
            head, _, data = line.partition('#')
            identifier = head[-3:]
            if identifier in exchanged:
                count = int.from_bytes(bytes.fromhex(data[:8]), 'little')
                moved = count - first.setdefault(identifier, count)
                low = (moved + 5500) % 16384
                assert low < 8192
                data = low.to_bytes(4, 'little').hex() + data[8:]
                head = head[:-3] + exchanged[identifier]
            file.write(f'{head}#{data}')
    given = (*others, f'replay.path:={log}', rate_flag, rate)
    output = str(tmp_path / 'c.yaml')
    assert calibrate.main(['calibrate', '--motion', *given, '-o', output]) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert 'joint_1a and joint_1b are swapped' in error
    assert '8192' not in error
