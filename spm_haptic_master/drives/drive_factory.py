# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The drives that checked settings describe: with the passed check that they need, or without.

Only `force_check`, which makes that check, commands drives without one.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from spm_haptic_master.drives.drives import Drives
from spm_haptic_master.drives.passed_check import PassedCheck, read_check
from spm_haptic_master.drives.plan import make_plan, Plan
from spm_haptic_master.drives.shared_bus import check_load
from spm_haptic_master.encoders import can_bus
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.setting import Values


def make_drives(values: Values) -> Drives | None:
    """
    Return the drives by checked settings; the first step opens their bus.

    Parameters
    ----------
    values : Values
        Checked values of DRIVE_SETTINGS, and `rate`.

    Returns
    -------
    Drives or None
        None without `drives.channel`.

    Raises
    ------
    SettingError
        Settings contradict each other, or the drives have not passed a force_check.
    InputError
        The file of the check cannot be read.

    """
    plan = _checked_plan(values)
    if plan is None:
        return None
    return _make(values, plan, _check_of(values, plan))


def make_unchecked_drives(values: Values) -> Drives | None:
    """
    Return the drives as `make_drives` does, for the force_check that is still due.

    Parameters
    ----------
    values : Values
        Checked values of DRIVE_SETTINGS, and `rate`.

    Returns
    -------
    Drives or None
        None without `drives.channel`.

    Raises
    ------
    SettingError
        Settings contradict each other, or the bus cannot carry the frames.

    """
    plan = _checked_plan(values)
    if plan is None:
        return None
    return _make(values, plan, None)


def _checked_plan(values: Values) -> Plan | None:
    """Return the plan of drives whose bus can carry their frames; None without a channel."""
    if not values['drives.channel']:
        return None
    can_bus.check_interface(values['drives.interface'], 'drives.interface')
    plan = make_plan(values)
    check_load(plan, values['drives.bitrate'])
    return plan


def _make(
    values: Values,
    plan: Plan,
    check: PassedCheck | None,
) -> Drives:
    """Return the drives of a plan, which open their bus in the first step."""
    interface = values['drives.interface']
    channel = values['drives.channel']
    return Drives(
        plan=plan,
        open_bus=partial(can_bus.open_bus, interface, channel, values['drives.bitrate']),
        name=can_bus.bus_name(interface, channel),
        check=check,
    )


def _check_of(values: Values, plan: Plan) -> PassedCheck:
    """
    Return the passed check of the configured drives.

    Raises
    ------
    SettingError
        No file is given, or it is that of other drives.
    InputError
        The file cannot be read.

    """
    path = values['drives.check_file']
    if not path:
        raise SettingError(
            name='drives.check_file',
            value=path,
            expected=(
                'the file that force_check --record --output has written for these drives: no '
                'torque without a passed check'
            ),
        )
    check = read_check(Path(path))
    difference = check.difference(plan.drives)
    if difference is not None:
        raise SettingError(
            name='drives.check_file',
            value=path,
            expected=f'a check of these drives ({difference})',
        )
    return check
