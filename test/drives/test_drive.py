# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One drive by its frames: torque against command, with status frames that are late."""

from drive_rig import make_test_plan, MS
import pytest
from spm_haptic_master.drives.drive import Drive

STATUS_PERIOD = 4


def follow(commands, late, share=1.0):
    """
    Return what is wrong with a drive that makes its commands, with late status frames.

    Parameters
    ----------
    commands : list of int
        Command of each ms, per mille.
    late : int
        Age of the torque in a status frame, ms.
    share : float
        Share of the command that it makes.

    """
    plan = make_test_plan()
    drive = Drive(plan.drives[0], plan)
    _, on_status = drive.handlers()[0x18B]
    found = []
    for number, command in enumerate(commands):
        drive.command(command)
        now = number * MS
        if number % STATUS_PERIOD == 0:
            made = round(share * commands[max(0, number - late)])
            on_status(bytearray(b'\x37\x02' + made.to_bytes(2, 'little', signed=True) + b'\x0a'),
                      now)
        found.append(drive.trouble(now))
    return found


@pytest.mark.parametrize('late', [0, 1, 4, 7])
def test_a_ramp_of_10_newton_metres_a_second_is_followed_as_late_as_two_periods(late):
    """With 0.5 N m rated 10 N m/s are 20 per mille a ms, for as long as the limit allows."""
    ramp = [20 * number for number in range(-50, 50)]
    assert not any(follow(ramp * 3, late))


def test_a_torque_that_is_off_is_found_on_a_ramp_too():
    ramp = [400 + 5 * number for number in range(100)]
    assert any(follow(ramp, 4, 0.6))
