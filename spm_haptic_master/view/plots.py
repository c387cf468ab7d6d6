# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The plots of a device: their quantities, colours and named limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from spm_haptic_master.description import colours
from spm_haptic_master.description.colours import Ink
from spm_haptic_master.view.names import SENSOR_NAMES


@dataclass(frozen=True, slots=True)
class Series:
    """
    A quantity of a plot.

    Attributes
    ----------
    name : str
        Name in the plot's legend; empty if the plot has one quantity.
    ink : Ink
        Colour of the line on a white page and on a dark one.
    is_dashed : bool
        Whether the line is dashed.

    """

    name: str
    ink: Ink
    is_dashed: bool = False


@dataclass(frozen=True, slots=True)
class Limit:
    """
    A limit with its name at its line.

    Attributes
    ----------
    value : float
        Value in the unit of the plot.
    name : str
        Words at the line.
    ink : Ink
        Colour of line and words.

    """

    value: float
    name: str
    ink: Ink


@dataclass(frozen=True, slots=True)
class Plot:
    """
    A plot, at the top of the panel or below the knobs.

    Attributes
    ----------
    key : str
        Name of the plot's values in a sample.
    title : str
        Quantity and unit.
    series : sequence of Series
        Quantities, in the order of the values in a sample.
    limits : sequence of Limit
        Limits that are drawn as lines.
    has_zero : bool
        Whether 0 is always within the axis.
    on_top : bool
        Whether the plot is at the top of the panel.

    """

    key: str
    title: str
    series: Sequence[Series]
    limits: Sequence[Limit] = ()
    has_zero: bool = True
    on_top: bool = False


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the dexterity and of the protection level (deg); nan: not known."""

    warn_below: float
    error_below: float
    alert: float

    def of_dexterity(self) -> list[Limit]:
        """Return the known limits of the dexterity."""
        return _known(
            Limit(
                value=self.warn_below,
                name='warning',
                ink=colours.WARNING_LIMIT,
            ),
            Limit(
                value=self.error_below,
                name='error',
                ink=colours.ERROR_LIMIT,
            ),
        )

    def of_level(self) -> list[Limit]:
        """Return the limit of the protection level, if it is known."""
        return _known(
            Limit(
                value=self.alert,
                name='alert',
                ink=colours.ERROR_LIMIT,
            )
        )


def plots(sensors: int, limits: Limits) -> list[Plot]:
    """
    Return the plots of a device with a number of sensors.

    Parameters
    ----------
    sensors : int
        Number of sensors, 4 to 6.
    limits : Limits
        Limits that the plots show.

    Returns
    -------
    list of Plot
        Always the same plots: a quantity without values is an empty one.

    """
    three = colours.THREE_ENCODERS
    every = colours.ALL_ENCODERS
    return [
        Plot(
            key='ghost',
            title='error of three encoders alone, deg',
            series=[Series('', three)],
            on_top=True,
        ),
        Plot(
            key='dexterity',
            title='dexterity',
            series=[Series('three', three, is_dashed=True), Series(f'all {sensors}', every)],
            limits=limits.of_dexterity(),
            on_top=True,
        ),
        Plot(
            key='level',
            title='protection level, deg',
            series=[Series('', every)],
            limits=limits.of_level(),
        ),
        Plot(
            key='angles',
            title='joint angles, deg',
            series=_angles(sensors),
            has_zero=False,
        ),
        Plot(
            key='parity',
            title='parity, sigma',
            series=[Series('', every)],
            has_zero=False,
        ),
        Plot(
            key='torque',
            title='torque on the handle, N m',
            series=[
                Series('commanded', colours.COMMANDED, is_dashed=True),
                Series('rendered', colours.RENDERED),
            ],
        ),
        Plot(
            key='latency',
            title='latency, us',
            series=[Series('p50', every), Series('p99', every, is_dashed=True)],
        ),
    ]


def _angles(sensors: int) -> list[Series]:
    """Return a quantity for each sensor in its leg's colour, dashed for th3A, th3B, th3C."""
    return [
        Series(name, colours.LEG_INKS['ABC'.index(name[-1])], is_dashed=name[2] == '3')
        for name in SENSOR_NAMES[:sensors]
    ]


def _known(*limits: Limit) -> list[Limit]:
    """Return the limits that have a value."""
    return [limit for limit in limits if limit.value == limit.value]
