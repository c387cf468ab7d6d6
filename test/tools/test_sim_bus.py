# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program `sim_bus`: the truth that it writes, the rig's harmonics, a second one beside it."""

import re
import resource
import time

import can
from encoder_frames import values
from harness import DATA
import numpy as np
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.rig import make_rig, read_rig
from spm_haptic_master.tools import sim_bus
from spm_haptic_master.validation import recordings

RIG = DATA / 'rig' / 'rig.json'
VIRTUAL = ('sim_bus', '-p', 'can.interface:=virtual')


def test_the_truth_is_written_beside_the_rig(
    tmp_path,
    capsys,
    monkeypatch,
):
    monkeypatch.setattr('spm_haptic_master.simulation.bus_runner.LISTEN', 0.0)
    begin = time.time()
    assert (
        sim_bus.main(
            [
                *VIRTUAL,
                '-p',
                f'sim.rig_file:={RIG}',
                '-p',
                'rate:=200.0',
                '-p',
                'can.protocol:=raw',
                '--sync',
                '--seconds',
                '0.2',
                '--ground-truth',
                str(tmp_path),
                '--drives',
                '2',
                '-p',
                'drives.event_timer:=0.1',
            ]
        )
        == 0
    )
    out, err = capsys.readouterr()
    assert 'sim_bus: 2 drives on virtual can0, nodes [11, 12]\n' in out
    assert not err
    assert re.search(r'sim_bus: \d+ cycles answered, \d+ deadlines missed\n$', out)
    written, rig = (read_rig(path, Geometry(), 0.0) for path in (tmp_path / 'rig.json', RIG))
    assert np.allclose(written.geometry.alphas, rig.geometry.alphas)
    truth = recordings.read_orientation(tmp_path / 'ground_truth.csv', '')
    assert 10 < len(truth.time) < 60
    assert begin < truth.time[0] < truth.time[-1] < time.time()
    motion = make_motion(values('sim', sim__rig_file=str(RIG)))
    np.testing.assert_allclose(
        truth.values,
        [motion.orientation(t) for t in truth.time - truth.time[0]],
        atol=1e-4,
    )


@pytest.mark.parametrize(
    ('directory', 'words'),
    [
        ('', 'rig.json: already exists'),
        ('file', 'cannot be written'),
    ],
)
def test_a_truth_that_cannot_be_written_ends_in_one_line(
    capsys,
    directory,
    words,
    tmp_path,
):
    for name in ('rig.json', 'file'):
        (tmp_path / name).write_text('precious')
    assert sim_bus.main([*VIRTUAL, '--ground-truth', str(tmp_path / directory)]) == 1
    error = capsys.readouterr().err
    assert error.startswith('sim_bus: ')
    assert words in error
    assert error.count('\n') == 1
    assert (tmp_path / 'rig.json').read_text() == 'precious'


def test_a_full_disk_ends_in_one_line(
    tmp_path,
    capsys,
    monkeypatch,
):
    """Files cannot grow any more: not when written, nor when closed."""
    monkeypatch.setattr('spm_haptic_master.simulation.bus_runner.LISTEN', 0.0)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limits[1]))
    try:
        code = sim_bus.main(
            [
                *VIRTUAL,
                '-p',
                'can.protocol:=raw',
                '--sync',
                '--seconds',
                '9',
                '--ground-truth',
                str(tmp_path),
            ]
        )
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert code == 1
    assert (
        capsys.readouterr().err
        == f'sim_bus: {tmp_path}/ground_truth.csv: cannot be written: [Errno 27] File too large\n'
    )


def test_the_zero_counts_are_those_of_the_simulated_rig_at_any_resolution(capsys):
    counts = '-p', 'encoders.counts_per_turn:=[4096, 16384, 65536, 4096]'
    assert sim_bus.main([*VIRTUAL, *counts, '--seconds', '0.01']) == 0
    assert 'zero counts [300, 15870, 32012, 1111], directions' in capsys.readouterr().out


@pytest.mark.parametrize('of_the_rig', [True, False])
def test_the_encoders_have_the_harmonics_of_their_rig_once(monkeypatch, of_the_rig):
    """Also where it reads the same file as the driver that corrects them."""
    seen = []

    def stop(layouts, **_):
        seen.extend(layouts)
        raise KeyboardInterrupt

    monkeypatch.setattr(sim_bus, 'SimulatedBus', stop)
    rig = ['-p', 'sim.rig_seed:=4'] if of_the_rig else []
    assert (
        sim_bus.main([*VIRTUAL, *rig, '-p', 'encoders.harmonic_cos_deg:=[0.1, 0.1, 0.1, 0.1]'])
        == 130
    )
    assert make_rig(values('sim', sim__rig_seed=4)).has_harmonics
    assert [layout.harmonics is None for layout in seen] == [of_the_rig] * 4


def test_another_program_that_sends_the_same_frames_is_reported_with_the_cure(capsys):
    with can.Bus(interface='virtual', channel='can0') as other:
        task = other.send_periodic(canopen.frame(0x702, b'\x05'), 0.05)
        assert sim_bus.main([*VIRTUAL, '--seconds', '0.01']) == 0
        task.stop()
    error = capsys.readouterr().err
    assert error.startswith(
        'sim_bus: another program sends 0x702 on virtual can0, too: a second sim_bus, or encoders'
    )
    assert 'CAN_CONFIG=\'{"port": 43114}\'' in error
    assert error.count('\n') == 1
    assert sim_bus.main([*VIRTUAL, '--seconds', '0.01']) == 0
    assert capsys.readouterr().err == ''
