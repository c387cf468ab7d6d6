# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the nodes, by node, of the encoder driver by source, and of the motors' drives."""

from __future__ import annotations

from spm_haptic_master.executables import FOLLOWER, PIPELINE
from spm_haptic_master.parameters import encoders
from spm_haptic_master.parameters.axes import AXIS_SETTINGS
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import MECHANISM_SETTINGS, MOUNTING_SETTINGS
from spm_haptic_master.parameters.setting import (
    ANY_COUNT,
    CALIBRATION_SETTING,
    JOINTS_FRAME_SETTING,
    RATE_SETTING,
    SENSORS_SETTING,
    Setting,
)

MOTION_SETTINGS = (
    SENSORS_SETTING,
    Setting(
        'sim.trajectory',
        str,
        'simulated motion',
        allowed=('fig9', 'perturbed', 'sweep', 'hand', 'tour', 'arms', 'fixed'),
    ),
    Setting(
        'sim.tilt_max_deg',
        float,
        'sweep: largest tilt from the centre, deg',
        minimum=0.0,
        maximum=26.0,
    ),
    Setting(
        'sim.pose_deg',
        float,
        'fixed: psi, theta, phi (ZXZ), deg',
        minimum=-360.0,
        maximum=360.0,
        count=3,
    ),
    Setting(
        'sim.noise_deg', float, 'standard deviation of each sensor, deg', minimum=0.0, maximum=10.0
    ),
    Setting('sim.seed', int, 'seed of the noise; the same seed gives the same noise', minimum=0),
    Setting(
        'sim.rig_file',
        str,
        'file (JSON) of the simulated rig: its mechanism as built and '
        'the errors of its sensors; empty: none',
        blank=True,
    ),
    Setting(
        'sim.rig_seed',
        int,
        'seed of a random rig, off by the two below; 0: none, the rig is as drawn (geometry.*)',
        minimum=0,
    ),
    Setting(
        'sim.tolerance_deg',
        float,
        'sim.rig_seed: standard deviations of its link angles and of its axes, deg',
        minimum=0.0,
        maximum=5.0,
        count=2,
    ),
    Setting(
        'sim.harmonics_deg',
        float,
        "sim.rig_seed: standard deviations of the encoders' first and second harmonics, deg",
        minimum=0.0,
        maximum=2.0,
        count=2,
    ),
    *MECHANISM_SETTINGS,
)

SIM_SETTINGS = (
    RATE_SETTING,
    *MOTION_SETTINGS,
    encoders.COUNTS_PER_TURN_SETTING,
    *encoders.FIRST_HARMONIC_SETTINGS,
    *encoders.TABLE_SETTINGS,
    *AXIS_SETTINGS,
)
# Settings of each source, by its name; encoders need no mechanism, but their driver reports it.
SOURCE_SETTINGS = {
    'sim': (*SIM_SETTINGS, JOINTS_FRAME_SETTING),
    'replay': (*encoders.REPLAY_SETTINGS, *MECHANISM_SETTINGS, JOINTS_FRAME_SETTING),
    'can': (*encoders.CAN_SETTINGS, *MECHANISM_SETTINGS, JOINTS_FRAME_SETTING),
}

SOURCE_SETTING = Setting(
    'source',
    str,
    'source of the joint angles: a CAN bus, a recording or a simulation',
    allowed=tuple(sorted(SOURCE_SETTINGS)),
)

DIAGNOSTICS_SETTINGS = (
    Setting(
        'dexterity_rate',
        float,
        'rate at which the dexterity is published, Hz',
        default=50.0,
        minimum=0.1,
        maximum=1000.0,
    ),
    Setting(
        'dexterity_warn',
        float,
        'dexterity of the sensors in use (0 .. 1) below which the level is WARN',
        default=0.059,
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Setting(
        'dexterity_error',
        float,
        'dexterity of the sensors in use (0 .. 1) below which the level is ERROR',
        default=0.033,
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Setting(
        'dexterity_hysteresis',
        float,
        'fraction of a threshold by which the dexterity has to exceed it for its level to be left',
        default=0.1,
        minimum=0.0,
        maximum=10.0,
        live=True,
    ),
    Setting(
        'joint_states_rate',
        float,
        'rate at which the angles of all nine joints are '
        'published while joint_states has a subscriber, Hz',
        default=60.0,
        minimum=10.0,
        maximum=1000.0,
    ),
    Setting(
        'orientation_timeout',
        float,
        'time without an orientation after which that is an error, s',
        default=0.1,
        minimum=0.002,
        maximum=60.0,
    ),
    SENSORS_SETTING,
    *MECHANISM_SETTINGS,
    *MOUNTING_SETTINGS,
)

# Settings of the process that a node runs in; all but the slice are off unless a rig sets them.
REALTIME_SETTINGS = (
    Setting(
        'realtime.slice',
        float,
        'time slice of all threads under SCHED_OTHER, s, 0.0001 or '
        'more: a thread with a shorter one preempts others when it wakes; not of a process '
        'that was started with nice; ignored before Linux 6.12; 0: that of the system',
        default=1e-4,
        minimum=0.0,
        maximum=0.1,
    ),
    Setting(
        'realtime.priority',
        int,
        'SCHED_FIFO priority of all threads; 0: normal scheduling',
        default=0,
        minimum=0,
        maximum=98,
    ),
    Setting(
        'realtime.cpus',
        str,
        "cores to run on, such as '0,2-3'; empty: any; on a command "
        'line a single core is written "\'2\'", because 2 is read as a number',
        default='',
        blank=True,
    ),
    Setting(
        'realtime.lock_memory',
        bool,
        'whether all memory of the process is locked against swapping (mlockall)',
        default=False,
    ),
    Setting(
        'realtime.gc',
        str,
        "garbage collection after start-up: 'normal'; 'freeze': without "
        "the objects made at start-up; 'disable': none (reference counting frees what the "
        'nodes allocate)',
        default='normal',
        allowed=('normal', 'freeze', 'disable'),
    ),
)

RECORDER_SETTINGS = (
    Setting(
        'directory', str, 'directory for orientation.csv and measured_js.csv', default='recording'
    ),
)

ANY_OFFSET = 180.0  # deg
NO_TROCAR = (0.0,)
PRESENCE_TIMEOUT = 'teleop.presence_timeout'

TELEOP_SETTINGS = (
    Setting(
        'teleop.registration_zxz_deg',
        float,
        'psi, theta, phi (ZXZ) of R_slave_master, from '
        "the frame of `orientation` to the slave's base or camera frame, deg; 0 each: none",
        default=(0.0,) * 3,
        minimum=-360.0,
        maximum=360.0,
        count=3,
    ),
    Setting(
        'teleop.alignment',
        str,
        "'relative': the offset between master and slave at engaging "
        "is kept; 'absolute': it shrinks to none at teleop.align_speed",
        default='relative',
        allowed=('relative', 'absolute'),
    ),
    Setting(
        'teleop.align_speed',
        float,
        "angular speed at which an 'absolute' slave meets the "
        'master, rad/s; at most teleop.speed_limit',
        default=0.2,
        minimum=0.001,
        maximum=10.0,
    ),
    Setting(
        'teleop.alignment_tolerance_deg',
        float,
        f'largest angle between master and slave at which they engage, deg; {ANY_OFFSET:g}: any',
        default=ANY_OFFSET,
        minimum=0.1,
        maximum=ANY_OFFSET,
    ),
    Setting(
        'teleop.enable_timeout',
        float,
        'time after which an enable lapses that has not led to engaging, s',
        default=10.0,
        minimum=0.1,
        maximum=600.0,
    ),
    Setting(
        'teleop.orientation_timeout',
        float,
        'largest age of the orientation while engaged, s',
        default=0.05,
        minimum=0.002,
        maximum=1.0,
    ),
    Setting(
        'teleop.slave_timeout',
        float,
        "largest age of the slave's measured pose while engaged, s",
        default=0.1,
        minimum=0.002,
        maximum=10.0,
    ),
    Setting(
        PRESENCE_TIMEOUT,
        float,
        'largest age of the message that the surgeon is '
        'present, s; 0: any, for a pedal that publishes changes only: one that hangs or is '
        'killed then leads the slave until DDS drops it, 20 s',
        default=0.5,
        minimum=0.0,
        maximum=10.0,
    ),
    Setting(
        'teleop.protection_limit_deg',
        float,
        'largest protection level at which the slave '
        'follows, deg; 0: any that fkm publishes (alert_limit_deg)',
        default=0.0,
        minimum=0.0,
        maximum=30.0,
    ),
    Setting(
        'teleop.tracking_limit_deg',
        float,
        "largest angle from the command to the slave's measured pose, deg; 0: any",
        default=0.0,
        minimum=0.0,
        maximum=180.0,
    ),
    Setting(
        'teleop.tip_tracking_limit',
        float,
        "largest distance from the commanded tip to the slave's measured one, m; 0: any",
        default=0.0,
        minimum=0.0,
        maximum=1.0,
    ),
    Setting(
        'teleop.command_rate',
        float,
        'rate of servo_cp, Hz; 0: with each orientation',
        default=200.0,
        minimum=0.0,
        maximum=10000.0,
    ),
    Setting(
        'teleop.speed_limit',
        float,
        'largest angular speed of the command, rad/s',
        default=6.0,
        minimum=0.01,
        maximum=100.0,
    ),
    Setting(
        'teleop.acceleration_limit',
        float,
        'largest angular acceleration of the command, rad/s^2',
        default=500.0,
        minimum=0.1,
        maximum=1e6,
    ),
    Setting(
        'teleop.jump_limit_deg',
        float,
        'largest rotation from one command to the next, deg',
        default=5.0,
        minimum=0.01,
        maximum=90.0,
    ),
    Setting(
        'teleop.limit_action',
        str,
        "what a command does that would break a limit: 'slew' to "
        "it within the limits, or 'disengage'",
        default='slew',
        allowed=('slew', 'disengage'),
    ),
    Setting(
        'teleop.frame_id',
        str,
        "frame of servo_cp and of the twist; empty: that of the slave's measured pose",
        default='',
        blank=True,
    ),
    Setting(
        'teleop.slave_without_stamps',
        bool,
        'accept poses and torques of the slave whose stamp is 0; false: they '
        'are invalid, as those of dVRK with that stamp are',
        default=False,
    ),
    Setting(
        'teleop.trocar',
        float,
        "trocar about which the slave pivots, x, y, z in the slave's base frame, m, until one "
        'comes on the topic slave/trocar; 0.0: none, and the tip keeps its position',
        default=NO_TROCAR,
        minimum=-10.0,
        maximum=10.0,
        count=ANY_COUNT,
    ),
    Setting(
        'teleop.requires_trocar',
        bool,
        'the slave pivots: it does not follow while its trocar is not known',
        default=False,
    ),
    Setting(
        'teleop.shaft_axis',
        float,
        "direction of the slave's shaft in its tool's frame from the trocar to the tip, unit "
        'vector: engaging is refused where that line passes the trocar by 5 mm; 0 each: unknown, '
        'the line from the trocar to the tip at engaging',
        default=(0.0, 0.0, 0.0),
        minimum=-1.0,
        maximum=1.0,
        count=3,
    ),
    Setting(
        'teleop.insertion_scale',
        float,
        "depth of the slave's tip over insertion of the master, 0.05 or more; 0: the depth stays "
        'as at engaging, and no insertion is needed',
        default=1.0,
        minimum=0.0,
        maximum=2.0,
    ),
    Setting(
        'teleop.depth_range',
        float,
        'smallest and largest depth of the tip below the trocar, m',
        default=(0.01, 0.3),
        minimum=0.005,
        maximum=2.0,
        count=2,
    ),
    Setting(
        'teleop.insertion_speed_limit',
        float,
        'largest speed of the commanded depth, m/s',
        default=0.2,
        minimum=0.001,
        maximum=10.0,
    ),
    Setting(
        'teleop.insertion_acceleration_limit',
        float,
        'largest acceleration of the commanded depth, m/s^2',
        default=10.0,
        minimum=0.01,
        maximum=1e4,
    ),
    Setting(
        'teleop.tilt_limit_deg',
        float,
        'largest tilt of the shaft about its direction at engaging, deg; 0: any',
        default=0.0,
        minimum=0.0,
        maximum=89.0,
    ),
    Setting(
        'gripper.align_speed',
        float,
        'speed at which the offset between jaw and gripper at engaging shrinks to none, rad/s',
        default=0.5,
        minimum=0.001,
        maximum=100.0,
    ),
    Setting(
        'teleop.force_scale',
        float,
        'torque on the hand over that on slave/measured_cf, while engaged: above 0 where that is '
        'the torque on the instrument, below 0 where it is what the instrument exerts (dVRK); 0: '
        'none, and neither topic',
        default=0.0,
        minimum=-1.0,
        maximum=1.0,
    ),
    Setting(
        'teleop.force_frame',
        str,
        "'base': slave/measured_cf is about the tip, in the frame of the slave's pose; 'tool': "
        "about the tip, in the tool's frame (body/measured_cf); 'spatial': about the origin of "
        'the base, in its frame (spatial/measured_cf)',
        default='base',
        allowed=('base', 'tool', 'spatial'),
    ),
    Setting(
        'teleop.force_loss',
        str,
        "what the slave does when force_state becomes 'off' or a fault while it follows: 'hold' "
        "until the next enable, or 'follow'",
        default='hold',
        allowed=('hold', 'follow'),
    ),
    RATE_SETTING,
)

MASTER_SETTINGS = (
    Setting('teleop.run', bool, 'run teleop in the process of master', default=False),
)

SLAVE_SETTINGS = (
    Setting(
        'slave.rate',
        float,
        'rate at which the simulated slave moves and publishes, Hz',
        default=200.0,
        minimum=1.0,
        maximum=1000.0,
    ),
    Setting(
        'slave.time_constant',
        float,
        'time constant of its lag to the command, s',
        default=0.02,
        minimum=0.001,
        maximum=10.0,
    ),
    Setting(
        'slave.pose_zxz_deg',
        float,
        'psi, theta, phi (ZXZ) of its orientation at the start, deg',
        default=(0.0, 0.0, 0.0),
        minimum=-360.0,
        maximum=360.0,
        count=3,
    ),
    Setting('slave.frame_id', str, 'its base frame', default='slave_base'),
    Setting(
        'slave.trocar',
        float,
        'trocar of a simulated laparoscopic slave, x, y, z in its base frame, m; 0.0: the slave '
        'is a wrist whose tip stays',
        default=NO_TROCAR,
        minimum=-10.0,
        maximum=10.0,
        count=ANY_COUNT,
    ),
    Setting(
        'slave.depth',
        float,
        'depth of its tip below the trocar at the start, m',
        default=0.1,
        minimum=0.005,
        maximum=1.0,
    ),
)

PRESENCE_SETTINGS = (
    Setting(
        'presence.button',
        int,
        'index in `buttons` of `joy` of the button that is held while the surgeon is present',
        default=0,
        minimum=0,
        maximum=63,
    ),
    Setting(
        'presence.clutch_button',
        int,
        'index of the button that is the clutch; -1: none',
        default=-1,
        minimum=-1,
        maximum=63,
    ),
    Setting(
        'presence.rate',
        float,
        'rate at which presence and clutch are repeated, Hz',
        default=20.0,
        minimum=4.0,
        maximum=1000.0,
    ),
    Setting(
        'presence.joy_timeout',
        float,
        'time without `joy` after which no button is pressed, '
        's; 0: any, for a joystick that publishes changes only: one that hangs or is killed '
        'then counts as held until DDS drops it, 20 s',
        default=0.5,
        minimum=0.0,
        maximum=10.0,
    ),
)

VIEW_SETTINGS = (
    Setting(
        'view.host',
        str,
        'address at which the page is served; 0.0.0.0: to every host that reaches this one',
        default='127.0.0.1',
    ),
    Setting(
        'view.hosts',
        str,
        'further names of this host, with commas between them, under which '
        'browsers may open the page: of a proxy, or in the DNS',
        default='',
        blank=True,
    ),
    Setting(
        'view.port',
        int,
        'port of the page; where it is taken, the next free one',
        default=8080,
        minimum=1024,
        maximum=65535,
    ),
    Setting(
        'view.process',
        int,
        'number of a process with which view ends; 0: none',
        default=0,
        minimum=0,
    ),
)

EACH = 'one value for all drives, or one for each'
DRIVE_SETTINGS = (
    Setting('drives.interface', str, 'python-can interface of the drives', default='socketcan'),
    Setting(
        'drives.channel',
        str,
        "channel of that interface, such as 'can1'; that of the "
        'encoders for one bus; empty: no drives',
        default='',
        blank=True,
    ),
    Setting(
        'drives.bitrate',
        int,
        'bit rate of the bus, bit/s, to set it (if the interface can) '
        'and to check the bus load; 0: unknown',
        default=0,
        minimum=0,
        maximum=1000000,
    ),
    Setting(
        'drives.node_id',
        int,
        'CANopen node ids of the drives of th1A, th1B, th1C and, with four motors, th3A',
        default=(11, 12, 13),
        minimum=1,
        maximum=127,
        count=ANY_COUNT,
    ),
    Setting(
        'drives.master_id',
        int,
        'node id of this master in its heartbeat',
        default=126,
        minimum=1,
        maximum=127,
    ),
    Setting(
        'drives.combined',
        bool,
        'one frame with all torques, and the controlwords apart: for a bus with the encoders',
        default=False,
    ),
    Setting(
        'drives.mode',
        int,
        'mode of operation 6060h: 10 cyclic synchronous torque, 4 profile '
        'torque; 0: 10, or 4 where it is missing',
        default=0,
        allowed=(0, 10, 4),
    ),
    Setting(
        'drives.rated_torque',
        float,
        f'rated torque of the motor, N m: torques on the bus '
        f'are per mille of it; {EACH}; has to be given with drives.channel',
        default=(0.0,),
        minimum=0.0,
        maximum=100.0,
        count=ANY_COUNT,
    ),
    Setting(
        'drives.torque_unit',
        float,
        'unit of 6076h, rated torque, N m: 0.001 by CiA 402, '
        '0.000001 of drives that have uN m; 0: the drives have no such object, or it is no '
        'torque; drives.rated_torque is not compared then',
        default=1e-3,
        minimum=0.0,
        maximum=1.0,
    ),
    Setting(
        'drives.gear',
        float,
        f'turns of the motor for one of the joint; {EACH}',
        default=(1.0,),
        minimum=0.01,
        maximum=1000.0,
        count=ANY_COUNT,
    ),
    Setting(
        'drives.direction',
        int,
        f'sign of the torque of a motor against that of the joint; {EACH}',
        default=(1,),
        allowed=(1, -1),
        count=ANY_COUNT,
    ),
    Setting(
        'drives.torque_limit',
        float,
        'largest torque at a joint, N m: commands are limited to it, and 6072h of the drives is',
        default=0.5,
        minimum=0.001,
        maximum=100.0,
    ),
    Setting(
        'drives.speed_limit',
        float,
        'largest speed of a joint, rad/s, for 6080h in 1/min of the motor; 0: 6080h is left',
        default=0.0,
        minimum=0.0,
        maximum=1000.0,
    ),
    Setting(
        'drives.status_period',
        float,
        'time between two status frames of a drive, s, whole ms',
        default=0.004,
        minimum=0.001,
        maximum=0.1,
    ),
    Setting(
        'drives.status_timeout',
        float,
        'time without a status frame that is a fault, s',
        default=0.02,
        minimum=0.002,
        maximum=1.0,
    ),
    Setting(
        'drives.heartbeat',
        float,
        'time between two heartbeats, of the drives and of this master, s, whole ms',
        default=0.02,
        minimum=0.001,
        maximum=1.0,
    ),
    Setting(
        'drives.heartbeat_timeout',
        float,
        'time without a heartbeat after which a drive '
        'disables its motor, and which is a fault here, s, whole ms',
        default=0.06,
        minimum=0.002,
        maximum=1.0,
    ),
    Setting(
        'drives.event_timer',
        float,
        'time without a torque frame after which a drive '
        'disables its motor (1400h:05), s, whole ms; 0: the drives have no such timer, the '
        'heartbeat has to do',
        default=0.01,
        minimum=0.0,
        maximum=1.0,
    ),
    Setting(
        'drives.status_by',
        str,
        "what the drives send their status frames by: 'timer', their event timer (1800h:05); "
        "'sync': SYNC of this master, every drives.status_period; 'encoder_sync': the SYNC of "
        'the encoders, on one bus with them',
        default='timer',
        allowed=('timer', 'sync', 'encoder_sync'),
    ),
    Setting(
        'drives.verified_by_hand',
        str,
        "objects that the drives lack, and what they would do was verified by hand: '0x6072:00', "
        "their own torque limit; '0x1400:05' (combined: '0x1401:05'), the event timer of the "
        'torque frames',
        default='',
        blank=True,
    ),
    Setting(
        'drives.check_file',
        str,
        'file of the passed force_check of these drives, which force_check --record --output '
        'writes: without it, or with other drives, no torque; has to be given with drives.channel',
        default='',
        blank=True,
    ),
)

# Parameters that rclpy declares on every node.
ROS_SETTINGS = (
    Setting('use_sim_time', bool, 'whether the time is that of the topic /clock'),
    Setting('start_type_description_service', bool, 'whether the node describes its types'),
)

DRIVER_SETTINGS = (
    SOURCE_SETTING,
    *{setting.name: setting for source in SOURCE_SETTINGS.values() for setting in source}.values(),
)
# Settings of each node, beside those of its process.
NODE_SETTINGS = {
    'encoder_driver': DRIVER_SETTINGS,
    'fkm': (*FKM_SETTINGS, *DRIVE_SETTINGS),
    'diagnostics': DIAGNOSTICS_SETTINGS,
    'teleop': TELEOP_SETTINGS,
    'sim_slave': SLAVE_SETTINGS,
    'recorder': RECORDER_SETTINGS,
    'view': VIEW_SETTINGS,
    'presence': PRESENCE_SETTINGS,
}


def process_settings(name: str) -> tuple[Setting, ...]:
    """
    Return the settings of a process that runs nodes, by the name of its executable.

    Parameters
    ----------
    name : str
        Name of an executable; `master` runs the nodes of PIPELINE and `teleop`.

    Returns
    -------
    tuple of Setting
        Each setting once, those of the process (`realtime.*` and ROS's own) at the end.

    """
    nodes = (*PIPELINE, FOLLOWER) if name == 'master' else (name,)
    found = {
        setting.name: setting
        for node in nodes
        for setting in NODE_SETTINGS.get(node, (RATE_SETTING,))
    }
    if name == 'master':
        found |= {setting.name: setting for setting in MASTER_SETTINGS}
    return (*found.values(), *REALTIME_SETTINGS, *ROS_SETTINGS)


# Names of the parameters of the encoder driver, of the drives, and of all nodes.
DRIVER_NAMES = {setting.name for setting in DRIVER_SETTINGS}
DRIVE_NAMES = {setting.name for setting in DRIVE_SETTINGS}
ALL_NAMES = {
    setting.name for node in ('master', *NODE_SETTINGS) for setting in process_settings(node)
}
# Names in which two files have to agree: the bus, and how the encoders are read. What a
# calibration measures is its own.
BUS_AND_LAYOUT = {
    SOURCE_SETTING.name,
    *(
        setting.name
        for setting in encoders.CAN_SETTINGS
        if setting not in encoders.MEASURED_SETTINGS and setting != CALIBRATION_SETTING
    ),
}
