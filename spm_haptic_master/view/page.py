# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The page beside the picture: banners, figures, plots and events of each device, and the views.

Banners and cover belong to the page, not to its panel, which leaves the page when a user collapses
it. viser has no elements outside the panel: a script, `page/page.js`, draws them and sends
nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import json
from math import degrees, nan
from pathlib import Path
from typing import Any

from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.description.workspace_map import colour_bar
from spm_haptic_master.kinematics import joints, zxz_angles
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.ros.diagnostic_status import CAUTION_KEY
from spm_haptic_master.view import status
from spm_haptic_master.view.scene import ARM_DISTANCE, GHOST
from viser import ViserServer
from viser._messages import RunJavascriptMessage as ViserScript

# Time without news from this program after which the page covers itself (ms).
NEWS_TIMEOUT = 2500
# The page's script and style.
FOLDER = Path(__file__).with_name('page')
# Meaning of colours and figures.
LEGEND = (
    'Encoder: green healthy, amber not checked by the others, red faulty, black no reading.',
    'Parity: how far the encoders disagree, in standard deviations; of noise mostly below 3.',
    "Protection level: bound of the orientation's error, even if an encoder is wrong.",
    'Cone about the handle: the protection level, ten times as wide, at most 20 deg.',
)
# Begin of a script with news.
NEWS = 'window.spm.show('
# Camera's position relative to its target in each view of one device, and the target (units of the
# scene); share of that distance by which it backs off for each further device (unit 1).
CAMERAS = {'front': (1.15, -3.1, 1.85), 'side': (3.9, -0.01, 0.4), 'top': (0.0, -0.01, 4.1)}
LOOK_AT, BACK_OFF = (0.0, 0.0, 0.88), 0.75
# What the page shows before the first device.
NO_DEVICE = status.Banner(status.Light.GREY, 'no device found: is master running?', False)
# Text of a figure without a value.
DASH = '\u2013'
# Colours of all encoders, and of limits.
ALL, LIMIT = '#2b6cb0', '#b42318'
# Dexterity of three sensors at which the bar is full (unit 1).
FULL_DEXTERITY = 0.2
# Error of three encoders clear of the singularity that noise does not explain (deg).
WRONG_SIDE = 3.0
# Share above which further motion improves a calibration little.
ENOUGH = 0.9


@dataclass(slots=True)
class Seen:
    """State of a device; a past one if the banner is not alive."""

    banner: status.Banner
    sensors: int = 4  # number of them
    states: list[status.SensorState] = field(default_factory=list)
    source: str = ''  # where the joint angles come from; empty: not known
    force: str = ''  # state of the force feedback; empty: not known
    alert_limit: float = nan  # largest protection level of a published orientation, deg
    angles: Sequence[float] | None = None  # of all nine joints, rad
    orientation: Quaternion[float] | None = None  # of the platform in the base frame
    dexterities: Sequence[float] | None = None  # of three encoders, and of all
    ghost: float | None = None  # error of three encoders alone, rad
    pace: float = 0.0  # poses drawn per second
    story: str = ''  # explanation of what the simulation plays; empty: nothing
    happened: Sequence[str] = ()  # events since the last time
    # What to do next in a calibration, and shares 0 .. 1 of what is needed.
    calibration: tuple[str, dict[str, float]] | None = None


class RunJavascriptMessage(ViserScript):
    """A script, by the name that viser knows; one of each kind is kept for new pages."""

    def redundancy_key(self) -> str:
        """Return the key under which a message replaces the one before."""
        return f'spm-{self.source.startswith(NEWS)}'


class Page:
    """The banners, one below the other, the figures of each device, and the views of all."""

    def __init__(self, server: ViserServer) -> None:
        self.server = server
        # Banners and contents by the names of the devices; the only one need not have a name.
        self.shown: dict[str, status.Banner] = {}
        self.content: dict[str, dict[str, Any]] = {}
        self.aim(1)
        setup = {
            'css': (FOLDER / 'page.css').read_text(),
            'timeout': NEWS_TIMEOUT,
            'lost': 'no news from view: the picture is old',
            'dome': colour_bar(),
            'views': self.views,
            'legend': LEGEND,
        }
        self._run((FOLDER / 'page.js').read_text().replace('SETUP', json.dumps(setup)))
        self.refresh()

    def aim(self, arms: int) -> None:
        """Have each view, and the first picture, show a number of devices in a row."""
        self.views = views(arms)
        camera = self.server.initial_camera
        camera.position, camera.look_at = self.views['front']

    def show(self, name: str, banner: status.Banner) -> None:
        """Show the state of a device."""
        if self.shown.get(name) != banner:
            self.shown[name] = banner
            self.refresh()

    def show_content(self, name: str, seen: Seen, entries: status.StatusEntries) -> None:
        """Show the figures of a device whose banner is shown."""
        self.content[name] = content(seen, entries)
        self.refresh()

    def refresh(self) -> None:
        """Send all of it, as a sign of life; call it every second."""
        shown = self.shown or {'': NO_DEVICE}
        devices = [
            {
                'name': name,
                'content': self.content.get(name),
                'banner': (
                    f'{name}: {banner.text}' if name else banner.text,
                    banner.light.value,
                    banner.alive,
                ),
            }
            for name, banner in shown.items()
        ]
        # JSON of Python, with NaN and Infinity, is valid in a script.
        self._run(f'{NEWS}{json.dumps({"devices": devices, "views": self.views})});')

    def _run(self, script: str) -> None:
        # viser sends its own script, plotly, in this way.
        self.server._websock_server.queue_message(RunJavascriptMessage(script))


def views(arms: int) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return the camera's position and target for each view of a number of devices in a row."""
    x, y, z = LOOK_AT
    x += 0.5 * ARM_DISTANCE * (arms - 1)
    back = 1.0 + BACK_OFF * (arms - 1)
    return {
        name: ((x + back * dx, y + back * dy, z + back * dz), (x, y, z))
        for name, (dx, dy, dz) in CAMERAS.items()
    }


def content(seen: Seen, entries: status.StatusEntries) -> dict[str, Any]:
    """Return what the page shows of a device with its present entries on /diagnostics."""
    if not seen.banner.alive:
        seen = replace(seen, angles=None, orientation=None, dexterities=None, ghost=None)
    limits, figures, timing = map(
        entries.numbers, (status.SINGULARITY, status.ORIENTATION, status.TIMING)
    )
    warn, error = limits.get('warn below', nan), limits.get('error below', nan)
    three, every = dexterities = seen.dexterities or (nan, nan)
    if seen.orientation is None:
        figures = {}
    level, parity = (figures.get(key, nan) for key in ('protection level (deg)', 'parity (sigma)'))
    ghost = nan if seen.ghost is None else degrees(seen.ghost)
    rate, p50, p99 = (
        timing.get(key, nan)
        for key in ('orientation rate (Hz)', 'latency p50 (us)', 'latency p99 (us)')
    )
    note, warns = (seen.story, False) if seen.story else _note(seen, warn)
    driver, singularity = entries.entry(status.ENCODERS), entries.entry(status.SINGULARITY)
    missing = entries.missing_joints()
    # A joint without a reading has a gap in its plot.
    angles = [
        nan
        if seen.angles is None or name in missing
        else degrees(seen.angles[joints.MECHANISM_JOINT_NAMES.index(name)])
        for name in joints.ALL_JOINT_NAMES[: seen.sensors]
    ]
    zxz = map(degrees, () if seen.orientation is None else zxz_angles(*seen.orientation))
    # Always these rows: name, text, and share and colour of a bar, if any.
    rows = [
        ('source', seen.source or 'unknown'),
        ('encoders', DASH if driver is None else driver.message),
        (
            'orientation',
            ', '.join(
                f'{name} {angle:.2f}\u00b0'
                for name, angle in zip('\u03c8\u03b8\u03c6', zxz, strict=False)
            )
            or DASH,
        ),
        ('three encoders', _known(f'{ghost:.2f}\u00b0 off', ghost)),
        ('protection level', _known(f'{level:.2f}\u00b0', level)),
        ('parity', _known(f'{parity:.1f} sigma', parity)),
        (
            'singularity',
            DASH if singularity is None or seen.orientation is None else singularity.message,
        ),
        *(
            (
                f'dexterity of {count}',
                _known(f'{value:.3f}', value),
                0.0 if value != value else value / FULL_DEXTERITY,
                _light(value, warn, error).value,
            )
            for count, value in zip((3, seen.sensors), dexterities, strict=True)
        ),
        ('rate', _known(f'{rate:.0f} Hz', rate)),
        ('latency', _known(f'p50 {p50:.0f} us, p99 {p99:.0f} us', p50 + p99)),
        ('force', seen.force or DASH),
        ('caution', entries.texts(status.ORIENTATION).get(CAUTION_KEY) or DASH),
        ('picture', f'{seen.pace:.0f} poses a second'),
    ]
    text, shares = seen.calibration or ('', {})
    return {
        'note': note,
        'warns': warns,
        'rows': rows,
        'chips': [
            (short, f'{name}: {state.words}', state.colour)
            for short, name, state in zip(
                joints.SHORT_NAMES, joints.ALL_JOINT_NAMES, seen.states, strict=False
            )
        ],
        'calibration': seen.calibration
        and {
            'text': text,
            'covered': [
                (
                    name,
                    share,
                    (status.Light.GREEN if share >= ENOUGH else status.Light.AMBER).value,
                )
                for name, share in shares.items()
            ],
        },
        'plots': [
            _plot(
                'dexterity',
                'dexterity',
                [('3 encoders', GHOST), (f'{seen.sensors} encoders', ALL)],
                [(warn, status.Light.AMBER.value), (error, LIMIT)],
            ),
            _plot('ghost', 'three encoders alone: error, deg', [('error', GHOST)]),
            _plot('level', 'protection level, deg', [('level', ALL)], [(seen.alert_limit, LIMIT)]),
            _plot(
                'angles',
                'joint angles, deg',
                [
                    (name, LEGS['ABC'.index(name[1])], name[0] == '3')
                    for name in joints.SHORT_NAMES[: seen.sensors]
                ],
                zero=False,
            ),
            _plot('parity', 'parity, sigma', [('parity', ALL)], zero=False),
            _plot('latency', 'latency, us', [('p50', ALL), ('p99', GHOST)]),
        ],
        'sample': {
            't': entries.now,
            'state': seen.banner.text,
            'colour': seen.banner.light.value,
            'happened': seen.happened,
            'values': {
                'dexterity': [three, every],
                'ghost': [ghost],
                'level': [level],
                'parity': [parity],
                'angles': angles,
                'latency': [p50, p99],
            },
        },
    }


def _known(text: str, value: float) -> str:
    """Return the text of a value, a dash of nan."""
    return DASH if value != value else text


def _plot(
    key: str,
    title: str,
    series: Sequence[Sequence[Any]],
    limits: Sequence[tuple[float, str]] = (),
    zero: bool = True,
) -> dict[str, Any]:
    """Return a plot: name, colour and whether dashed of each quantity; limits with colours."""
    return {
        'key': key,
        'title': title,
        'series': series,
        'zero': zero,
        'limits': [each for each in limits if each[0] == each[0]],
    }


def _note(seen: Seen, warn: float) -> tuple[str, bool]:
    """Return which encoders determine the pose, in a sentence, and whether that is a warning."""
    if seen.orientation is None:
        return 'No orientation: the picture is not the present pose.', True
    if seen.dexterities is None or warn != warn:
        return DASH, False
    three, every = seen.dexterities
    lost = sum(
        state in (status.SensorState.MISSING, status.SensorState.EXCLUDED) for state in seen.states
    )
    number = joints.NUMBER_WORDS.get(seen.sensors - lost, 'the')
    if every < warn:
        return f'Not even {number} encoders determine this pose.', True
    if not three >= warn:
        return (
            f'Singularity: three encoders do not determine this pose; {number} do. The violet '
            'ghost is what three alone would report.',
            True,
        )
    if seen.ghost is not None and degrees(seen.ghost) > WRONG_SIDE:
        return (
            'Three encoders alone came out of the singularity on its wrong side. With '
            f'{number} the device did not.',
            True,
        )
    return f'Three encoders determine this pose. With {number} they check one another.', False


def _light(dexterity: float, warn: float, error: float) -> status.Light:
    """Return the colour of a dexterity, grey without a limit."""
    if dexterity != dexterity or warn != warn:
        return status.Light.GREY
    if dexterity < error:
        return status.Light.RED
    return status.Light.AMBER if dexterity < warn else status.Light.GREEN
