# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANopen as four encoders need it: frames and words of CiA 301 (and CiA 406's objects)."""

from __future__ import annotations

import can

# CiA 301, 7.3: the predefined connection set. A node's identifier is the base plus its node id.
NMT_ID = 0x000
SYNC_ID = 0x080
EMCY_BASE = 0x080
TPDO1_BASE = 0x180
SDO_ANSWER_BASE = 0x580
SDO_REQUEST_BASE = 0x600
HEARTBEAT_BASE = 0x700
NODE_ID_MAXIMUM = 127

# CiA 301, 7.2.5: SYNC is empty or carries a one-byte counter.
SYNC_MAXIMUM_LENGTH = 1
EMCY_LENGTH = 8
HEARTBEAT_LENGTH = 1
SDO_LENGTH = 8

# NMT commands, and the states that a heartbeat tells.
NMT_START = 0x01
NMT_STOP = 0x02
NMT_PRE_OPERATIONAL = 0x80
NMT_RESET_NODE = 0x81
NMT_RESET_COMMUNICATION = 0x82
BOOT_UP = 0x00
STOPPED = 0x04
OPERATIONAL = 0x05
PRE_OPERATIONAL = 0x7F
STATE_WORDS = {BOOT_UP: 'booting', STOPPED: 'stopped', OPERATIONAL: 'operational',
               PRE_OPERATIONAL: 'pre-operational'}

# Objects that tell who a node is.
DEVICE_TYPE = (0x1000, 0)
VENDOR_ID = (0x1018, 1)
PRODUCT_CODE = (0x1018, 2)
REVISION = (0x1018, 3)
SERIAL_NUMBER = (0x1018, 4)
# Low 16 bits of the device type of an encoder: its profile, CiA 406.
ENCODER_PROFILE = 406

# SDO: expedited transfer of up to four bytes.
SDO_UPLOAD_REQUEST = 0x40
SDO_ABORT = 0x80
SDO_NO_SUCH_OBJECT = 0x06020000
SDO_NO_SUCH_SUBINDEX = 0x06090011
SDO_READ_ONLY = 0x06010002
SDO_UNKNOWN_COMMAND = 0x05040001

# CiA 301, table 26: the class of an emergency error code by its high byte.
EMCY_CLASSES = {
    0x00: 'error reset', 0x10: 'generic error',
    0x20: 'current', 0x21: 'current, input side', 0x22: 'current inside the device',
    0x23: 'current, output side',
    0x30: 'voltage', 0x31: 'mains voltage', 0x32: 'voltage inside the device',
    0x33: 'output voltage',
    0x40: 'temperature', 0x41: 'ambient temperature', 0x42: 'device temperature',
    0x50: 'device hardware',
    0x60: 'device software', 0x61: 'internal software', 0x62: 'user software', 0x63: 'data set',
    0x70: 'additional modules',
    0x80: 'monitoring', 0x81: 'communication', 0x82: 'protocol error',
    0x90: 'external error', 0xF0: 'additional functions', 0xFF: 'device specific',
}
EMCY_CODES = {
    0x8110: 'CAN overrun (objects lost)', 0x8120: 'CAN in error passive mode',
    0x8130: 'life guard or heartbeat error', 0x8140: 'recovered from bus-off',
    0x8150: 'identifier collision', 0x8210: 'PDO not processed due to length error',
    0x8220: 'PDO length exceeded', 0x8240: 'unexpected SYNC length', 0x8250: 'RPDO timeout',
}
EMCY_ERROR_RESET = 0x0000


def frame(identifier: int, data: bytes = b'') -> can.Message:
    """Return a data frame with an 11-bit identifier."""
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


def nmt(command: int, node_id: int) -> can.Message:
    """Return the network management command to one node (0: to all)."""
    return frame(NMT_ID, bytes((command, node_id)))


def emcy(node_id: int, code: int, register: int, specific: bytes = b'') -> can.Message:
    """Return an emergency message; `specific` are up to five bytes of the manufacturer's."""
    return frame(EMCY_BASE + node_id,
                 code.to_bytes(2, 'little') + bytes((register,)) + specific.ljust(5, b'\0'))


def emcy_code(data: bytes | bytearray) -> int:
    """Return the error code of an emergency message."""
    return int.from_bytes(data[:2], 'little')


def emcy_words(data: bytes | bytearray) -> str:
    """Return what an emergency message says: code, its class, register, the maker's bytes."""
    code = emcy_code(data)
    words = EMCY_CODES.get(code) or EMCY_CLASSES.get(code >> 8, 'code not in CiA 301')
    text = f'EMCY 0x{code:04X} {words}, error register 0x{data[2]:02X}'
    specific = bytes(data[3:])
    return text + (f', specific {specific.hex(" ")}' if any(specific) else '')


def state_word(state: int) -> str:
    """Return the word for an NMT state; bit 7 (toggle, of node guarding) does not count."""
    return STATE_WORDS.get(state & 0x7F, f'in unknown state 0x{state:02X}')


def sdo_upload(node_id: int, index: int, subindex: int) -> can.Message:
    """Return the request for an object's value."""
    return frame(SDO_REQUEST_BASE + node_id, bytes((SDO_UPLOAD_REQUEST,))
                 + index.to_bytes(2, 'little') + bytes((subindex, 0, 0, 0, 0)))


def sdo_object(data: bytes | bytearray) -> tuple[int, int]:
    """Return the index and subindex that an SDO frame speaks of."""
    return int.from_bytes(data[1:3], 'little'), data[3]


def sdo_value(data: bytes | bytearray) -> int | None:
    """Return the value in an expedited upload's answer; None for an abort or another kind."""
    command = data[0]
    if command & 0xE2 != 0x42:
        return None
    # Bit 0: the number of unused bytes stands in bits 2 and 3.
    length = 4 - (command >> 2 & 3) if command & 1 else 4
    return int.from_bytes(data[4:4 + length], 'little')


def sdo_answer(node_id: int, index: int, subindex: int, value: int) -> can.Message:
    """Return the expedited answer with an UNSIGNED32."""
    return frame(SDO_ANSWER_BASE + node_id, b'\x43' + index.to_bytes(2, 'little')
                 + bytes((subindex,)) + value.to_bytes(4, 'little'))


def sdo_abort(node_id: int, index: int, subindex: int, code: int) -> can.Message:
    """Return the refusal of a request."""
    return frame(SDO_ANSWER_BASE + node_id, bytes((SDO_ABORT,)) + index.to_bytes(2, 'little')
                 + bytes((subindex,)) + code.to_bytes(4, 'little'))
