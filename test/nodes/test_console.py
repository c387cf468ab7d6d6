# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The line a second that `master` prints."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from spm_haptic_master.force import FORCE_STATES
from spm_haptic_master.kinematics import matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.nodes import console as console_module
from spm_haptic_master.nodes.console import Console
from spm_haptic_master.supervision.orientation_state import read_state


def console(
    state='healthy', caution='', encoders='publishing', force=None, dexterity=0.15, source='can'
):
    """Return a console of nodes as far as it reads them."""
    meter = SimpleNamespace(rate=lambda: 1000.0, percentiles=lambda *_: (90.0, 200.0))
    pose = matrix_from_zxz(*np.radians((130.0, 50.0, 30.0)))
    fkm = SimpleNamespace(
        state=read_state(state),
        quaternion=tuple(quaternion_from_matrix(pose).tolist()),
        status=SimpleNamespace(caution=caution),
        protection_level=0.01,
        force_state=force,
        latency_status=SimpleNamespace(
            parity=0.1,
            published=meter,
            latency=meter,
        ),
    )
    driver = SimpleNamespace(
        state=encoders,
        source_name=source,
        published=meter,
        get_parameter=lambda _: SimpleNamespace(value='tour'),
    )
    diagnostics = SimpleNamespace(
        state='clear of singularities',
        sensors=4,
        dexterities=None if dexterity is None else SimpleNamespace(three=dexterity, every=0.4),
    )
    return Console(driver, fkm, diagnostics)


RATES = 'rates joints 1000 Hz, orientation 1000 Hz, latency p50 90 us, p99 200 us'


def test_a_healthy_device_is_one_line():
    assert console().line() == (
        'source can, state healthy, orientation psi  130.000 theta  50.000 phi   30.000 deg, '
        'protection level 0.57 deg, parity +0.1 sigma, singularity clear of singularities, '
        f'dexterity 0.1500 (3 sensors), 0.4000 (4 sensors), {RATES}'
    )


def test_a_silent_device_has_a_reason_and_no_orientation():
    line = console(state='silent: jumped', dexterity=None).line()
    assert line == (
        f'source can, state silent: jumped, singularity unknown: clear of singularities, {RATES}'
    )


def test_cautions_and_the_state_of_the_force_are_in_the_line():
    line = console(
        caution='joint_3a unchecked',
        encoders='joint_1b: EMCY 0x5000',
        force=FORCE_STATES['ready'],
    ).line()
    assert 'caution joint_3a unchecked, caution encoders: joint_1b: EMCY 0x5000' in line
    assert 'force ready' in line


def test_a_control_character_does_not_reach_the_terminal():
    assert 'caution no ?[2J of?can0?' in console(caution='no \x1b[2J of\tcan0\n').line()


@pytest.mark.parametrize(
    ('source', 'title'),
    [
        ('can', 'haptic master, source can (Ctrl-C ends)'),
        (
            'sim',
            'haptic master, source sim (Ctrl-C ends): the simulated motion crosses the '
            'singularity on purpose',
        ),
    ],
)
def test_the_first_line_names_the_source(source, title):
    assert console(source=source).title() == title


def test_lines_come_once_a_second_until_nobody_reads(monkeypatch):
    reading, writing = os.pipe()
    monkeypatch.setattr(console_module, 'STANDARD_OUTPUT', writing)
    slept = []

    def sleep(seconds):
        slept.append(seconds)
        if len(slept) == 3:
            os.close(reading)

    monkeypatch.setattr(console_module.time, 'sleep', sleep)
    console()._run()
    assert slept == [1.0, 1.0, 1.0]
    os.close(writing)
