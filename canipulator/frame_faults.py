"""Faults of frames: which of those on the wire they befall, and what becomes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from config.faults import FaultTable
from drivers.bus.interception import Verdict
from drivers.catalogue import PLANNER_ID
from drivers.checksum import frame_checksum, start_value
from drivers.codec import MESSAGES
from drivers.frame import Frame
from drivers.objects import DeviceDef

SYNC_ID = 0x080
FIRST_PDO, LAST_PDO = 0x180, 0x57F
CHECKED = frozenset(can_id for message in MESSAGES for can_id in message.can_ids)
"""Identifiers of frames that end in a checksum."""
_STREAM = 0xFA17
FrameFault = Callable[[str, Frame], Verdict | None]
_Effect = Callable[[Frame], Verdict | None]


def frame_fault(
    fault: FaultTable, sender: str | None, devices: Mapping[int, DeviceDef], seed: Iterable[int]
) -> FrameFault:
    """What judges the frames of one fault. `sender`: name of the port whose frames it befalls, None: all."""
    random = np.random.default_rng([_STREAM, *seed])
    return _JUDGES[fault.kind](fault, sender, devices, random)


class _Chooser:
    """Frames of one sender and identifier (where given), chosen by chance, in bursts, up to a number."""

    def __init__(self, fault: FaultTable, sender: str | None, random: np.random.Generator, effect: _Effect) -> None:
        self._sender = sender
        self._can_id = fault.value("can_id")
        self._probability: float = fault.value("probability")
        self._left: int | None = fault.value("count")
        self._burst: int = fault.value("burst") or 1
        self._following = 0
        self._random = random
        self._effect = effect

    def __call__(self, sender: str, frame: Frame) -> Verdict | None:
        if self._left == 0 or (self._sender is not None and sender != self._sender):
            return None
        if self._can_id is not None and frame.can_id != self._can_id:
            return None
        if self._following:
            self._following -= 1
        elif self._random.random() < self._probability:
            self._following = self._burst - 1
        else:
            return None
        verdict = self._effect(frame)
        if verdict is not None and self._left is not None:
            self._left -= 1
        return verdict


def _ns(seconds: float) -> int:
    return round(1e9 * seconds)


def _loss(fault: FaultTable, sender: str | None, _: Any, random: np.random.Generator) -> FrameFault:
    return _Chooser(fault, sender, random, lambda frame: Verdict(drop=True))


def _delay(fault: FaultTable, sender: str | None, _: Any, random: np.random.Generator) -> FrameFault:
    least_ns, spread_ns = _ns(fault.value("delay_s")), _ns(fault.value("jitter_s") or 0.0)
    return _Chooser(fault, sender, random, lambda frame: Verdict(delay_ns=least_ns + int(random.random() * spread_ns)))


def _duplicate(fault: FaultTable, sender: str | None, _: Any, random: np.random.Generator) -> FrameFault:
    return _Chooser(fault, sender, random, lambda frame: Verdict(repeat=True))


def _error(fault: FaultTable, sender: str | None, _: Any, random: np.random.Generator) -> FrameFault:
    return _Chooser(fault, sender, random, lambda frame: Verdict(wire_error=True))


def _corruption(fault: FaultTable, sender: str | None, _: Any, random: np.random.Generator) -> FrameFault:
    """One to three bits turned over. A frame without a checksum cannot be corrupted with a wrong one."""
    valid = fault.value("checksum") == "valid"

    def turn(frame: Frame) -> Verdict | None:
        can_id, data, _ = frame
        process_data = FIRST_PDO <= can_id <= LAST_PDO and len(data) > 0
        if not (process_data if valid else can_id in CHECKED):
            return None
        bits = 8 * (len(data) - (can_id in CHECKED and valid))
        word = int.from_bytes(data, "little")
        for bit in random.choice(bits, size=int(random.integers(1, 4)), replace=False):
            word ^= 1 << int(bit)
        changed = word.to_bytes(len(data), "little")
        if valid and can_id in CHECKED and len(data) == 8:
            changed = changed[:7] + bytes((frame_checksum(start_value(can_id), changed[:7]),))
        return Verdict(data=changed)

    return _Chooser(fault, sender, random, turn)


def _sync_loss(fault: FaultTable, _: str | None, __: Any, random: np.random.Generator) -> FrameFault:
    return _Chooser(fault.model_copy(update={"can_id": SYNC_ID}), None, random, lambda frame: Verdict(drop=True))


def _sync_jitter(fault: FaultTable, _: str | None, __: Any, random: np.random.Generator) -> FrameFault:
    spread_ns = _ns(fault.value("jitter_s"))

    def judge(sender: str, frame: Frame) -> Verdict | None:
        return Verdict(delay_ns=int(random.random() * spread_ns)) if frame.can_id == SYNC_ID else None

    return judge


def _slow_planner(
    fault: FaultTable, _: str | None, devices: Mapping[int, DeviceDef], random: np.random.Generator
) -> FrameFault:
    """What the planner computes comes late; SYNC, heartbeat and SDO, which it need not compute, in time."""
    name, least_ns, spread_ns = devices[PLANNER_ID].name, _ns(fault.value("delay_s")), _ns(fault.value("jitter_s"))

    def judge(sender: str, frame: Frame) -> Verdict | None:
        if sender != name or not FIRST_PDO <= frame.can_id <= LAST_PDO:
            return None
        return Verdict(delay_ns=least_ns + int(random.random() * spread_ns))

    return judge


_JUDGES: dict[str, Callable[[FaultTable, str | None, Mapping[int, DeviceDef], np.random.Generator], FrameFault]] = {
    "frame-loss": _loss,
    "frame-delay": _delay,
    "frame-duplicate": _duplicate,
    "frame-reorder": _delay,
    "frame-corruption": _corruption,
    "wire-error": _error,
    "sync-loss": _sync_loss,
    "sync-jitter": _sync_jitter,
    "planner-slow": _slow_planner,
}
