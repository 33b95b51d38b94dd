"""Every frame of a run as a line that people can read and search: bytes and decoded fields, by message."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from drivers.frame_codec import Field, fields_of
from drivers.objects import DeviceDef, PdoDef
from logs.frame_batch import FrameBatch, PdoLayout
from logs.frame_text import FrameReader
from logs.signals import Ints
from logs.tape import SYNC_ID

_CODES = ("Controlword", "Statusword", "Restrictions")
_LEFT_OUT = ("counter", "checksum")


@dataclass(frozen=True, slots=True)
class FrameLines:
    """Lines of all frames with one identifier, `path` as `can/199_feedback_of_elbow`."""

    path: str
    t_ns: Ints
    texts: list[str]


class FrameLineWriter:
    """Writes the frames of whole batches, PDOs column by column. SYNC is left out: it says nothing."""

    def __init__(self, devices: Iterable[DeviceDef]) -> None:
        devices = tuple(devices)
        self._reader = FrameReader(devices)
        self._formats: dict[int, tuple[PdoLayout, str, tuple[int, ...], tuple[bool, ...]]] = {}
        self._paths: dict[int, str] = {}
        for device in devices:
            for pdo in device.pdos:
                if pdo.enabled:
                    can_id = pdo.cob_id & 0x7FF
                    self._formats[can_id] = _format(self._title(can_id, b""), device, pdo)

    def lines(self, batch: FrameBatch) -> Iterator[FrameLines]:
        """The lines of a batch, one entry for each identifier."""
        order = np.argsort(batch.can_id, kind="stable")
        ids = batch.can_id[order]
        starts = np.flatnonzero(np.append(True, np.diff(ids) > 0)) if len(ids) else np.empty(0, np.int64)
        for start, stop in zip(starts.tolist(), [*starts[1:].tolist(), len(ids)], strict=True):
            can_id, rows = int(ids[start]), order[start:stop]
            if can_id != SYNC_ID:
                texts = self._texts(can_id, batch, rows)
                yield FrameLines(self._paths[can_id], batch.t_ns[rows], texts)

    def _texts(self, can_id: int, batch: FrameBatch, rows: Ints) -> list[str]:
        known = self._formats.get(can_id)
        if known is None or np.any(batch.length[rows] != known[0].length):
            return self._one_by_one(can_id, batch, rows)
        layout, text, positions, coded = known
        payload = batch.payload[rows]
        columns: list[list[str] | list[float] | list[int]] = [_hex(payload[:, : layout.length])]
        for position, code in zip(positions, coded, strict=True):
            raw = layout.raw(payload, position)
            columns.append(raw.tolist() if code else (raw * layout.scales[position]).tolist())
        return [text % row for row in zip(*columns, strict=True)]

    def _one_by_one(self, can_id: int, batch: FrameBatch, rows: Ints) -> list[str]:
        texts, kept = [], {}
        for length, payload in zip(batch.length[rows].tolist(), batch.payload[rows], strict=True):
            data = payload[:length].tobytes()
            if data not in kept:  # heartbeats say the same all the time
                fields = ", ".join(f"{field.name} {field}" for field in self._reader.read(can_id, data).fields)
                kept[data] = f"{self._title(can_id, data)}  {data.hex().upper():<16}  {fields}"
            texts.append(kept[data])
        return texts

    def _title(self, can_id: int, data: bytes) -> str:
        """Identifier and name of the message, as `199 feedback of elbow`; notes its path."""
        message = self._reader.read(can_id, data).message.partition(" (node")[0]
        title = f"{can_id:03X}" if message == f"{can_id:03X}h" else f"{can_id:03X} {message}"
        self._paths[can_id] = "can/" + title.replace(" ", "_").replace("/", "_")
        return title


def _format(title: str, device: DeviceDef, pdo: PdoDef) -> tuple[PdoLayout, str, tuple[int, ...], tuple[bool, ...]]:
    """Layout, text with the title, place-holders for the bytes and each field, positions of those fields, which of them are codes."""
    layout = PdoLayout.of(device, pdo)
    shown = [(i, f) for i, f in enumerate(fields_of(device, pdo)) if f.name.lower() not in _LEFT_OUT]
    parts = [_place(field) for _, field in shown]
    text = f"{title}  %-{2 * layout.length}s  " + ", ".join(parts)
    return layout, text, tuple(i for i, _ in shown), tuple(field.name in _CODES for _, field in shown)


def _place(field: Field) -> str:
    name = field.name.replace("%", "%%")
    if field.name in _CODES:
        return f"{name} %0{field.bits // 4}Xh"
    unit = "N·m or N" if field.unit == "rated torque" else field.unit
    return f"{name} %.6g {unit}".rstrip()


def _hex(payload: np.ndarray) -> list[str]:
    text, width = payload.tobytes().hex().upper(), 2 * payload.shape[1]
    return [text[i : i + width] for i in range(0, len(text), width)] if width else [""] * len(payload)
