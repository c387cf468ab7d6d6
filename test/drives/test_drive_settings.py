# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the drives: what is refused, and the arithmetic of the bus load."""

from drive_rig import drive_values, make_test_plan
from encoder_frames import LAYOUTS
import pytest
from spm_haptic_master.drives.settings import make_drives
from spm_haptic_master.drives.traffic import check_traffic, encoder_traffic
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.drives import DRIVE_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.parameters.shared import RATE_SETTING

MBIT = 1_000_000


def test_without_a_channel_there_are_no_drives():
    assert make_drives(complete((*DRIVE_SETTINGS, RATE_SETTING), {})) is None


def test_nothing_is_opened_before_the_first_step():
    drives = make_drives(drive_values())
    assert drives.motors == 3
    drives.close()


@pytest.mark.parametrize(('given', 'name', 'words'), [
    ({'drives__rated_torque': [0.0]}, 'drives.rated_torque', 'rated torque, N m, above 0'),
    ({'drives__rated_torque': [0.1, 0.2]}, 'drives.rated_torque', 'one value, or 3'),
    ({'drives__node_id': [11, 11, 12]}, 'drives.node_id', 'different node ids'),
    ({'drives__node_id': [11, 12, 126]}, 'drives.node_id', 'drives.master_id'),
    ({'drives__node_id': [1, 2, 3, 4, 5]}, 'drives.node_id', 'at most 4 drives'),
    ({'drives__torque_limit': 20.0}, 'drives.torque_limit', 'it is 40000'),
    ({'drives__event_timer': 0.0105}, 'drives.event_timer', 'whole milliseconds'),
    ({'drives__event_timer': 0.002}, 'drives.event_timer', '3 samples at rate 1000 Hz'),
    ({'drives__status_timeout': 0.004}, 'drives.status_timeout', 'at least 0.008 s'),
    ({'drives__heartbeat_timeout': 0.03}, 'drives.heartbeat_timeout', 'at least 0.04 s'),
    ({'drives__interface': 'nothing'}, 'drives.interface', 'one of '),
    ({'drives__bitrate': 250_000}, 'drives.bitrate', '% bus load'),
])
def test_settings_that_contradict_each_other_are_refused(given, name, words):
    with pytest.raises(SettingError) as caught:
        make_drives(drive_values(**given))
    assert caught.value.name == name
    assert words in str(caught.value)


def test_torques_are_per_mille_of_the_rated_torque_within_the_cap():
    plan = make_test_plan(drives__rated_torque=[0.1], drives__gear=[4.0],
                          drives__direction=[-1], drives__torque_limit=0.3)
    drive = plan.drives[0]
    assert drive.per_mille(0.2) == -500
    assert [drive.per_mille(torque) for torque in (9.0, -9.0)] == [-750, 750]


def test_the_drives_need_a_bus_of_their_own_or_one_frame():
    """SYNC, four encoders, three torque and three status frames at 1 kHz; by the standard."""
    plan = make_test_plan()
    encoders = encoder_traffic(LAYOUTS, True, 1000.0)
    # A data frame of n bytes: 47 + 8 n bits, and a stuff bit for every four of 34 + 8 n - 1.
    assert encoders.bits == 55 + 4 * 95
    check_traffic(plan, MBIT)
    with pytest.raises(SettingError) as caught:
        check_traffic(plan, MBIT, encoders)
    assert str(caught.value) == (
        "parameter 'drives.bitrate' is 1000000; expected a second bus (drives.channel) or one "
        'frame with all torques (drives.combined) or a lower rate: SYNC and encoders 435 bits x '
        '1000 Hz + torque 285 bits x 1000 Hz + status 315 bits x 250 Hz + heartbeats 260 bits x '
        '50 Hz = 81 % bus load, beyond 70 %')
    check_traffic(make_test_plan(drives__combined=True), MBIT, encoders)


def test_at_an_unknown_bit_rate_nothing_is_refused():
    check_traffic(make_test_plan(rate=10000.0), 0, encoder_traffic(LAYOUTS, True, 10000.0))
