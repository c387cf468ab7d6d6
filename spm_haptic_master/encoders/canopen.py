# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
CANopen for encoders: frames, states and error codes of CiA 301, objects of CiA 406.

Only constants and pure functions: they build frames, and read their bytes.
"""

from __future__ import annotations

from collections.abc import Mapping

import can

# Identifiers of the predefined connection set (CiA 301, 7.3); with _BASE, the node id is added.
NMT_ID = 0x000
SYNC_ID = 0x080
EMCY_BASE = 0x080
SDO_ANSWER_BASE = 0x580
SDO_REQUEST_BASE = 0x600
HEARTBEAT_BASE = 0x700
# Those of TPDO1 to TPDO4 and of RPDO1 to RPDO4, to which the node id is added.
TPDO_BASES = (0x180, 0x280, 0x380, 0x480)
RPDO_BASES = (0x200, 0x300, 0x400, 0x500)
# Names of these frames, alone and of (or to) a node; LSS are those of CiA 305, for node ids.
SINGLE_FRAMES = {
    NMT_ID: 'NMT',
    SYNC_ID: 'SYNC',
    0x100: 'TIME',
    0x7E4: 'LSS',
    0x7E5: 'LSS',
}
NODE_FRAMES = {
    EMCY_BASE: 'EMCY of',
    SDO_ANSWER_BASE: 'SDO answer of',
    SDO_REQUEST_BASE: 'SDO request to',
    HEARTBEAT_BASE: 'heartbeat of',
    **{base: f'TPDO{number} of' for number, base in enumerate(TPDO_BASES, 1)},
}
# Largest node id.
NODE_ID_MAXIMUM = 127

# Data lengths (bytes). SYNC is empty or carries a one-byte counter (CiA 301, 7.2.5).
SYNC_MAXIMUM_LENGTH = 1
EMCY_LENGTH = 8
HEARTBEAT_LENGTH = 1
SDO_LENGTH = 8

# NMT commands.
NMT_START = 0x01
NMT_STOP = 0x02
NMT_PRE_OPERATIONAL = 0x80
NMT_RESET_NODE = 0x81
NMT_RESET_COMMUNICATION = 0x82
# NMT states as a heartbeat reports them; a boot-up message has the form of a heartbeat.
BOOT_UP = 0x00
STOPPED = 0x04
OPERATIONAL = 0x05
PRE_OPERATIONAL = 0x7F
STATE_WORDS = {
    BOOT_UP: 'booting',
    STOPPED: 'stopped',
    OPERATIONAL: 'operational',
    PRE_OPERATIONAL: 'pre-operational',
}

# Objects that identify a node: index and subindex; names of those beside the device type.
DEVICE_TYPE = (0x1000, 0)
ERROR_REGISTER = (0x1001, 0)
VENDOR_ID = (0x1018, 1)
PRODUCT_CODE = (0x1018, 2)
REVISION = (0x1018, 3)
SERIAL_NUMBER = (0x1018, 4)
IDENTITY = {
    VENDOR_ID: 'vendor',
    PRODUCT_CODE: 'product',
    REVISION: 'revision',
    SERIAL_NUMBER: 'serial',
}
# Objects of SYNC: its identifier, the supervised period (us), the largest value of its counter.
SYNC_IDENTIFIER = (0x1005, 0)
SYNC_PERIOD = (0x1006, 0)
SYNC_COUNTER = (0x1019, 0)
# Bit of the identifier of SYNC: the node makes SYNC itself.
SYNC_PRODUCED = 1 << 30
# Objects of communication: storing, heartbeat time (ms), parameters and mapping of RPDO1, TPDO1.
STORE = (0x1010, 1)
HEARTBEAT_TIME = (0x1017, 0)
RPDO_PARAMETERS = 0x1400
RPDO_MAPPING = 0x1600
TPDO_PARAMETERS = 0x1800
TPDO_MAPPING = 0x1A00
# Subindices of a TPDO's parameters.
TPDO_IDENTIFIER = 1
TPDO_TYPE = 2
TPDO_INHIBIT_TIME = 3
TPDO_EVENT_TIMER = 5
# Value that stores all parameters: "save" in ASCII, lowest byte first.
SAVE = int.from_bytes(b'save', 'little')
# Bits of the object that stores: on command, and by itself.
STORES = 0b11
# Bits of a TPDO's identifier: the TPDO is off; no remote request; 29 bits; the identifier itself.
TPDO_OFF = 1 << 31
TPDO_NO_REQUEST = 1 << 30
TPDO_EXTENDED = 1 << 29
TPDO_ID_MASK = (1 << 29) - 1
# Transmission types: after every SYNC, and on events of the device.
EVERY_SYNC = 1
EVENT_DRIVEN = 254
# Objects of an encoder (CiA 406): operating parameters, units per turn, total range, position,
# cyclic timer (ms), units per turn of the disc itself.
OPERATING_PARAMETERS = (0x6000, 0)
UNITS_PER_TURN = (0x6001, 0)
TOTAL_RANGE = (0x6002, 0)
POSITION = (0x6004, 0)
CYCLIC_TIMER = (0x6200, 0)
DISC_UNITS_PER_TURN = (0x6501, 0)
# Bit of the operating parameters: the scaling of 0x6001 and 0x6002 is on.
SCALING_ON = 1 << 2
# Device profiles of encoders (CiA 406) and drives (CiA 402): the low 16 bits of the device type.
ENCODER_PROFILE = 406
DRIVE_PROFILE = 402
PROFILES = {
    ENCODER_PROFILE: 'encoder',
    DRIVE_PROFILE: 'drive',
}
# Numbers of devices with one node id, in words.
DEVICES = {
    2: 'two',
    3: 'three',
    4: 'four',
    5: 'five',
    6: 'six',
}

# Command bytes of an SDO: upload, expedited download of four bytes (with the number of unused
# bytes in bits 2 and 3) and its answer, abort.
SDO_UPLOAD_REQUEST = 0x40
# Answer to an upload, expedited, with the number of unused bytes in bits 2 and 3.
SDO_UPLOAD_ANSWER = 0x43
SDO_DOWNLOAD_REQUEST = 0x23
SDO_DOWNLOAD_ANSWER = 0x60
SDO_ABORT = 0x80
# Abort codes of an SDO.
SDO_UNKNOWN_COMMAND = 0x05040001
SDO_READ_ONLY = 0x06010002
SDO_NO_SUCH_OBJECT = 0x06020000
SDO_WRONG_LENGTH = 0x06070010
SDO_NO_SUCH_SUBINDEX = 0x06090011
SDO_WRONG_VALUE = 0x06090030
SDO_NOT_STORED = 0x08000020
SDO_WRONG_STATE = 0x08000022

# Classes of emergency error codes, by their high byte (CiA 301, table 26).
EMCY_CLASSES = {
    0x00: 'error reset',
    0x10: 'generic error',
    0x20: 'current',
    0x21: 'current, input side',
    0x22: 'current inside the device',
    0x23: 'current, output side',
    0x30: 'voltage',
    0x31: 'mains voltage',
    0x32: 'voltage inside the device',
    0x33: 'output voltage',
    0x40: 'temperature',
    0x41: 'ambient temperature',
    0x42: 'device temperature',
    0x50: 'device hardware',
    0x60: 'device software',
    0x61: 'internal software',
    0x62: 'user software',
    0x63: 'data set',
    0x70: 'additional modules',
    0x80: 'monitoring',
    0x81: 'communication',
    0x82: 'protocol error',
    0x90: 'external error',
    0xF0: 'additional functions',
    0xFF: 'device specific',
}
# Emergency error codes with a meaning of their own (CiA 301, table 26).
EMCY_CODES = {
    0x8110: 'CAN overrun (objects lost)',
    0x8120: 'CAN in error passive mode',
    0x8130: 'life guard or heartbeat error',
    0x8140: 'recovered from bus-off',
    0x8150: 'identifier collision',
    0x8210: 'PDO not processed due to length error',
    0x8220: 'PDO length exceeded',
    0x8240: 'unexpected SYNC length',
    0x8250: 'RPDO timeout',
}
# Emergency error code that reports the end of an error.
EMCY_ERROR_RESET = 0x0000
# Class of errors of communication, which a missing SYNC is one of.
EMCY_COMMUNICATION = 0x81
# Bits of the error register (CiA 301, table 27).
REGISTER_WORDS = {
    0x01: 'generic',
    0x02: 'current',
    0x04: 'voltage',
    0x08: 'temperature',
    0x10: 'communication',
    0x20: 'device profile',
    0x80: 'manufacturer',
}


def frame_name(identifier: int) -> str | None:
    """
    Return the name of an identifier in the predefined connection set (CiA 301, 7.3).

    Parameters
    ----------
    identifier : int
        Identifier of 11 bits.

    Returns
    -------
    str or None
        Such as 'heartbeat of node 5'; None for an identifier that the set does not have.

    """
    node_id = identifier & NODE_ID_MAXIMUM
    base = identifier - node_id
    if node_id and base in NODE_FRAMES:
        return f'{NODE_FRAMES[base]} node {node_id}'
    return SINGLE_FRAMES.get(identifier)


def reserved_for(identifier: int) -> str | None:
    """Return what CANopen uses an 11-bit identifier for, None if a PDO may have it."""
    name = frame_name(identifier)
    if name is None or name.startswith('TPDO'):
        return None
    return name


def frame(
    identifier: int,
    data: bytes = b'',
    stamp: float = 0.0,
) -> can.Message:
    """
    Return a data frame with an 11-bit identifier.

    Parameters
    ----------
    identifier : int
        The identifier.
    data : bytes
        At most eight bytes.
    stamp : float
        Time, s; 0 for a frame to be sent.

    """
    return can.Message(stamp, identifier, is_extended_id=False, data=data)


def nmt(command: int, node_id: int) -> can.Message:
    """
    Return an NMT command.

    Parameters
    ----------
    command : int
        One of NMT_START to NMT_RESET_COMMUNICATION.
    node_id : int
        Node that it is for; 0 for all nodes.

    """
    return frame(NMT_ID, bytes((command, node_id)))


def emcy(
    node_id: int,
    code: int,
    register: int,
) -> can.Message:
    """
    Return an emergency message (CiA 301, 7.2.7).

    Parameters
    ----------
    node_id : int
        Node that sends it.
    code : int
        Error code, 16 bits; EMCY_ERROR_RESET for the end of an error.
    register : int
        Error register (1001h), 8 bits.

    """
    data = code.to_bytes(2, 'little')
    data += bytes((register,))
    data += bytes(5)  # manufacturer-specific
    return frame(EMCY_BASE + node_id, data)


def emcy_code(data: bytes | bytearray) -> int:
    """Return the error code of an emergency message."""
    return int.from_bytes(data[:2], 'little')


def emcy_is_over(data: bytes | bytearray) -> bool:
    """
    Return whether an emergency message reports that no error is left.

    A code 00xxh reports the end of one error; the error register has those that remain
    (CiA 301, 7.2.7.1).
    """
    return emcy_code(data) >> 8 == EMCY_ERROR_RESET and not data[2]


def register_words(register: int) -> str:
    """Return an error register in words, with the classes of its errors."""
    words = [word for bit, word in REGISTER_WORDS.items() if register & bit]
    return f'error register 0x{register:02X} ({", ".join(words) or "reserved bits"})'


def emcy_words(data: bytes | bytearray, codes: Mapping[int, str] = EMCY_CODES) -> str:
    """
    Return an emergency in words: code, class, error register, manufacturer-specific bytes.

    Parameters
    ----------
    data : bytes
        The eight bytes of the message.
    codes : mapping of int to str
        Words of codes with a meaning of their own; others get the words of their class.

    """
    code = emcy_code(data)
    words = codes.get(code) or EMCY_CLASSES.get(code >> 8, 'code not in CiA 301')
    text = f'EMCY 0x{code:04X} {words}, error register 0x{data[2]:02X}'
    if code >> 8 == EMCY_ERROR_RESET and data[2]:
        text += ': another error remains'
    specific = bytes(data[3:])
    if any(specific):
        text += f', specific {specific.hex(" ")}'
    return text


def shared_node_id(node_id: int, devices: int) -> str:
    """Return in words that several devices have one node id, and what to do."""
    return (
        f'{DEVICES.get(devices, devices)} devices have node id {node_id}: give each its own, '
        'one at a time on the bus (switches, LSS or a tool of the maker)'
    )


def state_word(state: int) -> str:
    """Return the word for an NMT state; bit 7, node guarding's toggle bit, is ignored."""
    return STATE_WORDS.get(state & 0x7F, f'in unknown state 0x{state:02X}')


def sdo(
    identifier: int,
    command: int,
    index: int,
    subindex: int,
    value: int = 0,
) -> can.Message:
    """
    Return an SDO frame of an expedited transfer: a request, or an answer (CiA 301).

    Parameters
    ----------
    identifier : int
        Identifier of request or answer, with the node id.
    command : int
        Command byte.
    index, subindex : int
        The object.
    value : int
        Value, 32 bits; with SDO_ABORT the abort code.

    """
    data = bytes((command,))
    data += index.to_bytes(2, 'little')
    data += bytes((subindex,))
    data += value.to_bytes(4, 'little')
    return frame(identifier, data)


def sdo_upload(
    node_id: int,
    index: int,
    subindex: int,
) -> can.Message:
    """Return the SDO request for an object's value."""
    return sdo(SDO_REQUEST_BASE + node_id, SDO_UPLOAD_REQUEST, index, subindex)


def sdo_write(
    node_id: int,
    index: int,
    subindex: int,
    value: int,
    size: int,
) -> can.Message:
    """
    Return the SDO request of an expedited download.

    Parameters
    ----------
    node_id : int
        Node that it is for.
    index, subindex : int
        The object.
    value : int
        Unsigned value.
    size : int
        Size of the object, one to four bytes.

    """
    return sdo(
        identifier=SDO_REQUEST_BASE + node_id,
        command=SDO_DOWNLOAD_REQUEST | 4 - size << 2,
        index=index,
        subindex=subindex,
        value=value,
    )


def sdo_answer(
    node_id: int,
    index: int,
    subindex: int,
    value: int,
    size: int = 4,
) -> can.Message:
    """
    Return the expedited answer to an SDO upload.

    Parameters
    ----------
    node_id : int
        Node that answers.
    index, subindex : int
        The object.
    value : int
        Unsigned value.
    size : int
        Size of the object, one to four bytes.

    """
    return sdo(
        identifier=SDO_ANSWER_BASE + node_id,
        command=SDO_UPLOAD_ANSWER | 4 - size << 2,
        index=index,
        subindex=subindex,
        value=value,
    )


def object_name(index: int, subindex: int) -> str:
    """Return an object as it is usually written, such as '0x1018:04'."""
    return f'0x{index:04X}:{subindex:02X}'


def sdo_object(data: bytes | bytearray) -> tuple[int, int]:
    """Return the index and subindex of an SDO frame's object."""
    return int.from_bytes(data[1:3], 'little'), data[3]


def sdo_value(data: bytes | bytearray) -> int | None:
    """
    Return the value in the answer to an expedited upload.

    Parameters
    ----------
    data : bytes
        The eight bytes of an SDO frame.

    Returns
    -------
    int or None
        Unsigned value; None for any other SDO frame.

    """
    if data[0] & 0xE2 != 0x42:
        return None
    # Bit 0 set: bits 2 and 3 hold the number of unused bytes.
    unused = 0
    if data[0] & 1:
        unused = data[0] >> 2 & 3
    return int.from_bytes(data[4 : SDO_LENGTH - unused], 'little')


def sdo_download(data: bytes | bytearray) -> bytes | None:
    """
    Return the value in a request of an expedited download.

    Parameters
    ----------
    data : bytes
        The eight bytes of an SDO frame.

    Returns
    -------
    bytes or None
        One to four bytes; None for any other SDO frame, and for one without the size.

    """
    # Bits 2 and 3 hold the number of unused bytes.
    if data[0] & 0xF3 != SDO_DOWNLOAD_REQUEST:
        return None
    unused = data[0] >> 2 & 3
    return bytes(data[4 : SDO_LENGTH - unused])
