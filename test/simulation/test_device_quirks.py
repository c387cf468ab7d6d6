# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""sim_bus's options for what other makers' encoders do, by the programs that meet them."""

from contextlib import closing
import time

from disturbance import SKIPPED
from encoder_frames import values
import pytest
from spm_haptic_master.encoders import bus_scan, canopen_network
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.simulation.device_quirks import KINDS, parse_quirk
from spm_haptic_master.simulation.source_factory import make_source
from spm_haptic_master.tools import can_scan, can_setup, command_line, sim_bus

# Longest wait for what has to happen, on a busy machine, s.
PATIENCE = 10.0


@pytest.fixture
def run(capsys, channel, monkeypatch):
    """Run can_scan or can_setup on the bus; return its exit code and output."""
    monkeypatch.setattr(bus_scan, 'SYNC_LISTEN', 0.3)
    monkeypatch.setattr(canopen_network, 'BOOT_TIMEOUT', 2.0)
    monkeypatch.setattr(can_setup, 'LISTEN', 0.0)
    monkeypatch.setattr(command_line, 'SIGNALS', ())

    def run(program, *args, rate=50.0):
        name = program.__name__.rpartition('.')[2]
        bus = ('-p', 'can.interface:=virtual', '-p', f'can.channel:={channel}')
        capsys.readouterr()
        code = program.main([name, *bus, '-p', f'rate:={rate}', *args])
        out, err = capsys.readouterr()
        return code, out + err

    return run


@pytest.fixture
def driver(channel):
    """Make a driver on the bus at 50 Hz."""

    def make(**overrides):
        bus = {'can__interface': 'virtual', 'can__channel': channel}
        settings = {
            'rate': 50.0,
            'can__timeout': 0.5,
            'can__heartbeat_timeout': 2.0,
            'can__sync': 'produce',
        }
        return closing(make_source('can', values(**bus, **settings | overrides)))

    return make


def fault_of(source, words):
    """Read until a fault or a caution has some words; return it."""
    end = time.monotonic() + PATIENCE
    while words not in (found := f'{source.fault} {source.caution}'):
        assert time.monotonic() < end, found
        source.read(0.02)
    return found


def test_E6_phases_without_sync(run, encoders, driver):
    """No half of a period has the phases of this seed."""
    given = {'encoders__sync_id': 0, 'rate': 10.0}
    with encoders(quirks=('phases',), seed=44, **given):
        code, text = run(can_scan, '--start', '-p', 'encoders.sync_id:=0', rate=10.0)
        with driver(
            encoders__sync_id=0,
            can__sync='consume',
            rate=10.0,
        ) as source:
            words = fault_of(source, 'without SYNC joint_')
    assert code == 1
    assert 'SYNC is needed' in words
    if 'configured 10 Hz' in text:
        pytest.skip(f'{SKIPPED}the encoders did not keep their period')
    assert 'no set is complete within half a period' in text
    assert 'SYNC is needed' in text


def test_E7_one_timer(run, encoders):
    with encoders(
        factory=True,
        quirks=('one_timer',),
        encoders__sync_id=0,
        rate=50.0,
    ) as nodes:
        assert run(can_setup, '--write', '-p', 'encoders.sync_id:=0')[0] == 0
        assert nodes[0].value(0x1800, 5) == nodes[0].value(0x6200, 0) == 20


def test_E8_and_E9_objects_that_are_read_only_or_missing(run, encoders):
    with encoders(factory=True, quirks=('read_only:joint_1b=0x6001', 'missing=0x1017')):
        code, text = run(can_setup, '--write')
    assert code == 1
    assert 'joint_1b: node 2 refuses 0x4000 for 0x6001:00' in text
    assert 'set encoders.counts_per_turn: 65536; not stored: a reset has undone' in text
    assert text.endswith('1 of 4 encoders not set up\n')


def test_E4_a_store_that_is_refused(run, encoders):
    with encoders(factory=True, quirks=('store_refused:joint_1a',)):
        for _ in range(2):
            code, text = run(can_setup, '--write', '--joint', 'joint_1a')
            assert code == 1
            assert 'refuses 0x65766173 for 0x1010:01' in text


def test_E2_an_error_that_stands(run, encoders, driver):
    with encoders(quirks=('error:joint_3a=0x10',)):
        code, text = run(can_scan, '--start')
        with driver() as source:
            fault_of(source, 'joint_3a: error register 0x10 (communication)')
    assert code == 1
    assert 'joint_3a: error register 0x10 (communication)' in text


def test_E3_supervised_sync(run, encoders, driver):
    with encoders(quirks=('supervises_sync:joint_1a',), rate=50.0):
        with driver() as source:
            fault_of(source, 'it left OPERATIONAL when this driver left a SYNC out')
            end = time.monotonic() + 2.5
            while time.monotonic() < end:
                source.read(0.02)
            assert source.fault is None
            assert source.statistics()['SYNC left out'] == 1
        code, text = run(can_setup, '--write', '--joint', 'joint_1a')
        assert code == 0
        assert '0x1006:00 supervised period of SYNC, us: 20000, wanted 0' in text
        with driver() as source:
            end = time.monotonic() + 2.5
            while time.monotonic() < end:
                source.read(0.02)
            assert 'supervises SYNC' not in f'{source.fault} {source.caution}'


def test_E12_one_node_id(run, encoders):
    """As delivered."""
    with encoders(factory=True, quirks=('node_id=127',)):
        code, text = run(can_scan, '--start', '--seconds', '1')
    assert code == 1
    assert 'four devices have node id 127: give each its own' in text
    # They cannot be set up before, one by one.
    assert 'can_setup' not in text.partition('lines for rig.yaml')[0]


def test_the_help_of_sim_bus_has_every_kind(capsys):
    with pytest.raises(SystemExit):
        sim_bus.main(['sim_bus', '--help'])
    out = capsys.readouterr().out
    assert all(f'\n  {kind} ' in out for kind in KINDS)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('nonsense', "kind 'nonsense'; expected one of phases"),
        ('phases=3', 'expected no value with phases'),
        ('error', r'expected =VALUE \(error register'),
        ('error:joint_3b=1', "joint 'joint_3b'; expected one of joint_1a"),
        ('missing=x', 'not a number'),
        ('node_id=128', 'VALUE is 128; expected 1 .. 127'),
        ('a b', 'expected KIND'),
    ],
)
def test_what_is_no_quirk_is_named(text, words):
    with pytest.raises(InputError, match=words):
        parse_quirk(text)


def test_phases_on_a_bus_with_sync_are_refused(capsys):
    assert sim_bus.main(['sim_bus', '-p', 'can.interface:=virtual', '--quirk', 'phases']) == 1
    assert 'expected -p encoders.sync_id:=0' in capsys.readouterr().err
