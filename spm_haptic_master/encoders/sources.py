"""From settings to a source: what each source takes, and its making."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians

from spm_haptic_master.encoders import canopen, trajectories
from spm_haptic_master.encoders.assembler import SetAssembler
from spm_haptic_master.encoders.bus import BusSource
from spm_haptic_master.encoders.bus_load import check_bus_load
from spm_haptic_master.encoders.decoder import FrameDecoder
from spm_haptic_master.encoders.layout import EncoderLayout, lowest_bit
from spm_haptic_master.encoders.network import Network
from spm_haptic_master.encoders.replay import ReplaySource
from spm_haptic_master.encoders.sample import EncoderSource, JOINT_NAMES
from spm_haptic_master.encoders.sim import NoisyMotion, SimSource
from spm_haptic_master.exceptions import SettingError, UnreachableError
from spm_haptic_master.kinematics import inverse_angles, zxz_rotation
from spm_haptic_master.manipulator import geometry_from, GEOMETRY_SETTINGS, WORKING_MODE_SETTING
from spm_haptic_master.settings import Setting

COUNTS_PER_TURN_SETTING = Setting(
    'encoders.counts_per_turn', int, 'counts of one turn', minimum=2, maximum=2**31, count=4)

LAYOUT_SETTINGS = (
    Setting('encoders.id', int, 'CAN identifier of the frame that carries the counts '
            '(CANopen: COB-ID of the TPDO, 0x180 or 0x280 + node id)',
            minimum=1, maximum=0x1FFFFFFF, count=4),
    Setting('encoders.extended', bool, 'the identifier has 29 bits (else 11)', count=4),
    Setting('encoders.data_length', int, 'bytes of that frame', minimum=1, maximum=8, count=4),
    Setting('encoders.byte_offset', int, 'byte where the word with the counts begins',
            minimum=0, maximum=7, count=4),
    Setting('encoders.bit_length', int, 'bits of that word', minimum=1, maximum=64, count=4),
    Setting('encoders.byte_order', str, 'byte order of that word',
            allowed=('little', 'big'), count=4),
    Setting('encoders.mask', int, 'bits of that word that are the counts, in one piece; '
            '0: all of them', minimum=0, maximum=2**63 - 1, count=4),
    Setting('encoders.signed', bool, "the counts are a two's complement number", count=4),
    COUNTS_PER_TURN_SETTING,
    Setting('encoders.direction', int, 'sign of counts against joint angle',
            allowed=(1, -1), count=4),
    Setting('encoders.zero_count', int, 'counts at joint angle 0', minimum=0, count=4),
    Setting('encoders.counter_byte', int, 'byte of the frame with a rolling counter',
            minimum=0, maximum=7, count=4),
    Setting('encoders.counter_mask', int, 'bits of that counter in its byte; 0: there is none',
            minimum=0, maximum=0xFF, count=4),
    Setting('encoders.status_byte', int, 'byte of the frame with status bits',
            minimum=0, maximum=7, count=4),
    Setting('encoders.status_mask', int, 'status bits in that byte; 0: there are none',
            minimum=0, maximum=0xFF, count=4),
    Setting('encoders.status_good', int, 'what the status bits say when all is well',
            minimum=0, maximum=0xFF, count=4),
)

RATE_SETTING = Setting('rate', float, 'sets a second', minimum=1.0, maximum=10000.0)

DECODER_SETTINGS = (
    RATE_SETTING,
    Setting('can.protocol', str, 'what the encoders speak: canopen (CiA 301: NMT, heartbeat and '
            'EMCY too) or raw (their frames only)', allowed=('canopen', 'raw')),
    Setting('can.heartbeat_timeout', float, 's without a heartbeat, once there was one, after '
            'which a node counts as lost', minimum=0.01, maximum=60.0),
    Setting('can.emcy_stops', bool, 'no joint sample while an encoder reports an emergency '
            '(else it is reported, and samples go on)'),
    *LAYOUT_SETTINGS,
    Setting('encoders.node_id', int, 'CANopen node id', minimum=1,
            maximum=canopen.NODE_ID_MAXIMUM, count=4),
    Setting('encoders.sync_id', int, 'identifier of SYNC; 0: the bus has no SYNC',
            minimum=0, maximum=0x7FF),
    Setting('encoders.window', float, 's; with SYNC how long after it an answer counts, and a '
            'missing one may still come; '
            'without it how far apart the four frames of a set may be (at most half a period)',
            minimum=1e-5, maximum=1.0),
)

BUS_SETTINGS = (
    Setting('can.interface', str, "python-can interface, 'socketcan' on a rig"),
    Setting('can.channel', str, "its channel, 'can0' for instance"),
    Setting('can.bitrate', int, 'bit/s of the bus; set where the interface does that, and used to '
            'check the bus load; 0: unknown', minimum=0, maximum=1000000),
)

MOTION_SETTINGS = (
    Setting('sim.trajectory', str, 'motion', allowed=('fig9', 'perturbed', 'sweep', 'fixed')),
    Setting('sim.tilt_max_deg', float, 'sweep: largest tilt from the centre, deg',
            minimum=0.0, maximum=26.0),
    Setting('sim.pose_deg', float, 'fixed: psi, theta, phi (ZXZ), deg',
            minimum=-360.0, maximum=360.0, count=3),
    Setting('sim.noise_deg', float, 'standard deviation of each sensor, deg',
            minimum=0.0, maximum=10.0),
    Setting('sim.seed', int, 'of the noise; the same seed gives the same noise', minimum=0),
    *GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
)

SOURCE_SETTINGS = {
    'sim': (
        RATE_SETTING,
        *MOTION_SETTINGS,
        COUNTS_PER_TURN_SETTING,
    ),
    'replay': (
        Setting('replay.path', str,
                'log file (.log, .asc, .csv, .trc; also .gz; and .blf)'),
        Setting('replay.rate', float, 'pace; 1.0 is as recorded', minimum=0.01, maximum=100.0),
        Setting('replay.loop', bool, 'start again at the end'),
        *DECODER_SETTINGS,
    ),
    'can': (
        *BUS_SETTINGS,
        Setting('can.sync', str, 'consume: another master makes SYNC; produce: this driver does, '
                'at `rate`', allowed=('consume', 'produce')),
        Setting('can.timeout', float, 's without a set, or without an encoder, after which that '
                'is a fault', minimum=0.002, maximum=10.0),
        Setting('can.nmt_stop', bool, 'NMT stop to the nodes when the driver ends'),
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
    return SimSource(make_motion(values), values['rate'], values['encoders.counts_per_turn'])


def make_motion(values: Mapping[str, object]) -> NoisyMotion:
    """Return what simulated sensors measure; SettingError where the pose is out of reach."""
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
        'perturbed': trajectories.perturbed,
        'sweep': trajectories.sweep(radians(values['sim.tilt_max_deg'])),
        'fixed': trajectories.fixed(*map(radians, pose)),
    }[values['sim.trajectory']]
    return NoisyMotion(trajectory, radians(values['sim.noise_deg']), values['sim.seed'],
                       geometry, working_mode)


def _make_replay(values) -> ReplaySource:
    return ReplaySource(values['replay.path'], values['replay.rate'], values['replay.loop'],
                        make_decoder(values))


def _make_bus(values) -> BusSource:
    decoder = make_decoder(values)
    rate = values['rate']
    if values['can.bitrate']:
        check_bus_load(tuple(encoder.layout for encoder in decoder.encoders),
                       decoder.sync_id is not None, rate, values['can.bitrate'])
    if values['can.timeout'] * rate < 2.0:
        raise SettingError('can.timeout', values['can.timeout'],
                           f'at least two periods, {2.0 / rate:g} s at {rate:g} Hz')
    produce = None
    if values['can.sync'] == 'produce':
        if decoder.sync_id is None:
            raise SettingError('can.sync', 'produce',
                               'consume where encoders.sync_id is 0 (the bus has no SYNC)')
        produce = 1.0 / rate
    return BusSource(
        values['can.interface'], values['can.channel'], values['can.bitrate'], decoder,
        values['can.timeout'], produce, values['can.nmt_stop'])


def make_decoder(values: Mapping[str, object]) -> FrameDecoder:
    """Return the decoder of four encoders; SettingError where settings contradict each other."""
    layouts = make_layouts(values)
    sync_id = values['encoders.sync_id'] or None
    period, window = 1.0 / values['rate'], values['encoders.window']
    if sync_id is None:
        # Frames further apart may be of two cycles, and nothing tells.
        window = min(window, 0.5 * period)
    network = None
    if values['can.protocol'] == 'canopen':
        node_ids = values['encoders.node_id']
        if len(set(node_ids)) < len(node_ids):
            raise SettingError('encoders.node_id', list(node_ids), 'four different node ids')
        network = Network(JOINT_NAMES, node_ids, values['can.heartbeat_timeout'])
    _refuse_shared_identifiers(layouts, sync_id, network)
    assembler = SetAssembler(JOINT_NAMES, sync_id is not None, window, period)
    return FrameDecoder(layouts, sync_id, assembler, network, values['can.emcy_stops'])


def _refuse_shared_identifiers(layouts, sync_id, network) -> None:
    """Refuse a SYNC, heartbeat or EMCY that has the identifier of an encoder's counts."""
    taken = {layout.can_id: layout.joint for layout in layouts if not layout.extended}
    if sync_id in taken:
        raise SettingError('encoders.sync_id', sync_id,
                           f'an identifier that no encoder has ({taken[sync_id]} has it)')
    for identifier, (name, _, _) in (network.handlers() if network else {}).items():
        if identifier in taken:
            raise SettingError(
                'encoders.id', [layout.can_id for layout in layouts],
                f'identifiers other than that of the {name} (0x{identifier:X})')


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
        for name, fits, expected in _requirements(layout):
            if not fits:
                raise SettingError(name, list(values[name]), f'{expected}, for {layout.joint}')
    return layouts


def _requirements(layout: EncoderLayout) -> tuple[tuple[str, bool, str], ...]:
    """Return what one layout's settings ask of each other: whose fault, whether kept, in words."""
    position = layout.position_mask
    length = f'within the {layout.data_length} bytes of encoders.data_length'
    return (
        ('encoders.byte_offset', layout.byte_offset + layout.byte_length <= layout.data_length,
         f'a word of {layout.bit_length} bits that ends {length}'),
        ('encoders.mask', position < 1 << layout.bit_length,
         f'bits within the {layout.bit_length} of encoders.bit_length'),
        ('encoders.mask', _in_one_piece(position), 'bits in one piece'),
        ('encoders.counts_per_turn', layout.counts_per_turn <= 1 << position.bit_count(),
         f'what {position.bit_count()} bits can hold'),
        ('encoders.zero_count', layout.zero_count < layout.counts_per_turn,
         f'counts below the {layout.counts_per_turn} of encoders.counts_per_turn'),
        ('encoders.counter_byte', not layout.counter_mask
         or layout.counter_byte < layout.data_length, f'a byte {length}'),
        ('encoders.counter_mask', _in_one_piece(layout.counter_mask), 'bits in one piece'),
        ('encoders.status_byte', not layout.status_mask
         or layout.status_byte < layout.data_length, f'a byte {length}'),
        ('encoders.status_good', layout.status_good & ~layout.status_mask == 0,
         'bits of encoders.status_mask'),
    )


def _in_one_piece(mask: int) -> bool:
    return not mask or mask.bit_count() == mask.bit_length() - lowest_bit(mask)
