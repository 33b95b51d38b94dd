"""The firewall between whoever plans and what moves: frames are data here, and every rule is a comparison.

Nothing in this file sends, waits, reads a clock or raises on a frame: it is told what came and answers what may pass. The same gate
stands in every drive, before its process data, and in the master, before its sender. What it does not let through is counted by reason.

Two rules come before all others: a command that takes power away always passes, and whatever is refused counts as missing, so that a
stream of bad frames ends like no stream at all, in the stop of the drive.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

SET_POINT = struct.Struct("<Hih")
"""Controlword, target (position, or velocity), torque offset: RPDO1 of a drive."""
ENABLE_BITS, ENABLE = 0x0F, 0x0F
JUMP_MARGIN = 3.0
"""A target may be this multiple of what the velocity limit allows away from the one before it."""
ACCELERATION_MARGIN = 1.5
OFFSET_SHARE = 0.5
"""A torque offset changes by at most this share of the torque limit from one SYNC to the next."""
MOST_BEHIND = 3
"""So many frames on end may be refused for their counter; then the sender has begun to count anew."""
HALF = 128
OVERDUE = 1.1
"""SYNC periods after which the next SYNC has been lost."""


class Reason(IntEnum):
    """Why a frame did not pass, or not as it was; the number goes into the emergency message."""

    LENGTH = 1
    RATE = 2
    """A second, different set point within one SYNC period; or more frames of an identifier than there may be."""
    JUMP = 3
    LIMITED = 4
    """It passed, but a value had to be brought inside its limits."""
    STALE = 5
    """The same counter again: nothing new."""
    BEHIND = 6
    """An older counter than the last one: overtaken on the way."""
    UNKNOWN = 7
    """An identifier that nobody here has any business with."""


@dataclass(frozen=True, slots=True)
class SetPointLimits:
    """Bounds of one drive's set points, in the units of its wire per SYNC period. None: not watched.

    `lower`, `upper`: of the target. `jump`: most change of the target. `bend`: most change of that change. `offset`: most torque offset,
    either way. `offset_change`: most change of it. `period_ns`: of SYNC.
    """

    lower: int
    upper: int
    jump: int | None
    bend: int | None
    offset: int
    offset_change: int
    period_ns: int


def limit(value: int, lower: int, upper: int) -> tuple[int, bool]:
    """`value` brought inside [`lower`, `upper`], and whether it had been outside."""
    if value > upper:
        return upper, True
    if value < lower:
        return lower, True
    return value, False


def limit_change(value: int, last: int, most: int) -> tuple[int, bool]:
    """`value` brought to within `most` of `last`, and whether it had been further away."""
    return limit(value, last - most, last + most)


def wrapped(difference: int) -> int:
    """A difference of two positions of 32 bits, the short way round: an axis without limits may turn on past their end."""
    return (difference + (1 << 31)) % (1 << 32) - (1 << 31)


class Counts:
    """How often each reason was found."""

    __slots__ = ("by_reason",)

    def __init__(self) -> None:
        self.by_reason = dict.fromkeys(Reason, 0)

    def note(self, reason: Reason) -> Reason:
        """One more."""
        self.by_reason[reason] += 1
        return reason

    @property
    def refused(self) -> int:
        """Frames that did not pass."""
        return sum(self.by_reason.values()) - self.by_reason[Reason.LIMITED]


class SetPointGate:
    """One drive's set points. `judge` every frame that comes, `on_sync` at every SYNC, `seed` when the axis is enabled."""

    __slots__ = ("_last", "_offset", "_passed", "_periods", "_step", "_sync_ns", "_taken", "counts", "limits")

    def __init__(self, limits: SetPointLimits) -> None:
        self.limits = limits
        self.counts = Counts()
        self._last = 0
        self._step: int | None = None
        self._offset = 0
        self._periods = 0
        self._taken: bytes | None = None
        self._passed = b""
        self._sync_ns: int | None = None

    def on_sync(self, t_ns: int) -> None:
        """A SYNC came at `t_ns`."""
        passed = 1 if self._sync_ns is None else max(1, round((t_ns - self._sync_ns) / self.limits.period_ns))
        self._periods = passed if self._taken is not None else self._periods + passed
        self._taken = None
        self._sync_ns = t_ns

    def seed(self, target: int, offset: int) -> None:
        """The axis begins here: the next set point is measured against it."""
        self._last, self._offset, self._step, self._periods = target, offset, None, 0

    def judge(self, data: bytes, engaged: bool, t_ns: int) -> tuple[bytes | None, Reason | None]:
        """The frame as it may pass (None: not at all), and what was wrong with it. `engaged`: the axis follows set points."""
        if len(data) != SET_POINT.size:
            return None, self.counts.note(Reason.LENGTH)
        word, target, offset = SET_POINT.unpack(data)
        enables = word & ENABLE_BITS == ENABLE
        if not engaged:
            self._taken, self._passed = data if enables else None, data
            self.seed(target, offset)
            return data, None
        if not enables:
            self._taken = self._step = (
                None  # what takes power away is no set point: one may follow it, from where the last one was
            )
            return data, None
        if data == self._taken:
            return self._passed, None
        limits, periods, sync_ns = self.limits, max(1, self._periods), self._sync_ns
        if self._taken is not None:
            if sync_ns is None or t_ns - sync_ns < OVERDUE * limits.period_ns:
                return None, self.counts.note(Reason.RATE)
            periods += 1  # a SYNC got lost in between: this frame takes its place, the next one waits for another
            sync_ns += limits.period_ns
        if limits.jump is not None and abs(wrapped(target - self._last)) > limits.jump * periods:
            return None, self.counts.note(Reason.JUMP)
        bent = False
        if limits.bend is not None and self._step is not None and periods == 1:
            target, bent = limit_change(target, self._last + self._step, limits.bend)
        # What it may be comes after how fast it may become that: nothing leads out of these.
        target, limited = limit(target, limits.lower, limits.upper)
        offset, slowed = limit_change(offset, self._offset, limits.offset_change * periods)
        offset, clipped = limit(offset, -limits.offset, limits.offset)
        self._step = wrapped(target - self._last) if periods == 1 else None
        self._last, self._offset, self._taken, self._passed, self._sync_ns = target, offset, data, data, sync_ns
        if limited or bent or clipped or slowed:
            self._passed = SET_POINT.pack(word, target, offset)
            return self._passed, self.counts.note(Reason.LIMITED)
        return data, None


class CounterGate:
    """Messages of one sender, by their counter (0 … 255, wraps): each is taken once, none after a later one."""

    __slots__ = ("_behind", "_heard_ns", "_last", "counts", "lost", "timeout_ns")

    def __init__(self, timeout_ns: int) -> None:
        """After a silence of `timeout_ns` every counter is a new beginning."""
        self.timeout_ns = timeout_ns
        self.counts = Counts()
        self.lost = 0
        """Messages whose counters were left out."""
        self._last: int | None = None
        self._heard_ns = 0
        self._behind = 0

    def judge(self, counter: int, t_ns: int) -> Reason | None:
        """None: it is new. `t_ns`: when it came."""
        ahead = 1 if self._last is None else (counter - self._last) % 256
        silent = t_ns - self._heard_ns > self.timeout_ns
        if ahead == 0 and not silent:
            return self.counts.note(Reason.STALE)
        if ahead >= HALF and not silent and self._behind < MOST_BEHIND:
            self._behind += 1
            return self.counts.note(Reason.BEHIND)
        if 0 < ahead < HALF and not silent:
            self.lost += ahead - 1
        self._last, self._heard_ns, self._behind = counter, t_ns, 0
        return None


class FeedbackGate:
    """Positions that a drive says (32 bits of its wire): none is further from the last one than the axis could have got."""

    __slots__ = ("_behind", "_last", "_t_ns", "counts", "jump", "period_ns")

    def __init__(self, jump: int, period_ns: int) -> None:
        """`jump`: most change in a period of `period_ns`."""
        self.jump = jump
        self.period_ns = period_ns
        self.counts = Counts()
        self._last: int | None = None
        self._t_ns = 0
        self._behind = 0

    def judge(self, position: int, t_ns: int) -> Reason | None:
        """None: it may be. After `MOST_BEHIND` refusals on end it is taken: the axis was moved, or its encoder set anew."""
        if self._last is not None and self._behind < MOST_BEHIND:
            periods = max(1, round((t_ns - self._t_ns) / self.period_ns))
            if abs(wrapped(position - self._last)) > self.jump * periods:
                self._behind += 1
                return self.counts.note(Reason.JUMP)
        self._last, self._t_ns, self._behind = position, t_ns, 0
        return None


class FrameGate:
    """Identifiers with the one length that each has, and so many frames of each between two SYNCs at most."""

    __slots__ = ("_lengths", "_most", "_seen", "counts")

    def __init__(self, lengths: Mapping[int, int], most: int) -> None:
        self._lengths = dict(lengths)
        self._most = most
        self._seen: dict[int, int] = {}
        self.counts = Counts()

    def on_sync(self) -> None:
        """A new period."""
        self._seen.clear()

    def judge(self, can_id: int, data: bytes) -> Reason | None:
        """None: it may pass."""
        length = self._lengths.get(can_id)
        if length is None:
            return self.counts.note(Reason.UNKNOWN)
        if len(data) != length:
            return self.counts.note(Reason.LENGTH)
        seen = self._seen[can_id] = self._seen.get(can_id, 0) + 1
        return self.counts.note(Reason.RATE) if seen > self._most else None
