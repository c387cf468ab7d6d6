# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""can_setup against encoders of another stack, which lack, refuse or alias objects."""

import time

import can
from foreign_nodes import BARE, canopen, COUNTS, foreign_bus, Held, objects_of
import pytest
from spm_haptic_master.encoders import canopen_network
from spm_haptic_master.tools import can_setup, command_line

READ_ONLY = 0x06010002
NOT_STORED = 0x08000020


@pytest.fixture
def run(capsys, channel, monkeypatch):
    """Run can_setup for joint_1b on the bus; return its exit code and output."""
    for module, name, value in (
        (canopen_network, 'ANSWER_TIMEOUT', 0.3),
        (canopen_network, 'BOOT_TIMEOUT', 1.0),
        (canopen_network, 'RECEIVE_TIMEOUT', 0.005),
        (can_setup, 'LISTEN', 0.0),
        (command_line, 'SIGNALS', ()),
    ):
        monkeypatch.setattr(module, name, value)

    def run(*args, joints=('joint_1b',)):
        chosen = [part for joint in joints for part in ('--joint', joint)]
        bus = ('-p', 'can.interface:=virtual', '-p', f'can.channel:={channel}')
        capsys.readouterr()
        code = can_setup.main(['can_setup', *bus, *chosen, *args])
        out, err = capsys.readouterr()
        return code, out + err

    return run


def refusing(code, *keys):
    """Return what aborts a write of some objects."""

    def on_write(index, subindex, **_):
        if (index, subindex) in keys:
            raise canopen.SdoAbortedError(code)

    return on_write


def test_E3_and_E11_what_decides_the_answer_to_sync_is_compared_and_set(channel, run):
    held = objects_of(
        2,
        o1005=Held(0x40000090),
        o1006=Held(10000),
        o1019=Held(10, 1),
    )
    with foreign_bus(channel, (2, held)) as (encoder,):
        code, text = run()
        assert code == 1
        for line in (
            '0x1005:00 identifier of SYNC: 0x40000090, wanted 0x80',
            '0x1006:00 supervised period of SYNC, us: 10000, wanted 0',
            '0x1019:00 counter in SYNC: 10, wanted 0',
        ):
            assert f'  {line}\n' in text
        code, text = run('--write')
        assert code == 0, text
        encoder.boot()
        assert [encoder.value(index) for index in (0x1005, 0x1006, 0x1019)] == [0x80, 0, 0]


def test_E4_a_store_that_was_refused_is_no_success_at_the_second_run(channel, run):
    """The values are in the device, and gone with its power."""
    refuse = refusing(NOT_STORED, (0x1010, 1))
    with foreign_bus(channel, (2, objects_of(2, o1017=Held(0, 2)), refuse)) as (encoder,):
        encoder.boot = lambda: encoder.network.send_message(0x702, [0])  # keeps its values
        for _ in range(2):
            code, text = run('--write')
            assert code == 1
            assert 'refuses 0x65766173 for 0x1010:01' in text
            assert 'as configured\n' not in text.splitlines()[-1]
        assert encoder.stored == {}


def test_E4_values_that_another_tool_wrote_are_stored(channel, run):
    with foreign_bus(channel, (2, objects_of(2, o1017=Held(0, 2)))) as (encoder,):
        encoder.put(100, 0x1017)
        code, text = run('--write')
        assert code == 0
        assert '1 of 1 encoders as configured, stored and read back' in text
        encoder.boot()
        assert encoder.value(0x1017) == 100


def test_E4_a_device_that_cannot_store_is_not_written(channel, run):
    written = []
    with foreign_bus(
        channel,
        (2, objects_of(2, o1010_01=None, o1017=Held(0, 2)), lambda **_: written.append(1)),
    ):
        code, text = run('--write')
        assert code == 1
        assert 'node 2 cannot store (0x1010:01)' in text
        assert written == []
        assert 'nothing was written' in text
    with foreign_bus(channel, (2, objects_of(2, o1010_01=None))):
        code, text = run('--write')
        assert code == 0
        assert 'not stored by this run: it cannot store (0x1010:01)' in text
        assert text.endswith('as configured, 0 of them stored and read back after a reset\n')


def test_E4_a_store_may_take_longer_than_an_answer(channel, run):
    def slow(index, **_):
        if index == 0x1010:
            time.sleep(1.0)

    with foreign_bus(channel, (2, objects_of(2, o1017=Held(0, 2)), slow)):
        assert run('--write')[0] == 0
    assert canopen_network.STORE_TIMEOUT >= 10.0


ALIASES = (0x1800, 5), (0x6200, 0)


# Where an encoder has the timer of its TPDO: objects that are other than usual.
KINDS_OF_TIMER = {
    'one value': {},
    'two values': {},
    'no 6200h': {'o6200': None},
    'no 1800h:05': {'o1800_05': None},
    'TPDO2': {
        'o1801_01': Held(0x40000282),
        'o1801_02': Held(1, 1),
        'o1801_05': Held(7, 2),
        'o1A01_00': Held(1, 1),
        'o1A01_01': Held(0x60040020),
    },
}


@pytest.mark.parametrize('synchronised', [True, False])
@pytest.mark.parametrize('kind', KINDS_OF_TIMER)
def test_E7_the_timer_of_the_tpdo_is_wanted_and_6200h_only_where_it_stays_different(
    channel, run, kind, synchronised
):
    changes = {'o1800_05': Held(7, 2), 'o6200': Held(7, 2)}
    held = objects_of(2, **changes | KINDS_OF_TIMER[kind])

    def on_write(index, subindex, data, **_):
        if kind == 'one value' and (index, subindex) in ALIASES:
            for key in ALIASES:
                encoder.put(int.from_bytes(data, 'little'), *key)

    args = () if synchronised else ('-p', 'encoders.sync_id:=0')
    args += ('-p', 'rate:=100.0')
    if kind == 'TPDO2':
        args += ('-p', 'encoders.id:=[0x181, 0x282, 0x183, 0x184]')
    with foreign_bus(channel, (2, held, on_write)) as (encoder,):
        code, text = run('--write', *args)
        assert code == 0, text
        assert run(*args)[0] == 0
        timer = 0 if synchronised else 10
        expected = {
            'one value': (timer, timer),
            'two values': (timer, 0),
            'no 6200h': (timer, None),
            'no 1800h:05': (None, timer),
            # 6200h is that of TPDO1, which is off.
            'TPDO2': (7, 7),
        }[kind]
        for key, value in zip(ALIASES, expected, strict=True):
            if value is not None:
                assert encoder.value(*key) == value
        if kind == 'TPDO2':
            assert encoder.value(0x1801, 5) == timer
        # E6: the phases are named before anything is set up.
        assert ('SYNC is needed' in text) == (not synchronised)


def test_E8_a_refusal_in_the_middle_is_put_back(channel, run):
    held = objects_of(
        2, o1A00_00=Held(2, 1), o1A00_02=Held(0x60300110), o1800_02=Held(254, 1), o1017=Held(0, 2)
    )
    refuse = refusing(READ_ONLY, (0x1A00, 0), (0x1A00, 1))
    with foreign_bus(channel, (2, held, refuse)) as (encoder,):
        code, text = run('--write')
        assert code == 1
        assert 'node 2 refuses 0x0 for 0x1A00:00' in text
        assert (
            'it sends 0x6004:00 with 32 bits, 0x6030:01 with 16 bits: set encoders.data_length: '
            '6 and encoders.byte_offset: 0' in text
        )
        assert 'not stored: a reset has undone what was written' in text
        assert encoder.value(0x1800, 1) == 0x40000182
        assert encoder.value(0x1800, 2) == 254


def test_E8_what_a_reset_does_not_put_back_is_half_written(channel, run):
    refuse = refusing(READ_ONLY, (0x6001, 0))
    held = objects_of(2, o6001=Held(65536), o1800_02=Held(254, 1))
    with foreign_bus(channel, (2, held, refuse)) as (encoder,):
        encoder.boot = lambda: encoder.network.send_message(0x702, [0])
        code, text = run('--write')
        assert code == 1
        assert 'half written, and not stored: power-cycle it' in text
        assert 'set encoders.counts_per_turn: 65536' in text


@pytest.mark.parametrize(
    ('changes', 'good'),
    [
        # The disc has the right counts, and nothing scales them; or they cannot be switched.
        ({'o6000': None, 'o6001': None, 'o6002': None, 'o6501': Held(COUNTS)}, True),
        ({'o6000': Held(0, 2), 'o6501': Held(COUNTS), 'o6001': Held(7, access='ro')}, True),
        ({'o6000': Held(4, 2, 'ro'), 'o6001': Held(COUNTS, access='ro'), 'o6501': None}, True),
        ({'o6000': None, 'o6002': None}, True),
        # The largest position, as many devices have it.
        ({'o6002': Held(COUNTS - 1, access='ro')}, True),
        ({'o1017': None}, True),
        ({'o6001': Held(65536, access='ro')}, 'encoders.counts_per_turn: 65536'),
        (
            {'o6000': None, 'o6001': None, 'o6501': Held(4096, access='ro')},
            'encoders.counts_per_turn: 4096',
        ),
        ({'o6002': Held(COUNTS << 12, access='ro')}, 'set encoders.mask: 0x3FFF'),
    ],
)
def test_E9_each_object_is_judged_by_itself(channel, run, changes, good):
    """An object that is missing, or read-only and right, keeps nothing else from being set."""
    with foreign_bus(channel, (2, objects_of(2, o1800_02=Held(254, 1), **changes))) as (encoder,):
        code, text = run('--write')
        if good is True:
            assert code == 0, text
            encoder.boot()
            assert encoder.value(0x1800, 2) == 1
            assert run()[0] == 0
        else:
            assert code == 1
            assert good in text
        assert ('no heartbeat (0x1017)' in text) == ('o1017' in changes)


def test_E12_two_devices_with_one_node_id_are_named(channel, run):
    other = objects_of(2) | {(0x1018, 4): Held(7, access='ro')}
    with (
        can.Bus(interface='virtual', channel=channel),
        foreign_bus(channel, (2, objects_of(2))),
        foreign_bus(channel, (2, other)),
    ):
        code, text = run()
    assert code == 1
    assert 'two devices have node id 2: give each its own, one at a time on the bus' in text


def test_E17_an_answer_without_a_size_is_written_with_that_of_the_object(channel, run):
    """The node takes one byte for 0x1800:02, and answers with command 0x42."""
    held = objects_of(
        2,
        o1800_02=Held(254, 1),
        o1017=Held(0, 2),
        o6000=Held(0, 2),
    )
    with foreign_bus(channel, (2, held)) as (encoder,):
        server = encoder.node.sdo
        send = server.send_response

        def without_size(response):
            if response[0] & 0xE3 == 0x43:
                response[0] = 0x42
            send(response)

        server.send_response = without_size
        code, text = run('--write')
        assert code == 0, text
        assert encoder.value(0x1800, 2) == 1
        assert encoder.value(0x1017) == 100


def test_an_abort_of_one_optional_object_does_not_end_the_comparison(channel, run):
    with foreign_bus(channel, (2, objects_of(2))) as (encoder,):

        def on_read(index, **_):
            if index == 0x1006:
                raise canopen.SdoAbortedError(0x08000000)

        encoder.node.add_read_callback(on_read)
        code, text = run()
    assert code == 0
    assert '0x1006:00' in text


def test_encoders_without_any_optional_object_are_as_configured(channel, run):
    joints = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a')
    with foreign_bus(channel, *((n, objects_of(n, **BARE)) for n in (1, 2, 3, 4))):
        code, text = run('--write', joints=joints)
    assert code == 0, text
    assert text.count('4 of 4 objects as configured') == 4
    assert 'not stored by this run' in text
    assert 'no object has its counts per turn' in text


def eds(tmp_path, held, **limits):
    """Write an EDS of objects; `limits` are further lines of some, as of `objects_of`."""
    lines = ['[DeviceInfo]', 'VendorName=Turn & Co', 'ProductName=T-14', '']
    for index in sorted({index for index, _ in held}):
        subindices = sorted(place for at, place in held if at == index)
        single = subindices == [0] and index not in (0x1800, 0x1A00)
        if not single:
            lines += [
                f'[{index:04X}]',
                f'ParameterName=o{index:X}',
                'ObjectType=0x9',
                f'SubNumber={len(subindices)}',
                '',
            ]
        for place in subindices:
            entry = held[index, place]
            lines += [
                f'[{index:04X}]' if single else f'[{index:04X}sub{place:X}]',
                f'ParameterName=o{index:X}_{place}',
                'ObjectType=0x7',
                f'DataType=0x{ {1: 5, 2: 6, 4: 7}[entry.size]:04X}',
                f'AccessType={entry.access}',
                f'DefaultValue={entry.value}',
                'PDOMapping=0',
                *limits.get(f'o{index:X}_{place:02X}', ()),
                '',
            ]
    names = [
        f'{number}=0x{index:04X}' for number, index in enumerate(sorted({i for i, _ in held}), 1)
    ]
    lines += ['[OptionalObjects]', f'SupportedObjects={len(names)}', *names]
    path = tmp_path / 'turn.eds'
    path.write_text('\n'.join(lines))
    return str(path)


def test_an_eds_says_before_anything_is_sent_what_cannot_be_set(channel, run, tmp_path):
    held = objects_of(2, o6001=Held(65536, access='ro'), o1017=Held(0, 2))
    path = eds(tmp_path, held, o1017_00=('LowLimit=200', 'HighLimit=5000'))
    with can.Bus(interface='virtual', channel=channel) as other:
        code, text = run('--eds', path, '--write')
        assert other.recv(0.0) is None
    assert code == 1
    assert f'joint_1b, node 2: Turn & Co T-14, by {path}:\n' in text
    assert '  0x1800:02 TPDO1 transmission type: rw, 1 bytes; wanted 1\n' in text
    assert '  0x1801:01 TPDO2 off: not in the EDS; wanted 0x80000000\n' in text
    assert (
        'joint_1b: 0x6001:00 units per turn: ro, 65536, wanted 16384; set '
        'encoders.counts_per_turn: 65536\n' in text
    )
    assert (
        'joint_1b: 0x1017:00 heartbeat time, ms: takes rw, 2 bytes, 200 .. 5000, wanted 100'
        in text
    )
    assert text.endswith(f'{path}: 2 objects cannot have the wanted value; nothing was sent\n')


def test_an_eds_gives_the_types_of_a_device(channel, run, tmp_path):
    """Its operating parameters have four bytes, and its answers no size."""
    held = objects_of(2, o6000=Held(0, 4), o1800_02=Held(254, 1))
    with foreign_bus(channel, (2, held)) as (encoder,):
        server = encoder.node.sdo
        send = server.send_response

        def without_size(response):
            if response[0] & 0xE3 == 0x43:
                response[0] = 0x42
            send(response)

        server.send_response = without_size
        assert run('--write')[0] == 1
        code, text = run('--write', '--eds', eds(tmp_path, held))
        assert code == 0, text
        assert encoder.value(0x6000) == 4


@pytest.mark.parametrize(
    ('name', 'content', 'words'),
    [
        ('none.eds', None, 'No such file'),
        ('device.txt', '', 'not an EDS file; expected .eds or .dcf'),
        ('broken.eds', 'no section', 'not a readable EDS file (File contains no section headers'),
        pytest.param('long.eds', 'x' * 9999, 'not a readable EDS file (File contains', id='long'),
        ('empty.eds', '', 'no object in it; expected an EDS file'),
    ],
)
def test_a_file_that_is_no_eds_is_one_line(run, tmp_path, name, content, words):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    code, text = run('--eds', str(path))
    assert code == 1
    assert words in text
    assert str(path) in text
    assert text.count('\n') == 1
    assert len(text) < 500
