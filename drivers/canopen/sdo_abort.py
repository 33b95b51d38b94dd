"""SDO abort codes in words (CiA 301, 7.2.4.3.17), and the errors that a client ends with."""

from __future__ import annotations

from drivers.canopen.abort import AbortCode

ABORT_TEXT = {
    0x0503_0000: "toggle bit not alternated",
    0x0504_0000: "SDO protocol timed out",
    0x0504_0001: "command specifier not valid or unknown",
    0x0504_0002: "invalid block size",
    0x0504_0003: "invalid sequence number",
    0x0504_0004: "CRC error",
    0x0504_0005: "out of memory",
    0x0601_0000: "unsupported access to an object",
    0x0601_0001: "attempt to read a write-only object",
    0x0601_0002: "attempt to write a read-only object",
    0x0602_0000: "object does not exist in the object dictionary",
    0x0604_0041: "object cannot be mapped to the PDO",
    0x0604_0042: "number and length of the objects to be mapped would exceed the PDO length",
    0x0604_0043: "general parameter incompatibility",
    0x0604_0047: "general internal incompatibility in the device",
    0x0606_0000: "access failed due to a hardware error",
    0x0607_0010: "data type does not match, length of service parameter does not match",
    0x0607_0012: "data type does not match, length of service parameter too high",
    0x0607_0013: "data type does not match, length of service parameter too low",
    0x0609_0011: "subindex does not exist",
    0x0609_0030: "value of parameter invalid",
    0x0609_0031: "value of parameter written too high",
    0x0609_0032: "value of parameter written too low",
    0x0609_0036: "maximum value is less than minimum value",
    0x060A_0023: "resource not available: SDO connection",
    0x0800_0000: "general error",
    0x0800_0020: "data cannot be transferred or stored to the application",
    0x0800_0021: "data cannot be transferred or stored to the application because of local control",
    0x0800_0022: "data cannot be transferred or stored to the application because of the present device state",
    0x0800_0023: "no object dictionary is present",
    0x0800_0024: "no data available",
}


class StepError(Exception):
    """A step of a sequence failed: what was `expected` and what `came`, in words; `code` if the device gave one."""

    def __init__(self, expected: str, came: str, code: int = 0) -> None:
        super().__init__(f"expected {expected}, came {came}")
        self.expected = expected
        self.came = came
        self.code = int(code)


class SdoAborted(StepError):
    """The transfer was aborted, by the server or (a broken protocol) by this client; `code` as in CiA 301."""

    def __init__(self, code: int, index: int, subindex: int) -> None:
        self.index = index
        self.subindex = subindex
        self.text = ABORT_TEXT.get(code, "unknown abort code")
        super().__init__(f"SDO access to {index:04X}h sub {subindex}", f"abort {code:08X}h: {self.text}", code)


class SdoTimeout(StepError):
    """No answer within the time-out, `attempts` times."""

    def __init__(self, index: int, subindex: int, attempts: int, timeout_ns: int) -> None:
        self.index = index
        self.subindex = subindex
        self.attempts = attempts
        super().__init__(
            f"an answer to the SDO request for {index:04X}h sub {subindex} within {timeout_ns / 1e6:g} ms",
            f"none, {attempts} times",
            int(AbortCode.TIMED_OUT),
        )
