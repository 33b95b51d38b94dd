"""Why an SDO transfer was refused: abort codes of CiA 301, table 22."""

from __future__ import annotations

from enum import IntEnum


class AbortCode(IntEnum):
    """The last four bytes of an abort frame."""

    TOGGLE_BIT = 0x0503_0000
    TIMED_OUT = 0x0504_0000
    UNKNOWN_COMMAND = 0x0504_0001
    OUT_OF_MEMORY = 0x0504_0005
    UNSUPPORTED_ACCESS = 0x0601_0000
    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_SUCH_OBJECT = 0x0602_0000
    NOT_MAPPABLE = 0x0604_0041
    PDO_TOO_LONG = 0x0604_0042
    PARAMETER_INCOMPATIBLE = 0x0604_0043
    LENGTH_MISMATCH = 0x0607_0010
    LENGTH_TOO_HIGH = 0x0607_0012
    LENGTH_TOO_LOW = 0x0607_0013
    NO_SUCH_SUBINDEX = 0x0609_0011
    INVALID_VALUE = 0x0609_0030
    VALUE_TOO_HIGH = 0x0609_0031
    VALUE_TOO_LOW = 0x0609_0032
    MAXIMUM_BELOW_MINIMUM = 0x0609_0036
    GENERAL = 0x0800_0000
    DEVICE_STATE = 0x0800_0022
    NO_DATA = 0x0800_0024


class SdoAbort(Exception):
    """Access to an object was refused; `code` goes on the wire, the text says what would have been right."""

    def __init__(self, code: AbortCode, reason: str = "") -> None:
        super().__init__(f"{reason or code.name.lower()} ({code:08X}h)")
        self.code = code
