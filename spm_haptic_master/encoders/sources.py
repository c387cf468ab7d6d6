"""From settings to a source: what each source takes, and its making."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians

from spm_haptic_master.encoders import trajectories
from spm_haptic_master.encoders.assembler import SetAssembler
from spm_haptic_master.encoders.bus import BusSource
from spm_haptic_master.encoders.layout import EncoderLayout
from spm_haptic_master.encoders.replay import ReplaySource
from spm_haptic_master.encoders.sample import EncoderSource, JOINT_NAMES
from spm_haptic_master.encoders.sim import SimSource
from spm_haptic_master.exceptions import SettingError, UnreachableError
from spm_haptic_master.kinematics import inverse_angles, zxz_rotation
from spm_haptic_master.manipulator import (
    GEOMETRY_SETTINGS, geometry_from, WORKING_MODE_SETTING)
from spm_haptic_master.settings import Setting

COUNTS_PER_TURN_SETTING = Setting(
    'encoders.counts_per_turn', int, 'counts of one turn', minimum=2, maximum=2**31, count=4)

LAYOUT_SETTINGS = (
    Setting('encoders.id', int, 'CAN identifier of the frame that carries the counts',
            minimum=1, maximum=0x1FFFFFFF, count=4),
    Setting('encoders.extended', bool, 'the identifier has 29 bits (else 11)', count=4),
    Setting('encoders.data_length', int, 'bytes of that frame', minimum=1, maximum=64, count=4),
    Setting('encoders.byte_offset', int, 'byte where the counts begin',
            minimum=0, maximum=63, count=4),
    Setting('encoders.bit_length', int, 'bits of the counts', minimum=1, maximum=64, count=4),
    Setting('encoders.byte_order', str, 'byte order of the counts',
            allowed=('little', 'big'), count=4),
    COUNTS_PER_TURN_SETTING,
    Setting('encoders.direction', int, 'sign of counts against joint angle',
            allowed=(1, -1), count=4),
    Setting('encoders.zero_count', int, 'counts at joint angle 0', minimum=0, count=4),
)

DECODER_SETTINGS = (
    *LAYOUT_SETTINGS,
    Setting('encoders.sync_id', int, 'identifier of SYNC; 0: the bus has no SYNC',
            minimum=0, maximum=0x7FF),
    Setting('encoders.window', float, 's; with SYNC how long after it an answer counts, '
            'without it how far apart the four frames of a set may be',
            minimum=1e-5, maximum=1.0),
)

SOURCE_SETTINGS = {
    'sim': (
        Setting('rate', float, 'sets a second', minimum=1.0, maximum=10000.0),
        Setting('sim.trajectory', str, 'motion', allowed=('fig9', 'sweep', 'fixed')),
        Setting('sim.tilt_max_deg', float, 'sweep: largest tilt from the centre, deg',
                minimum=0.0, maximum=26.0),
        Setting('sim.pose_deg', float, 'fixed: psi, theta, phi (ZXZ), deg',
                minimum=-360.0, maximum=360.0, count=3),
        Setting('sim.noise_deg', float, 'standard deviation of each sensor, deg',
                minimum=0.0, maximum=10.0),
        Setting('sim.seed', int, 'of the noise; the same seed gives the same noise', minimum=0),
        COUNTS_PER_TURN_SETTING,
        *GEOMETRY_SETTINGS,
        WORKING_MODE_SETTING,
    ),
    'replay': (
        Setting('replay.path', str, 'log file (.log, .asc, .blf, .csv, .trc; also .gz)'),
        Setting('replay.rate', float, 'pace; 1.0 is as recorded', minimum=0.01, maximum=100.0),
        Setting('replay.loop', bool, 'start again at the end'),
        *DECODER_SETTINGS,
    ),
    'can': (
        Setting('can.interface', str, "python-can interface, 'socketcan' on a rig"),
        Setting('can.channel', str, "its channel, 'can0' for instance"),
        Setting('can.bitrate', int, 'bit/s, where the interface sets it itself; 0: it does not',
                minimum=0, maximum=1000000),
        *DECODER_SETTINGS,
    ),
}


def make_source(name: str, values: Mapping[str, object]) -> EncoderSource:
    """
    Make the source `name` from its checked settings.

    Raises
    ------
    SettingError
        Where settings contradict each other, or name a file or interface that is not there.

    """
    return {'sim': _make_sim, 'replay': _make_replay, 'can': _make_bus}[name](values)


def _make_sim(values) -> SimSource:
    geometry = geometry_from(values)
    working_mode = values['working_mode']
    pose = values['sim.pose_deg']
    if values['sim.trajectory'] == 'fixed':
        try:
            inverse_angles(zxz_rotation(*map(radians, pose)), geometry, working_mode)
        except UnreachableError as error:
            raise SettingError('sim.pose_deg', list(pose), 'a pose within reach') from error
    trajectory = {
        'fig9': trajectories.fig9,
        'sweep': trajectories.sweep(radians(values['sim.tilt_max_deg'])),
        'fixed': trajectories.fixed(*map(radians, pose)),
    }[values['sim.trajectory']]
    return SimSource(
        trajectory, values['rate'], radians(values['sim.noise_deg']),
        values['encoders.counts_per_turn'], values['sim.seed'], geometry, working_mode)


def _make_replay(values) -> ReplaySource:
    return ReplaySource(values['replay.path'], values['replay.rate'], values['replay.loop'],
                        _make_assembler(values))


def _make_bus(values) -> BusSource:
    return BusSource(values['can.interface'], values['can.channel'], values['can.bitrate'],
                     _make_assembler(values))


def _make_assembler(values) -> SetAssembler:
    layouts = make_layouts(values)
    sync_id = values['encoders.sync_id'] or None
    for layout in layouts:
        if layout.can_id == sync_id and not layout.extended:
            raise SettingError('encoders.sync_id', sync_id,
                               f'an identifier that no encoder has ({layout.joint} has it)')
    return SetAssembler(layouts, sync_id, values['encoders.window'])


def make_layouts(values: Mapping[str, object]) -> tuple[EncoderLayout, ...]:
    """Return the four encoders' layouts; SettingError where one cannot be or two collide."""
    columns = zip(*(values[setting.name] for setting in LAYOUT_SETTINGS), strict=True)
    layouts = tuple(EncoderLayout(joint, *column)
                    for joint, column in zip(JOINT_NAMES, columns, strict=True))
    seen: dict[int, str] = {}
    for layout in layouts:
        if not layout.extended and layout.can_id > 0x7FF:
            raise SettingError('encoders.id', list(values['encoders.id']),
                               f'an 11-bit identifier for {layout.joint} (0x001 to 0x7FF), '
                               'or encoders.extended true for it')
        if layout.can_id in seen:
            raise SettingError(
                'encoders.id', list(values['encoders.id']),
                f'four different identifiers; {seen[layout.can_id]} and {layout.joint} '
                f'both have 0x{layout.can_id:X}')
        seen[layout.can_id] = layout.joint
        if layout.byte_offset + layout.byte_length > layout.data_length:
            raise SettingError(
                'encoders.byte_offset', list(values['encoders.byte_offset']),
                f"{layout.joint}'s {layout.bit_length} bits to end within its "
                f'{layout.data_length} bytes')
        if layout.counts_per_turn > 1 << layout.bit_length:
            raise SettingError(
                'encoders.counts_per_turn', list(values['encoders.counts_per_turn']),
                f"what {layout.joint}'s {layout.bit_length} bits can hold")
        if layout.zero_count >= layout.counts_per_turn:
            raise SettingError(
                'encoders.zero_count', list(values['encoders.zero_count']),
                f'counts of {layout.joint} below its {layout.counts_per_turn} a turn')
    return layouts
