"""Many frames as arrays, and their process data decoded column by column."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.checksum import crc8_j1850, start_value
from drivers.frame import Frame
from drivers.objects import DataType, DeviceDef, ObjectDef, PdoDef, PdoKind
from logs.tape import SYNC_ID
from stack.messages import Matrix

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class FrameBatch:
    """Frames in wire order: `can_id`, `t_ns`, `length` (n,), `payload` (n, 8) bytes, unused ones 0."""

    can_id: Ints
    t_ns: Ints
    length: Ints
    payload: NDArray[np.uint8]

    @staticmethod
    def of(frames: Sequence[Frame]) -> FrameBatch:
        """The arrays of a list of frames."""
        n = len(frames)
        joined = b"".join([frame.data.ljust(8, b"\0") for frame in frames])
        return FrameBatch(
            can_id=np.fromiter((frame.can_id for frame in frames), np.int64, n),
            t_ns=np.fromiter((frame.t_ns for frame in frames), np.int64, n),
            length=np.fromiter((len(frame.data) for frame in frames), np.int64, n),
            payload=np.frombuffer(joined, np.uint8).reshape(n, 8),
        )

    @staticmethod
    def joined(batches: Sequence[FrameBatch]) -> FrameBatch:
        """One batch of several, in their order."""
        return FrameBatch(
            can_id=np.concatenate([batch.can_id for batch in batches]),
            t_ns=np.concatenate([batch.t_ns for batch in batches]),
            length=np.concatenate([batch.length for batch in batches]),
            payload=np.concatenate([batch.payload for batch in batches]),
        )

    def sync_times(self) -> Ints:
        """Times of the SYNC frames."""
        times: Ints = self.t_ns[self.can_id == SYNC_ID]
        return times

    def rows(self, can_id: int, length: int | None = None) -> Ints:
        """Indices of the frames with this identifier, and of this length if one is asked for."""
        found = self.can_id == can_id
        if length is not None:
            found &= self.length == length
        return np.flatnonzero(found)


@dataclass(frozen=True, slots=True)
class PdoLayout:
    """Where the mapped objects of a PDO lie in its bytes: bit offset, bits, type and scale of each, from its device."""

    can_id: int
    length: int
    names: tuple[str, ...]
    offsets: tuple[int, ...]
    types: tuple[DataType, ...]
    scales: tuple[float, ...]

    @staticmethod
    def of(device: DeviceDef, pdo: PdoDef) -> PdoLayout:
        """The layout of one PDO of `device`. Raises ValueError for one that does not fit in 8 bytes."""
        objects = [device.object(*key) for key in pdo.mapping]
        ends = np.cumsum([entry.data_type.bits for entry in objects]).tolist()
        if ends and ends[-1] > 64:
            raise ValueError(f"{device.name}: PDO {pdo.cob_id:03X}h maps {ends[-1]} bits, at most 64 fit")
        return PdoLayout(
            can_id=pdo.cob_id & 0x7FF,
            length=((ends[-1] if ends else 0) + 7) // 8,
            names=tuple(entry.name for entry in objects),
            offsets=(0, *ends[:-1]),
            types=tuple(entry.data_type for entry in objects),
            scales=tuple(_si_scale(device, entry) for entry in objects),
        )

    def raw(self, payload: NDArray[np.uint8], position: int) -> NDArray[np.int64 | np.float32 | np.float64]:
        """Wire values (n,) of the mapped object at `position`, for payloads (n, 8)."""
        words = np.ascontiguousarray(payload).view("<u8").reshape(-1)
        bits = self.types[position].bits
        kind = self.types[position]
        shifted = words << np.uint64(64 - bits - self.offsets[position])
        if kind is DataType.REAL32:
            return (shifted >> np.uint64(32)).astype(np.uint32).view(np.float32)
        if kind is DataType.REAL64:
            return shifted.view(np.float64)
        if kind.signed:
            return shifted.view(np.int64) >> np.int64(64 - bits)  # arithmetic shift: the sign comes along
        return (shifted >> np.uint64(64 - bits)).astype(np.int64)

    def values(self, payload: NDArray[np.uint8], positions: Iterable[int]) -> Matrix:
        """SI values (n, m) of the mapped objects at `positions`."""
        return np.stack([self.raw(payload, i) * self.scales[i] for i in positions], axis=1).astype(np.float64)


def _si_scale(device: DeviceDef, entry: ObjectDef) -> float:
    """SI value of one count; a torque in per mille of the rated one becomes N·m or N."""
    if entry.unit != "rated torque":
        return entry.scale
    rated = device.object(0x6076)
    return entry.scale * float(rated.default) * rated.scale


def pdo_layouts(devices: Iterable[DeviceDef]) -> dict[tuple[int, PdoKind, int], PdoLayout]:
    """Layouts of all enabled PDOs, by (node id, kind, number)."""
    return {
        (device.node_id, pdo.kind, pdo.number): PdoLayout.of(device, pdo)
        for device in devices
        for pdo in device.pdos
        if pdo.enabled
    }


_CRC8 = np.array([crc8_j1850(bytes([i ^ 0xFF])) ^ 0xFF for i in range(256)], np.uint8)  # the table behind the checksum


def checksum_ok(can_id: int, payload: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(n,) whether byte 7 is the checksum of identifier and bytes 0–6, see `drivers.checksum`."""
    crc = np.full(len(payload), start_value(can_id), np.uint8)
    for column in range(7):
        crc = _CRC8[crc ^ payload[:, column]]
    good: NDArray[np.bool_] = (crc ^ np.uint8(0xFF)) == payload[:, 7]
    return good
