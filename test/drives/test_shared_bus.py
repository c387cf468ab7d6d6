# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drives on the bus of the encoders: what does not fit, and what a scan says of them."""

import signal
import threading
import uuid

import can
from drive_rig import drive_values
from encoder_frames import LAYOUTS, values
import pytest
from spm_haptic_master.drives.settings import check_shared_bus, make_plan
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.simulated_bus import BusRunner, SimulatedBus
from spm_haptic_master.simulation.simulated_drives import DriveLoop, SimulatedDrives
from spm_haptic_master.tools import can_scan

MBIT = 1_000_000


def check(encoders=(), **drives):
    """Check drives on the bus of the encoders."""
    check_shared_bus(
        drive_values(drives__interface='virtual', drives__channel='one', **drives),
        values(can__interface='virtual', can__channel='one', can__bitrate=MBIT,
               **dict(encoders)))


def test_one_frame_for_all_torques_fits_beside_the_encoders():
    check(drives__combined=True)


@pytest.mark.parametrize(('given', 'name', 'words'), [
    ({}, 'drives.bitrate', '81 % bus load, beyond 70 %'),
    ({'drives__combined': True, 'drives__node_id': [4, 5, 6]}, 'drives.node_id',
     '4 is in encoders.node_id'),
    ({'drives__combined': True, 'drives__master_id': 2}, 'drives.node_id',
     '2 is in encoders.node_id'),
    ({'drives__combined': True, 'encoders': {'encoders__id': [0x18C, 2, 3, 4],
                                             'can__protocol': 'raw'}}, 'encoders.id',
     '0x18C of joint_1a'),
])
def test_what_does_not_fit_is_refused(given, name, words):
    with pytest.raises(SettingError) as caught:
        check(**given)
    assert caught.value.name == name
    assert words in str(caught.value)


def test_a_second_bus_needs_no_such_check():
    check_shared_bus(drive_values(drives__channel='two', drives__bitrate=MBIT),
                     values(can__interface='virtual', can__channel='one', can__bitrate=MBIT))


@pytest.fixture
def scan(capsys):
    """Scan a virtual bus with encoders and some drives; give the function for it."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def run(simulated):
        channel = uuid.uuid4().hex
        plan = make_plan(drive_values(drives__node_id=[11, 12, 13][:simulated]))
        end = threading.Event()
        with can.Bus(interface='virtual', channel=channel) as bus, \
                can.Bus(interface='virtual', channel=channel) as second:
            runner = BusRunner(bus, SimulatedBus(
                LAYOUTS, (1, 2, 3, 4), make_motion(values('sim')), (), 0.1, 1),
                0x80, None)

            def loop():
                runner.boot()
                while not end.is_set():
                    runner.step()

            thread = threading.Thread(target=loop)
            thread.start()
            drives = DriveLoop(second, SimulatedDrives(plan))
            try:
                code = can_scan.main([
                    'can_scan', '--seconds', '1', '--start', '-p', 'can.interface:=virtual', '-p',
                    f'can.channel:={channel}', '-p', 'rate:=100.0', '-p',
                    'drives.interface:=virtual', '-p', f"drives.channel:='{channel}'", '-p',
                    'drives.rated_torque:=[0.5]', '-p', 'drives.event_timer:=0.1'])
            finally:
                end.set()
                thread.join()
                drives.close()
        out, err = capsys.readouterr()
        return code, out + err

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


def test_a_scan_names_the_drives_and_finds_nothing_unexpected(scan):
    _, out = scan(3)
    assert 'status of the drive of joint_1b (node 12)' in out
    assert 'device type 0x00020192 (CiA 402, drive)' in out
    assert 'unexpected' not in out
    assert 'not heard' not in out


def test_a_scan_names_a_drive_that_is_missing(scan):
    code, out = scan(2)
    assert code == 1
    assert 'drive of joint_1c (node 13): not heard' in out
