# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lines for rig.yaml: a scan in, parameters that describe its bus out."""

from dataclasses import replace

from encoder_frames import LAYOUTS, T0
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.rig_lines import rig_lines, round_rate
from spm_haptic_master.encoders.scan_problems import Expected
from spm_haptic_master.parameters.resolver import read_parameters

DEFAULT = Expected(LAYOUTS, (1, 2, 3, 4), 1000.0)


def scanned(nodes, base=0x180, length=4, rate=200.0, master=True, kinds=None):
    """Scan half a second of a bus whose nodes answer SYNC."""
    scan = BusScan()
    for node, kind in (kinds or {}).items():
        scan.feed(canopen.sdo_answer(node, *canopen.DEVICE_TYPE, kind))
    for number in range(int(0.5 * rate)):
        frames = [canopen.frame(0x80)] if master else []
        if not master:
            scan.sent_sync(number / rate)
        for frame in [*frames, *(canopen.frame(base + node, bytes(length)) for node in nodes)]:
            frame.timestamp = T0 + number / rate
            scan.feed(frame)
    return scan


def parameters(tmp_path, scan, expected=DEFAULT, known=False, bitrate=None, channel='can0'):
    path = tmp_path / 'rig.yaml'
    lines = rig_lines(scan, expected, known, 'socketcan', channel, bitrate)
    path.write_text('\n'.join(lines) + '\n')
    return read_parameters(path)


def test_odd_nodes_and_the_rate_of_the_bus(tmp_path):
    assert parameters(tmp_path, scanned((44, 3, 90, 17))) == {
        'source': 'can', 'rate': 200.0, 'can.interface': 'socketcan', 'can.channel': 'can0',
        'can.sync': 'consume', 'encoders.node_id': [3, 17, 44, 90],
        'encoders.id': [0x183, 0x191, 0x1AC, 0x1DA]}


def test_without_a_master_the_driver_makes_sync(tmp_path):
    found = parameters(tmp_path, scanned((5, 6, 7, 8), rate=250.0, master=False))
    assert (found['can.sync'], found['rate']) == ('produce', 1000.0)


def test_other_tpdos_lengths_and_more_sensors(tmp_path):
    found = parameters(tmp_path, scanned((1, 2, 3, 5, 6), base=0x280, length=8), bitrate=500000)
    assert found['sensors'] == 5
    assert found['encoders.id'] == [0x281, 0x282, 0x283, 0x285, 0x286]
    assert found['encoders.data_length'] == [8] * 5
    assert found['can.bitrate'] == 500000


def test_a_channel_that_looks_like_a_number_stays_a_text(tmp_path):
    assert parameters(tmp_path, scanned((1, 2, 3, 4)), channel='0')['can.channel'] == '0'


def test_joints_that_are_as_configured_keep_their_place(tmp_path):
    layouts = tuple(replace(layout, can_id=0x180 + node)
                    for layout, node in zip(LAYOUTS, (4, 3, 2, 1), strict=True))
    expected = Expected(layouts, (4, 3, 2, 1), 1000.0)
    scan = scanned((1, 2, 4, 9))
    assert parameters(tmp_path, scan, expected, known=True)['encoders.node_id'] == [4, 9, 2, 1]
    # Defaults are no knowledge of the rig.
    assert parameters(tmp_path, scan, expected)['encoders.node_id'] == [1, 2, 4, 9]


def test_a_drive_is_no_encoder_and_a_silent_encoder_has_its_predefined_identifier(tmp_path):
    scan = scanned((1, 2, 3, 7), kinds={7: 0x00020192, 8: 0x00010196})
    assert parameters(tmp_path, scan)['encoders.id'] == [0x181, 0x182, 0x183, 0x188]


@pytest.mark.parametrize(('nodes', 'started', 'words'), [
    ((), False, '# none: 0 encoders heard, expected 4 to 6; can_scan --start starts'),
    ((1, 2, 3), True, '# none: 3 encoders heard, expected 4 to 6'),
    (range(1, 8), True, '# none: 7 encoders heard, expected 4 to 6')])
def test_too_few_or_too_many_are_no_rig(nodes, started, words):
    scan = scanned(nodes)
    scan.started |= {1} if started else set()
    (line,) = rig_lines(scan, DEFAULT, False, 'socketcan', 'can0', None)
    assert line.startswith(words)
    assert ('--start' in line) != started


@pytest.mark.parametrize(('measured', 'expected'), [
    (999.6, 1000.0), (1003.2, 1000.0), (200.31, 200.0), (333.1, 333.3), (66.71, 66.67),
    (25.02, 25.0), (888.9, 888.9), (4000.0, 4000.0)])
def test_a_measured_rate_is_that_of_a_round_period(measured, expected):
    assert round_rate(measured) == expected
