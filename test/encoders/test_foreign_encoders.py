# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The driver on a bus of encoders that another stack simulates."""

from contextlib import closing
import math
import time

import can
from encoder_frames import values
from foreign_nodes import BARE, foreign_bus, objects_of
import pytest
from spm_haptic_master.encoders import can_bus, can_source
from spm_haptic_master.encoders.can_bus import ReceiveClock
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.simulation.source_factory import make_source

# Longest wait for what has to happen, on a busy machine, s.
PATIENCE = 10.0
NODES = (1, 2, 3, 4)


@pytest.fixture
def driver(channel):
    """Make a driver on the bus, which makes SYNC."""

    def make(drives=(), **overrides):
        settings = {'rate': 50.0, 'can__timeout': 0.5, 'can__heartbeat_timeout': 2.0} | overrides
        return closing(
            make_source(
                'can',
                values(
                    can__interface='virtual',
                    can__channel=channel,
                    can__sync='produce',
                    **settings,
                ),
                drives,
            )
        )

    return make


def read_until(source, condition, patience=PATIENCE):
    """Read until a condition holds; return the number of sets meanwhile."""
    sets = 0
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, (source.fault, source.caution)
        sets += source.read(0.02) is not None
    return sets


def sets_for(source, seconds):
    """Return how many sets come in some seconds."""
    end = time.monotonic() + seconds
    return sum(source.read(0.02) is not None for _ in iter(lambda: time.monotonic() < end, False))


def test_E1_one_error_that_goes_does_not_end_another(channel, driver):
    """EMCY 00xxh with what is left in the error register (CiA 301, 7.2.7.1)."""
    with foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as nodes, driver() as source:
        emcy = nodes[3].node.emcy
        read_until(source, lambda: source.fault is None and source.read(0.1))
        for code, register in ((0x5000, 0x10), (0x3100, 0x14)):
            emcy.send(code, register)
            read_until(source, lambda code=code: f'0x{code:04X}' in str(source.caution))
        emcy.send(0x0000, 0x10)
        words = 'joint_3a: EMCY 0x0000 error reset, error register 0x10: another error remains'
        read_until(source, lambda: source.caution == words)
        sets_for(source, 0.2)
        assert sets_for(source, 0.3) == 0
        read_until(source, lambda: source.fault == words)
        emcy.send(0x0000, 0)
        read_until(source, lambda: source.fault is None and source.caution is None)
        read_until(source, lambda: source.read(0.1))


@pytest.mark.parametrize('beats', [True, False])
def test_E2_an_error_from_before_the_start_is_read(channel, driver, beats):
    """Also of a node without heartbeat, which booted before anybody listened."""
    changes = {} if beats else {'o1017': None}
    wrong = objects_of(4, **changes)
    with (
        foreign_bus(
            channel, *((n, objects_of(n, **changes)) for n in NODES[:3]), (4, wrong)
        ) as nodes,
        driver() as source,
    ):
        nodes[3].put(0x10, 0x1001)
        words = 'joint_3a: error register 0x10 (communication)'
        read_until(source, lambda: source.fault == words)
        sets_for(source, 0.2)
        assert sets_for(source, 0.3) == 0
        # It went while EMCY was lost.
        nodes[3].put(0, 0x1001)
        read_until(source, lambda: source.fault is None and source.caution is None)
        read_until(source, lambda: source.read(0.1))


@pytest.mark.parametrize('sends_emcy', [True, False])
def test_E3_a_sync_is_left_out_once_where_nodes_supervise_it(channel, driver, sends_emcy):
    with foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as nodes, driver() as source:
        supervised = nodes[1]
        left = []

        def supervise():
            skipped = source.statistics()['SYNC left out'] > len(left)
            if supervised.operational and skipped:
                left.append(time.monotonic())
                supervised.leave()
                if sends_emcy:
                    supervised.node.emcy.send(0x8100, 0x11)
            elif not supervised.operational and sends_emcy:
                supervised.node.emcy.send(0, 0)

        answer = supervised.on_sync
        first = nodes[0].on_sync
        supervised.on_sync = lambda: (supervise(), answer())
        # A lost answer is a reason to leave a SYNC out.
        nodes[0].on_sync = lambda: nodes[1].syncs % 20 and first()
        read_until(source, lambda: left)
        sentence = 'it left OPERATIONAL when this driver left a SYNC out, as it supervises SYNC'
        read_until(source, lambda: sentence in str(source.fault) + str(source.caution))
        assert 'set its 0x1006 to 0 (can_setup)' in str(source.fault) + str(source.caution)
        read_until(source, lambda: source.fault is None)
        # It would be left out each second.
        assert sets_for(source, 2.5 * can_source.SKIP_PERIOD) > 20
        assert source.statistics()['SYNC left out'] == len(left) == 1


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('loss', ['emergency', 'heartbeat', 'state'])
@pytest.mark.parametrize('stops', [True, False])
def test_E5_one_rule_for_four_five_and_six(channel, driver, sensors, loss, stops):
    """An encoder with an error, or without heartbeat, is not believed; or all are reported."""
    nodes = range(1, sensors + 1)
    options = {'can__heartbeat_timeout': 0.6, 'sensors': sensors}
    with (
        foreign_bus(channel, *((n, objects_of(n)) for n in nodes)) as encoders,
        driver(**options, **({} if stops else {'can__emcy_stops': False})) as source,
    ):
        read_until(source, lambda: source.read(0.1))
        read_until(source, lambda: source.caution is None)
        last = encoders[3]
        if loss == 'emergency':
            last.node.emcy.send(0x5000, 1)
        elif loss == 'heartbeat':
            last.node.nmt.stop_heartbeat()
        else:
            # It says so, and its frames come.
            last.node.nmt.stop_heartbeat()
            last.node.nmt.network.send_message(0x704, [0x7F])
        words = {
            'emergency': 'EMCY 0x5000 device hardware',
            'heartbeat': 'heartbeat lost',
            'state': 'pre-operational',
        }[loss]
        if loss == 'state' and not stops:
            words = 'heartbeat lost'
        read_until(source, lambda: f'joint_3a: {words}' in str(source.fault or source.caution))
        sets_for(source, 0.2)
        if sensors == 4 and stops:
            assert sets_for(source, 0.3) == 0
            return
        angles = []
        read_until(source, lambda: _take_angles(source, angles) >= 5)
        assert [math.isnan(each[3]) for each in angles] == [stops] * len(angles)


def _take_angles(source, angles):
    """Add the angles of the next set, if one comes; return how many there are."""
    sample = source.read(0.02)
    if sample is not None:
        angles.append(sample.angles)
    return len(angles)


def test_E15_a_clock_that_wraps_gets_a_new_offset_at_once():
    """The microseconds of gs_usb have 32 bits: 71.6 minutes."""
    clock = ReceiveClock()
    wrap = 2**32 * 1e-6
    began = 1.76e9
    for number in range(2000):
        at = wrap - 1.0 + number * 1e-3
        arrived = began + number * 1e-3 + 2e-4
        assert clock.epoch(at % wrap, arrived) == pytest.approx(arrived, abs=1e-5)


@pytest.mark.parametrize(
    ('file', 'variable', 'words'),
    [
        ('interface = virtual\n', None, 'contains no section headers'),
        pytest.param('x' * 9999, None, 'contains no section headers', id='long'),
        ('[default]\nport = 1\nport = 2\n', None, "option 'port' in section 'default' already"),
        (b'\xff\xfe\x00', None, "can't decode byte"),
        (None, '[1, 2]', "environment variable CAN_CONFIG is '[1, 2]'; expected a JSON object"),
        (None, '{', "environment variable CAN_CONFIG is '{'"),
        pytest.param(None, '[' * 9999, "CAN_CONFIG is '[[[", id='nested'),
    ],
)
def test_E16_a_broken_configuration_of_python_can_is_named(
    tmp_path, monkeypatch, file, variable, words
):
    path = tmp_path / '.canrc'
    monkeypatch.setattr(can.util, 'CONFIG_FILES', [str(path)])
    if file is not None:
        path.write_bytes(file if isinstance(file, bytes) else file.encode())
        words = f'{path}: not a configuration file of python-can ('
    if variable is not None:
        monkeypatch.setenv('CAN_CONFIG', variable)
    with pytest.raises(InputError) as error:
        can_bus.check_interface('virtual')
    assert words in str(error.value)
    assert '\n' not in str(error.value)
    assert len(str(error.value)) < 500
    with pytest.raises(InputError):
        make_source('can', values(can__interface='virtual', can__channel='can7'))


def test_the_configured_drives_are_no_foreign_nodes(channel, driver):
    """Item 7: they are on the same bus, and in drives.node_id."""
    with (
        foreign_bus(channel, *((n, objects_of(n)) for n in (1, 2, 3, 11, 12, 44))),
        driver(drives=(11, 12, 13, 126)) as source,
    ):
        read_until(source, lambda: 'not in encoders.node_id' in str(source.fault))
        assert 'not in encoders.node_id: 44 (' in source.fault


def test_encoders_without_any_optional_object_are_read_without_a_caution(channel, driver):
    """No heartbeat, no scaling, no storing, no SYNC objects: nothing of that is needed."""
    with (
        foreign_bus(channel, *((n, objects_of(n, **BARE)) for n in NODES)),
        driver() as source,
    ):
        read_until(source, lambda: source.read(0.1))
        assert sets_for(source, 1.0) > 10
        assert source.fault is None
        assert source.caution is None
        assert source.statistics()['joint_1a error register'] == '0x00'
        read_until(source, lambda: source.statistics()['joint_1a serial number'] == 'none')


def test_the_raw_counts_and_the_serial_number_of_each_encoder_are_reported(channel, driver):
    """The counts are those that were sent; a device that replaces another one is asked again."""
    with foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as nodes, driver() as source:
        names = [f'{joint} serial number' for joint in JOINT_NAMES]
        read_until(
            source,
            lambda: (
                [source.statistics()[name] for name in names] == ['1001', '1002', '1003', '1004']
            ),
        )
        counts = source.statistics()['joint_1c counts']
        assert counts == nodes[2].counts
        nodes[2].put(77, 0x1018, 4)
        nodes[2].stored = {(0x1018, 4): (77).to_bytes(4, 'little')}
        nodes[2].boot()
        read_until(source, lambda: source.statistics()['joint_1c serial number'] == '77')
