# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Makes the source of joint samples from its settings: a CAN bus, a recording or a simulation.

It is the only place that knows all three.
"""

from __future__ import annotations

from pathlib import Path

from spm_haptic_master.encoders.can_source import CanSource
from spm_haptic_master.encoders.decoder_factory import check_bus_load, make_decoder, make_harmonics
from spm_haptic_master.encoders.replay_source import ReplaySource
from spm_haptic_master.encoders.single_axis import make_axes
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.sim_source import SimSource

# Time without a heartbeat of simulated axes, which have none (s).
HEARTBEAT_TIMEOUT = 1.0


def make_source(
    name: str,
    values: Values,
    drives: tuple[int, ...] = (),
) -> EncoderSource:
    """
    Make a source of joint samples.

    Parameters
    ----------
    name : str
        'sim', 'replay' or 'can'.
    values : Values
        Checked settings.
    drives : tuple of int
        Node ids of the drives on the bus of the encoders.

    Returns
    -------
    EncoderSource
        The source; `close` releases it.

    Raises
    ------
    SettingError
        Two settings contradict each other.
    ReplayError
        The recording cannot be opened.

    """
    if name == 'sim':
        return SimSource(
            motion=make_motion(values),
            rate=values['rate'],
            counts_per_turn=values['encoders.counts_per_turn'],
            harmonics=make_harmonics(values),
            axes=make_axes(values, HEARTBEAT_TIMEOUT),
        )
    if name == 'replay':
        return make_replay(values)
    return _make_can(values, drives)


def source_text(name: str, values: Values) -> str:
    """Return the source in words, such as 'sim', 'replay: session.log' or 'can: can0'."""
    if name == 'replay':
        return f'replay: {Path(values["replay.path"]).name}'
    if name == 'can':
        interface = values['can.interface']
        return f'can: {"" if interface == "socketcan" else f"{interface} "}{values["can.channel"]}'
    return name


def make_replay(values: Values) -> ReplaySource:
    """
    Make the replay of a recording.

    Parameters
    ----------
    values : Values
        Checked settings.

    Raises
    ------
    SettingError, ReplayError
        As of `make_source`.

    """
    return ReplaySource(
        path=values['replay.path'],
        rate=values['replay.rate'],
        loop=values['replay.loop'],
        decoder=make_decoder(values),
        channel=values['can.channel'],
    )


def _make_can(values: Values, drives: tuple[int, ...]) -> CanSource:
    """Make the source of a CAN bus; SettingError: rate, time-out or SYNC do not fit together."""
    decoder = make_decoder(values, drives)
    rate = values['rate']
    if values['can.bitrate']:
        check_bus_load(
            layouts=(*decoder.layouts, *(axis.layout for axis in decoder.axes)),
            sync=decoder.sync_id is not None,
            rate=rate,
            bitrate=values['can.bitrate'],
        )
    if values['can.timeout'] * rate < 2.0:
        raise SettingError(
            name='can.timeout',
            value=values['can.timeout'],
            expected=f'at least two periods, {2.0 / rate:g} s at {rate:g} Hz',
        )
    produce = None
    if values['can.sync'] == 'produce':
        if decoder.sync_id is None:
            raise SettingError(
                name='can.sync',
                value='produce',
                expected='consume where encoders.sync_id is 0 (the bus has no SYNC)',
            )
        produce = 1.0 / rate
    return CanSource(
        interface=values['can.interface'],
        channel=values['can.channel'],
        bitrate=values['can.bitrate'],
        decoder=decoder,
        timeout=values['can.timeout'],
        produce=produce,
        stop_nodes=values['can.nmt_stop'],
    )
