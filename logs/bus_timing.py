"""What each class of messages costs the bus, how long after SYNC it is through, and how evenly SYNC comes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from drivers.catalogue import DRIVE_IDS, PLANNER_ID, STRATEGIC_ID
from drivers.objects import DeviceDef, PdoKind
from logs.frame_batch import FrameBatch, Ints
from logs.signals import Signal

CLASSES = ("feedback", "set points", "planner", "strategic", "sensors", "services")
"""Services: SYNC, NMT, heartbeats, EMCY, SDO."""
ANSWERING = CLASSES[:5]
"""Those that come in answer to SYNC, or are due in its cycle."""
_SERVICES = CLASSES.index("services")


def classes(devices: Iterable[DeviceDef]) -> Ints:
    """Class of every identifier (2048,), an index into `CLASSES`."""
    found = np.full(0x800, _SERVICES, np.int64)
    for device in devices:
        for pdo in device.pdos:
            if pdo.enabled:
                found[pdo.cob_id & 0x7FF] = _class_of(device.node_id, pdo.kind)
    return found


def _class_of(node: int, kind: PdoKind) -> int:
    if node in DRIVE_IDS:
        return 0 if kind is PdoKind.TPDO else 1
    return {PLANNER_ID: 2, STRATEGIC_ID: 3}.get(node, 4)


def after_sync(batch: FrameBatch, class_of: Ints, rows: Ints, sync_ns: Ints) -> Signal:
    """(n, len(ANSWERING)) time in s from each SYNC to the end of the last frame of each class in its cycle, NaN without one.

    `rows`: cycle of each frame, an index into `sync_ns`; those below 0 are before the first SYNC.
    """
    latest = np.full((len(sync_ns), len(CLASSES)), -1, np.int64)
    inside = rows >= 0
    np.maximum.at(latest, (rows[inside], class_of[batch.can_id[inside]]), batch.t_ns[inside])
    delay = (latest - sync_ns[:, None])[:, : len(ANSWERING)] * 1e-9
    return Signal(sync_ns, np.where(latest[:, : len(ANSWERING)] < 0, np.nan, delay))


def sync_error(sync_ns: Ints, last_ns: int | None, period_ns: int) -> Signal | None:
    """(n, 1) how much later than its period each SYNC came, in s; None for the first of all."""
    times = sync_ns if last_ns is None else np.append(last_ns, sync_ns)
    return Signal(times[1:], (np.diff(times) - period_ns)[:, None] * 1e-9) if len(times) > 1 else None


def load_by_class(class_of: Ints, index: Ints, bits: np.ndarray, windows: int) -> np.ndarray:
    """(windows, len(CLASSES)) bits of each class in each window; `class_of`, `index` (n,): class and window of each frame."""
    n = len(CLASSES)
    return np.bincount(index * n + class_of, bits, windows * n).reshape(windows, n)
