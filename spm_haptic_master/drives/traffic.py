# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Worst-case load of the drives' bus, alone or with the encoders on it."""

from __future__ import annotations

from spm_haptic_master.drives.plan import Plan, STATUS_LENGTH, torque_frames
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_load import cycle_bits, frame_bits, Traffic
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.exceptions import SettingError

# Largest share of a bus with drives (unit 1): torque frames wait for all that has a smaller
# identifier, and emergencies and SDO come beside them.
MAXIMUM_LOAD = 0.7


def traffic_of(plan: Plan) -> list[Traffic]:
    """Return the frames that the drives and this master send."""
    count = len(plan.drives)
    sample = torque_frames(plan, [0] * count, [0] * count, False)
    found = [Traffic('torque', sum(frame_bits(len(data), False) for _, data in sample),
                     1.0 / plan.period),
             Traffic('status', count * frame_bits(STATUS_LENGTH, False),
                     1.0 / plan.status_period),
             Traffic('heartbeats', (count + 1) * frame_bits(canopen.HEARTBEAT_LENGTH, False),
                     1.0 / plan.heartbeat)]
    if plan.combined:
        found.append(Traffic('controlwords', count * frame_bits(2, False), 1.0 / plan.heartbeat))
    return found


def encoder_traffic(layouts: tuple[EncoderLayout, ...], sync: bool, rate: float) -> Traffic:
    """Return the frames of the encoders, and SYNC, for a bus that the drives share."""
    return Traffic('SYNC and encoders' if sync else 'encoders', cycle_bits(layouts, sync), rate)


def check_traffic(plan: Plan, bitrate: int, encoders: Traffic | None = None) -> None:
    """
    Refuse a bus that cannot carry the drives' frames, with the encoders' where they share it.

    At a bit rate of 0 nothing is checked. SettingError has the arithmetic.
    """
    if not bitrate:
        return
    parts = [*([encoders] if encoders else ()), *traffic_of(plan)]
    load = sum(each.bits * each.rate for each in parts) / bitrate
    if load <= MAXIMUM_LOAD:
        return
    shown = ' + '.join(f'{each.name} {each.bits} bits x {each.rate:g} Hz' for each in parts)
    remedy = ([] if encoders is None else ['a second bus (drives.channel)']) \
        + ([] if plan.combined else ['one frame with all torques (drives.combined)']) \
        + ['a lower rate']
    raise SettingError(
        'drives.bitrate', bitrate, f'{" or ".join(remedy)}: {shown} = {100.0 * load:.0f} % bus '
        f'load, beyond {100.0 * MAXIMUM_LOAD:.0f} %')
