# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""can_setup against canopen's LocalNode and against sim_bus's encoders, on a virtual bus."""

from dataclasses import replace
import re
import signal
import sys

import can
import pytest

canopen = pytest.importorskip('canopen')

from encoder_frames import LAYOUTS  # noqa: E402, I100
from local_encoder import LocalEncoder  # noqa: E402
from spm_haptic_master.encoders.canopen_network import Node  # noqa: E402
from spm_haptic_master.encoders.node_setup import wanted_objects  # noqa: E402
from spm_haptic_master.tools import can_setup  # noqa: E402

ONE = ('--joint', 'joint_1b')
# Vendor, product and revision of the simulated encoders; the serial number is a node id.
SIMULATED = ('--identity', '0', '0x53504D', '0x10001')


@pytest.fixture
def run(capsys, channel):
    """Run the command line on the bus; return its exit code, stdout and stderr."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def run(*args):
        capsys.readouterr()
        code = can_setup.main(['can_setup', '-p', 'can.interface:=virtual',
                               '-p', f'can.channel:={channel}', *map(str, args)])
        return code, *capsys.readouterr()

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture
def network(channel):
    """Give a network of canopen's own on the other side of the bus."""
    with can.Bus(interface='virtual', channel=channel) as bus:
        network = canopen.Network(bus)
        network.NOTIFIER_CYCLE = 0.1
        network.connect()
        yield network
        for node in network.values():
            node.nmt.stop_heartbeat()
        network.notifier.stop()


def test_differences_are_listed_and_on_request_written_stored_and_verified(network, run):
    encoder = LocalEncoder(network, 2)
    found = """joint_1b, node 2: encoder 0x00010196, vendor 0x59, product 0x41, revision 0x3, serial 0x309
  0x1800:02 TPDO1 transmission type: 254, wanted 1
  0x1800:05 TPDO1 event timer: 10, wanted 0
  0x1A00:00 TPDO1 mapped objects: 2, wanted 1
  0x1801:01 TPDO2 off: 0x0, wanted 0x80000000
  0x1017:00 heartbeat time, ms: 0, wanted 100
  0x6000:00 scaling on (bit 2): 0, wanted 4
  0x6001:00 units per turn: 8192, wanted 16384
  0x6002:00 total range: 8192, wanted 16384
  0x6200:00 cyclic timer, ms: 10, wanted 0
"""  # noqa: E501
    code, out, err = run(*ONE)
    assert (code, err) == (1, '') and out.startswith(found)
    assert out.endswith('1 of 1 encoders not as configured; nothing was written (--write)\n')
    assert encoder.writes == []

    code, out, err = run(*ONE, '--write')
    assert (code, err) == (0, '') and out.startswith(found)
    assert out.endswith('1 of 1 encoders as configured, stored and read back after a reset\n')
    expected = {
        (0x1800, 1): 0x40000182, (0x1800, 2): 1, (0x1800, 5): 0, (0x1A00, 0): 1,
        (0x1A00, 1): 0x60040020, (0x1801, 1): 0xC0000282, (0x1017, 0): 100,
        # The direction of counting, bit 0, is left as it was.
        (0x6000, 0): 5, (0x6001, 0): 16384, (0x6002, 0): 16384, (0x6200, 0): 0}
    assert {key: encoder.value(*key) for key in expected} == expected
    # In the order of CiA 301: off, parameters, mapping without entries, on; stored at the end.
    assert encoder.writes[:8] == [
        (0x1800, 1, 0xC0000182), (0x1800, 2, 1), (0x1800, 5, 0), (0x1A00, 0, 0),
        (0x1A00, 1, 0x60040020), (0x1A00, 0, 1), (0x1800, 1, 0xC0000182), (0x1800, 1, 0x40000182)]
    assert encoder.writes[-1] == (0x1010, 1, int.from_bytes(b'save', 'little'))

    encoder.writes.clear()
    code, out, _ = run(*ONE, '--write')
    assert code == 0 and out.endswith('1 of 1 encoders as configured\n')
    assert encoder.writes == []


@pytest.mark.parametrize(('node_id', 'given', 'expected'), [
    # Another TPDO and resolution.
    (9, ('encoders.node_id:=[1, 9, 3, 4]', 'encoders.id:=[0x181, 0x289, 0x183, 0x184]',
         'encoders.counts_per_turn:=[16384, 4096, 16384, 16384]',
         'encoders.zero_count:=[0, 0, 0, 0]'),
     {(0x1801, 1): 0x40000289, (0x1800, 1): 0xC0000189, (0x6001, 0): 4096, (0x1017, 0): 250}),
    # A frame of another layout keeps its mapping.
    (2, ('encoders.data_length:=[6, 6, 6, 6]',), {(0x1A00, 0): 2, (0x1800, 2): 1}),
    # Without SYNC it sends by a timer; where a mask selects the turn it may count turns.
    (2, ('encoders.sync_id:=0', 'encoders.mask:=[0, 0x3FFF, 0, 0]'),
     {(0x1800, 2): 254, (0x6200, 0): 1, (0x6002, 0): 8192})])
def test_other_settings_are_other_objects(network, run, node_id, given, expected):
    encoder = LocalEncoder(network, node_id)
    code, out, _ = run(*ONE, '--write', '--heartbeat', '0.25',
                       *(part for each in given for part in ('-p', each)))
    assert code == 0, out
    assert {key: encoder.value(*key) for key in expected} == expected
    assert ('the mapping cannot be derived from this layout: left as it is' in out) \
        == ((0x1A00, 0) in expected)


@pytest.mark.parametrize(('changes', 'words'), [
    ({'read_only': [(0x6001, 0)]},
     'node 2 refuses 0x4000 for 0x6001:00: Code 0x06010002, Attempt to write a read only object'),
    ({'without': [(0x6001, 0)]}, '0x6001:00 units per turn: missing, wanted 16384'),
    ({'forgets': True}, 'node 2: not as wanted after storing and a reset: 0x1800:02 TPDO1'),
    ({'without': [(0x1010, 1)]}, 'node 2 refuses 0x65766173 for 0x1010:01'),
])
def test_what_an_encoder_does_not_do_is_reported(network, run, changes, words):
    LocalEncoder(network, 2, **changes)
    code, out, err = run(*ONE, '--write')
    assert (code, err) == (1, '')
    assert words in out
    assert out.endswith('1 of 1 encoders not set up\n')


@pytest.mark.slow
def test_an_encoder_that_is_missing_does_not_stop_the_others(network, run):
    LocalEncoder(network, 1)
    # Objects that are not needed may be missing.
    LocalEncoder(network, 3, without=[(0x1800, 5), (0x6200, 0)])
    code, out, _ = run('--write', '--joint', 'joint_1a', *ONE, '--joint', 'joint_1c')
    assert code == 1
    assert 'joint_1b: node 2 does not answer SDO' in out
    assert out.count('objects as configured; ') == 2
    assert out.endswith('1 of 3 encoders not set up\n')


@pytest.mark.slow
def test_four_simulated_encoders_from_their_makers_defaults(run, encoders):
    """Node ids by LSS, one by one, then all objects."""
    encoders(factory=True)
    code, _, err = run('--lss', 'joint_1a', '--write')
    assert code == 1
    assert '4 devices answer LSS: connect one encoder only, or select it by' in err
    _, _, err = run('--lss', 'joint_1a', *SIMULATED, 9, '--write')
    assert 'no device with the identity 0x0 0x53504D 0x10001 0x9 answers LSS' in err
    for node_id, joint in enumerate(('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a'), 1):
        one = ('--lss', joint, *SIMULATED, node_id)
        if node_id == 1:
            code, out, err = run(*one)
            assert code == 1
            assert out == 'device 0x0 0x53504D 0x10001 0x1: no node id, wanted 1 ' \
                '(joint_1a)\nnothing was written (--write)\n'
        code, out, err = run(*one, '--write')
        assert (code, err) == (0, ''), out + err
        assert out.endswith('stored; the device answers under it after a reset\n')
    assert run(*one)[0] == 0
    code, out, _ = run()
    assert code == 1
    assert out.count('units per turn: 65536, wanted 16384') == 4
    assert run('--write')[0] == 0
    assert run()[0] == 0


def test_nothing_is_written_while_a_master_runs(run, encoders):
    encoders(sync=True)
    code, _, err = run('--write')
    assert code == 1
    assert err == 'can_setup: SYNC 0x80 on the bus: a master is running; stop it before ' \
        'anything is written\n'
    code, out, _ = run()
    assert code == 0 and out.endswith('4 of 4 encoders as configured\n')


@pytest.mark.slow
def test_a_node_id_of_another_node_is_not_given(run, encoders):
    encoders()
    code, out, err = run('--lss', 'joint_1a', *SIMULATED, 2, '--write')
    assert code == 1
    assert out == 'device 0x0 0x53504D 0x10001 0x2: node id 2, wanted 1 (joint_1a)\n'
    assert 'node id 1 is taken by another node on the bus' in err


@pytest.mark.slow
def test_a_node_id_is_changed(run, encoders):
    """An encoder with an id; its TPDO keeps the identifier of the old one until it is set up."""
    encoders()
    moved = ('-p', 'encoders.node_id:=[11, 2, 3, 4]')
    code, out, _ = run('--lss', 'joint_1a', *SIMULATED, 1, *moved, '--write')
    assert code == 0, out
    assert 'node id 1, wanted 11' in out
    code, out, _ = run('--joint', 'joint_1a', *moved)
    assert 'joint_1a, node 11: encoder' in out
    code, out, _ = run('--lss', 'joint_1a', *SIMULATED, 1, *moved, '--bit-rate', 500_000)
    assert code == 1
    code, out, _ = run('--lss', 'joint_1a', *SIMULATED, 1, *moved, '--bit-rate', 500_000,
                       '--write')
    assert code == 0
    assert 'node id 11 and 500000 bit/s stored, not verified: switch' in out


@pytest.mark.slow
def test_a_bus_without_devices(run):
    code, _, err = run('--lss', 'joint_1a')
    assert code == 1
    assert re.fullmatch('can_setup: no device answers LSS .*\n', err)
    code, out, _ = run()
    assert code == 1
    assert out.count('does not answer SDO') == 4


def test_a_frame_of_29_bits_has_its_identifier_and_no_tpdo_of_the_node_id():
    layout = replace(LAYOUTS[0], extended=True, can_id=0x18FF1234)
    identifier = wanted_objects(layout, 1, True, 1e-3, 0.1).pdos[0].identifier
    assert (identifier.index, identifier.value) == (0x1800, 0x38FF1234)
    assert identifier.holds(0x78FF1234) and not identifier.holds(0x18FF1234)
    assert identifier.changed(0xC0000181) == 0x78FF1234


def test_a_bus_that_failed_is_the_reason(network):
    node = Node(network, 9)
    network.notifier.exception = OSError('down')
    for request in (lambda: node.read(0x1000, 0), lambda: node.write(0x1017, 0, 1, 2)):
        with pytest.raises(OSError, match='down'):
            request()
    del network[9]


@pytest.mark.parametrize(('args', 'words'), [
    (('-p', 'can.protocol:=raw'), "'can.protocol' is 'raw'; expected 'canopen'"),
    (('--heartbeat', '0'), "--heartbeat: '0'; expected a number above 0"),
    (('--heartbeat', 'nan'), "--heartbeat: 'nan'; expected a finite number"),
    (('--heartbeat', '0.1005'), '--heartbeat 0.1005 s; expected whole milliseconds'),
    (('--heartbeat', '66'), '--heartbeat 66 s; expected whole milliseconds'),
    (('--lss', 'joint_1a', '--bit-rate', '300000'), 'invalid choice: 300000 (choose from 1000000'),
    (('-p', 'encoders.sync_id:=0', '-p', 'rate:=300.0'), '1 / rate 0.00333333 s; expected whole'),
])
def test_a_wrong_argument_is_reported(run, args, words):
    code, _, err = run(*args)
    assert code == 1
    assert words in err and err.count('\n') == 1


def test_without_the_library_it_is_named(run, monkeypatch):
    monkeypatch.setitem(sys.modules, 'canopen', None)
    code, _, err = run()
    assert code == 1
    assert re.search('needs canopen .sudo apt install python3-canopen; in a virtual environment: '
                     'pip install', err)
