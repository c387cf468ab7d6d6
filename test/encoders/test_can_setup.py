# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""can_setup against sim_bus's encoders, on a virtual bus."""

from dataclasses import replace
import sys
from unittest.mock import Mock

import can
from encoder_frames import LAYOUTS
import pytest
from spm_haptic_master.encoders import canopen, canopen_network
from spm_haptic_master.encoders.canopen_network import import_canopen, network_on, NodeClient
from spm_haptic_master.encoders.encoder_objects import wanted_objects
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.simulation.object_store import Entry
from spm_haptic_master.tools import can_setup, command_line

library = pytest.importorskip('canopen')

ONE = ('--joint', 'joint_1b')


@pytest.fixture
def run(capsys, channel, monkeypatch):
    """Run the command line on the bus, soon; return its exit code, stdout and stderr."""
    for module, name, value in (
        (canopen_network, 'ANSWER_TIMEOUT', 0.3),
        (canopen_network, 'RECEIVE_TIMEOUT', 0.005),
        (can_setup, 'LISTEN', 0.05),
        (command_line, 'SIGNALS', ()),
    ):
        monkeypatch.setattr(module, name, value)

    def run(*args):
        capsys.readouterr()
        code = can_setup.main(
            [
                'can_setup',
                '-p',
                'can.interface:=virtual',
                '-p',
                f'can.channel:={channel}',
                *map(str, args),
            ]
        )
        return code, *capsys.readouterr()

    return run


@pytest.fixture
def factory(encoders, stack):
    """Make encoders from their maker; give that of joint_1b, with some objects replaced."""

    def make(changes, **options):
        node = stack.enter_context(encoders(factory=True, **options))[1]
        for objects in (node._entries, node._stored):
            objects |= changes
            for key in [key for key, entry in changes.items() if entry is None]:
                del objects[key]
        return node

    return make


def held(node, keys):
    """Return the values of objects, read by SDO."""
    return {
        key: canopen.sdo_value(node.answer(2, canopen.sdo_upload(2, *key).data).data)
        for key in keys
    }


# Objects of joint_1b that are not as wanted, besides those of every encoder from its maker.
OTHERWISE = {
    (0x1800, 5): Entry(10, 2),
    (0x1801, 1): Entry(0x282),
    (0x6000, 0): Entry(1, 2),
    (0x6200, 0): Entry(10, 2),
}
# What is wanted of it. The direction of counting, bit 0 of 0x6000, is left as it was.
WANTED = {
    (0x1800, 1): 0x40000182,
    (0x1800, 2): 1,
    (0x1800, 5): 0,
    (0x1A00, 0): 1,
    (0x1A00, 1): 0x60040020,
    (0x1801, 1): 0x80000282,
    (0x1017, 0): 100,
    (0x6000, 0): 5,
    (0x6001, 0): 16384,
    (0x6002, 0): 16384,
    (0x6200, 0): 0,
}
ALL_AS_CONFIGURED = '4 of 4 encoders as configured, stored and read back after a reset\n'


def test_differences_are_listed_and_nothing_is_written(factory, run):
    node = factory(OTHERWISE)
    before = held(node, WANTED)
    code, out, err = run()
    assert (code, err) == (1, '')
    assert held(node, WANTED) == before
    second = out.partition('joint_1b, node 2: ')[2].partition('joint_1c')[0]
    assert second.splitlines() == [
        'encoder 0x00010196, vendor 0x0, product 0x53504D, revision 0x10001, serial 0x2',
        '  0x1800:02 TPDO1 transmission type: 254, wanted 1',
        '  0x1800:05 TPDO1 event timer, ms: 10, wanted 0',
        '  0x1A00:00 TPDO1 mapped objects: 2, wanted 1',
        '  0x1801:01 TPDO2 off: 0x0, wanted 0x80000000',
        '  0x1017:00 heartbeat time, ms: 0, wanted 100',
        '  0x6000:00 scaling on (bit 2): 0, wanted 4',
        '  0x6001:00 units per turn: 65536, wanted 16384',
        '  0x6002:00 total range: 65536, wanted 16384',
        '  0x6200:00 cyclic timer, ms: 10, wanted 0',
        '  it has no 0x1802:01, 0x1803:01, and need not have',
        '  7 of 16 objects as configured',
    ]
    assert out.endswith('4 of 4 encoders not as configured; nothing was written (--write)\n')


def test_on_request_they_are_written_stored_and_verified(factory, run, channel):
    """The simulated encoders refuse what is not written in the order of CiA 301."""
    node = factory(OTHERWISE)
    with can.Bus(interface='virtual', channel=channel) as other:
        code, out, err = run('--write')
        frames = list(iter(lambda: other.recv(0.0), None))
    assert (code, err) == (0, '')
    # The commands of its states (CiA 301) to node 2: pre-operational, reset.
    commands = [frame.data.hex() for frame in frames if frame.arbitration_id == 0]
    assert [each for each in commands if each.endswith('02')] == ['8002', '8102']
    assert held(node, WANTED) == WANTED
    assert out.endswith(ALL_AS_CONFIGURED)
    assert '; 9 written\n' in out


def test_once_written_nothing_is_wanted(factory, run):
    factory(OTHERWISE)
    run('--write')
    code, out, err = run('--write')
    assert (code, err) == (0, '')
    assert out.endswith(ALL_AS_CONFIGURED)
    assert 'wanted' not in out


@pytest.mark.parametrize(
    ('node_id', 'given', 'expected'),
    [
        # Another TPDO and resolution.
        (
            9,
            (
                'encoders.node_id:=[1, 9, 3, 4]',
                'encoders.id:=[0x181, 0x289, 0x183, 0x184]',
                'encoders.counts_per_turn:=[16384, 4096, 16384, 16384]',
                'encoders.zero_count:=[0, 0, 0, 0]',
            ),
            {
                (0x1801, 1): 0x40000289,
                (0x1800, 1): 0xC0000189,
                (0x6001, 0): 4096,
                (0x1017, 0): 250,
            },
        ),
        # A frame of another layout keeps its mapping.
        (2, ('encoders.data_length:=[6, 6, 6, 6]',), {(0x1A00, 0): 2, (0x1800, 2): 1}),
        # Without SYNC it sends by a timer; where a mask selects the turn it may count turns.
        (
            2,
            ('encoders.sync_id:=0', 'encoders.mask:=[0, 0x3FFF, 0, 0]'),
            {(0x1800, 2): 254, (0x1800, 5): 1, (0x6200, 0): 0, (0x6002, 0): 65536},
        ),
    ],
)
def test_other_settings_are_other_objects(factory, run, node_id, given, expected):
    second = node_id == 9
    node = factory(
        {(0x1800, 1): Entry(0x40000189)} if second else {},
        encoders__node_id=(1, node_id, 3, 4),
        encoders__id=(0x181, 0x289 if second else 0x182, 0x183, 0x184),
    )
    node.answer = Mock(wraps=node.answer)
    code, out, _ = run(
        *ONE, '--write', '--heartbeat', '0.25', *(part for each in given for part in ('-p', each))
    )
    assert code == 0, out
    # The identifier of the TPDO changes while it is off (bit 31).
    written = [
        data
        for (_, data), _ in node.answer.call_args_list
        if canopen.sdo_object(data) == (0x1801 if second else 0x1800, 1)
        and canopen.sdo_download(data)
    ]
    assert [data[-1] >> 7 for data in written] == [1, 1, 0]
    assert held(node, expected) == expected
    assert ('the mapping cannot be derived from this layout: left as it is' in out) == (
        (0x1A00, 0) in expected
    )


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        (
            {(0x6001, 0): Entry(65536, writable=False)},
            'node 2 refuses 0x4000 for 0x6001:00: Code 0x06010002, Attempt to write a read '
            'only object',
        ),
        (
            {(0x6001, 0): None},
            '0x6501:00 units per turn of the disc: 65536, wanted 16384; set '
            'encoders.counts_per_turn: 65536; nothing was written',
        ),
        (
            {(0x1000, 0): Entry(0x00020192)},
            'node 2 has device type 0x00020192; expected profile 406 (encoder)',
        ),
        ({(0x1000, 0): None}, 'node 2 has device type none; expected'),
        ({(0x1010, 1): None}, 'node 2 cannot store (0x1010:01): what is written would be lost'),
        (None, 'node 2: not as configured after storing and a reset: 0x1800:02 TPDO1'),
        ({}, 'node 2 has not booted within 0.05 s of its reset'),
    ],
)
def test_what_an_encoder_does_not_do_is_reported(factory, run, monkeypatch, changes, words):
    node = factory(changes or {})
    if changes is None:
        made = dict(node._stored)
        node.restart = lambda: node._entries.update(made)
    if changes == {}:
        monkeypatch.setattr(canopen_network, 'BOOT_TIMEOUT', 0.05)
        node.boot = lambda: []
    code, out, err = run(*ONE, '--write')
    assert (code, err) == (1, '')
    assert words in out
    assert out.endswith('1 of 1 encoders not set up\n')


def test_an_encoder_that_is_missing_does_not_stop_the_others(factory, run):
    # Objects that are not needed may be missing.
    factory({(0x1800, 5): None, (0x6200, 0): None})
    code, out, _ = run(
        '--write', *ONE, '--joint', 'joint_1c', '-p', 'encoders.node_id:=[1, 2, 9, 4]'
    )
    assert code == 1
    assert 'joint_1c: node 9 does not answer SDO' in out
    assert out.count('objects as configured; ') == 1
    assert out.endswith('1 of 2 encoders not set up\n')


def test_a_frame_of_29_bits_has_its_identifier_and_no_tpdo_of_the_node_id():
    layout = replace(LAYOUTS[0], extended=True, can_id=0x18FF1234)
    identifier = wanted_objects(layout, 1, 0x80, 1e-3, 0.1).pdos[0].identifier
    assert (identifier.index, identifier.value) == (0x1800, 0x38FF1234)
    assert identifier.holds(0x78FF1234)
    assert not identifier.holds(0x18FF1234)
    assert identifier.changed(0xC0000181) == 0x78FF1234


def test_objects_have_the_sizes_that_the_encoders_have(factory):
    sizes = {key: entry.size for key, entry in factory({})._entries.items()}
    for each in wanted_objects(LAYOUTS[1], 2, 0x80, 1e-3, 0.1).every:
        assert sizes.get((each.index, each.subindex), each.size) == each.size, each.name


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('SDO_UNKNOWN_COMMAND', 'Unknown SDO command specified'),
        ('SDO_READ_ONLY', 'Attempt to write a read only object'),
        ('SDO_NO_SUCH_OBJECT', 'Object does not exist'),
        ('SDO_WRONG_LENGTH', 'Data type and length code do not match'),
        ('SDO_NO_SUCH_SUBINDEX', 'Subindex does not exist'),
        ('SDO_WRONG_VALUE', 'Value range of parameter exceeded'),
        ('SDO_NOT_STORED', 'Data cannot be transferred or stored to the application'),
        (
            'SDO_WRONG_STATE',
            'Data can not be transferred or stored to the application because of the present '
            'device state',
        ),
    ],
)
def test_abort_codes_are_those_of_the_library(name, words):
    assert library.SdoAbortedError.CODES[getattr(canopen, name)] == words


def test_a_bus_that_failed_is_the_reason(channel):
    with can.Bus(interface='virtual', channel=channel) as bus, network_on(bus) as network:
        node = NodeClient(network, 9)
        network.notifier.exception = OSError('down')
        for request in (lambda: node.read(0x1000, 0), lambda: node.write(0x1017, 0, 1, 2)):
            with pytest.raises(OSError, match='down'):
                request()


@pytest.mark.parametrize(
    ('args', 'words'),
    [
        (('--heartbeat', '0.1005'), '--heartbeat 0.1005 s; expected whole milliseconds'),
        (('--heartbeat', '66'), '--heartbeat 66 s; expected whole milliseconds'),
        (
            ('-p', 'encoders.sync_id:=0', '-p', 'rate:=300.0'),
            '1 / rate 0.00333333 s; expected whole',
        ),
    ],
)
def test_a_wrong_argument_is_reported(run, args, words):
    code, _, err = run(*args)
    assert code == 1
    assert words in err
    assert err.count('\n') == 1


def test_without_the_library_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, 'canopen', None)
    with pytest.raises(InputError, match='needs canopen .sudo apt install .*; .* pip install'):
        import_canopen()


def test_a_refused_store_leaves_no_long_time_out(monkeypatch):
    """Else each later question to a silent device would take 15 s."""
    node = NodeClient(library.Network(), 1)
    usual = node._sdo.RESPONSE_TIMEOUT, node._sdo.MAX_RETRIES

    def refuse(*_):
        assert node._sdo.RESPONSE_TIMEOUT == canopen_network.STORE_TIMEOUT
        raise canopen_network.RefusedError('node 1 refuses to store')

    monkeypatch.setattr(node, 'write', refuse)
    with pytest.raises(canopen_network.RefusedError):
        node.store()
    assert (node._sdo.RESPONSE_TIMEOUT, node._sdo.MAX_RETRIES) == usual
