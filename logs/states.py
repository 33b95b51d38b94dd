"""States of nodes and drives over time, and the events that can be read off the wire: faults, boot-ups, lost nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from enum import Enum

import numpy as np

from drivers.canopen.emcy import EmcyCode
from drivers.catalogue import DRIVE_IDS
from drivers.cia402.states import State, state_of
from logs.events import Event, Level
from logs.frame_batch import FrameBatch, Ints
from logs.signals import Signal, StateChange
from stack.messages import Mode, PlannerPhase, Restriction, SingularityKind

HEARTBEAT_TIMEOUT_NS = 350_000_000
NMT_STATES = {0: "boot-up", 4: "stopped", 5: "operational", 127: "pre-operational"}
SINGULARITIES = "planner/singularity"
LOST, UNKNOWN = "lost", "unknown"

# from the most able drive to the gravest state
_BY_GRAVITY = (
    State.OPERATION_ENABLED,
    State.SWITCHED_ON,
    State.READY_TO_SWITCH_ON,
    State.SWITCH_ON_DISABLED,
    State.NOT_READY,
    State.QUICK_STOP_ACTIVE,
    State.FAULT_REACTION_ACTIVE,
    State.FAULT,
)
EMCY_TEXTS = {
    0x10: "generic error",
    0x20: "current",
    0x30: "voltage",
    0x40: "temperature",
    0x50: "device hardware",
    0x60: "device software",
    0x70: "additional modules",
    0x81: "communication",
    0x82: "protocol error",
    0x84: "velocity control",
    0x86: "positioning: following error or limit",
    0x90: "external error",
}
"""Error classes by the high byte of the code (CiA 301, table 26; drives: IEC 61800-7-201)."""


def _emcy(code: int) -> str:
    """What an error code says: its own name where our nodes use it, else that of its class."""
    if code in _EMCY_CODES:
        return _text(EmcyCode(code))
    return EMCY_TEXTS.get(code >> 8) or EMCY_TEXTS.get(code >> 8 & 0xF0) or "manufacturer's own"


def _text(member: Enum) -> str:
    return member.name.lower().replace("_", " ")


def drive_state(statusword: int) -> str:
    """The CiA 402 state that a statusword tells; `unknown` for a bit pattern that the profile does not have."""
    state = state_of(statusword)
    return UNKNOWN if state is None else _text(state)


def _gravity(state: str) -> int:
    return _GRAVITY.get(state, len(_GRAVITY))


def restriction_text(restrictions: int) -> str:
    """What shaped the command in words, the gravest first, joint numbers joined: `infeasible, joint 2+5`; `none` for 0."""
    flags = Restriction(restrictions)
    joints = [str(i + 1) for i in range(8) if restrictions >> i & 1]
    others = [
        str(flag.name).lower().replace("_", " ")
        for flag in reversed(Restriction)
        if flag in flags and flag >= Restriction.VELOCITY
    ]
    return ", ".join(others + ([f"joint {'+'.join(joints)}"] if joints else [])) or "none"


_EMCY_CODES = frozenset(EmcyCode)
_GRAVITY = {_text(state): rank for rank, state in enumerate(_BY_GRAVITY)}


class StateDecoder:
    """Keeps the last state of every lane, so that only changes come out. Lanes: `mission/mode`, `planner/phase`, …"""

    def __init__(self, names: Mapping[int, str]) -> None:
        """`names` of all nodes by node id."""
        self._nodes = dict(names)
        self._drives = [names.get(node, f"node {node}") for node in DRIVE_IDS]
        self._last: dict[str, str] = {}
        self._last_beat: dict[int, int] = {}

    def decode(self, batch: FrameBatch, signals: Mapping[str, Signal]) -> tuple[tuple[StateChange, ...], list[Event]]:
        """State changes and events of a batch, in the order of time."""
        changes = [
            *self._mission(signals),
            *self._planner(signals),
            *self._singularities(signals),
            *self._drive_states(signals),
            *self._heartbeats(batch),
        ]
        changes.sort(key=_change_time)
        events = [event for change in changes if (event := _event_of(change)) is not None]
        events += self._emergencies(batch)
        return tuple(changes), sorted(events, key=_event_time)

    def _changes(self, lane: str, t_ns: Ints, codes: Ints, text: Callable[[int], str]) -> Iterable[StateChange]:
        """One change wherever the text of the code differs from the one before it."""
        if not len(codes):
            return
        steps = np.append(0, np.flatnonzero(np.diff(codes)) + 1)
        for i in steps.tolist():
            state = text(int(codes[i]))
            if self._last.get(lane) != state:
                self._last[lane] = state
                yield StateChange(int(t_ns[i]), lane, state)

    def _mission(self, signals: Mapping[str, Signal]) -> Iterable[StateChange]:
        mission = signals.get("mission")
        if mission is None:
            return
        codes = mission.values.astype(np.int64)
        yield from self._changes("mission/mode", mission.t_ns, codes[:, 0], lambda code: _enum_text(Mode, code))
        yield from self._changes("mission/step", mission.t_ns, codes[:, 1], lambda code: f"step {code}")

    def _planner(self, signals: Mapping[str, Signal]) -> Iterable[StateChange]:
        planner = signals.get("planner/state")
        if planner is None:
            return
        codes = planner.values[:, :3].astype(np.int64)
        yield from self._changes(
            "planner/phase", planner.t_ns, codes[:, 0], lambda code: _enum_text(PlannerPhase, code)
        )
        yield from self._changes("planner/restrictions", planner.t_ns, codes[:, 2], restriction_text)

    def _singularities(self, signals: Mapping[str, Signal]) -> Iterable[StateChange]:
        margins = signals.get("singularity/margins")
        if margins is not None:
            codes = margins.values[:, 4].astype(np.int64)
            yield from self._changes(SINGULARITIES, margins.t_ns, codes, lambda code: _enum_text(SingularityKind, code))

    def _drive_states(self, signals: Mapping[str, Signal]) -> Iterable[StateChange]:
        words = signals.get("drives/statusword")
        if words is None:
            return
        codes = np.where(np.isnan(words.values), -1, words.values).astype(np.int64)
        codes = np.where(codes >= 0, codes & 0x6F, -1)
        for column, name in enumerate(self._drives):
            known = codes[:, column] >= 0
            yield from self._changes(f"drives/{name}", words.t_ns[known], codes[known, column], drive_state)
        yield from self._together(words.t_ns, codes)

    def _together(self, t_ns: Ints, codes: Ints) -> Iterable[StateChange]:
        """`drives/all`: the gravest state of all drives, computed where any of them changes."""
        rows = np.append(0, np.flatnonzero(np.any(np.diff(codes, axis=0), axis=1)) + 1)
        for i in rows.tolist():
            states = [drive_state(code) for code in codes[i].tolist() if code >= 0]
            state = max(states, key=_gravity, default="not ready")
            if self._last.get("drives/all") != state:
                self._last["drives/all"] = state
                yield StateChange(int(t_ns[i]), "drives/all", state)

    def _heartbeats(self, batch: FrameBatch) -> Iterable[StateChange]:
        """NMT states from heartbeats (700h + node), and `lost` once one has been missing for its time-out."""
        end_ns = int(batch.t_ns[-1]) if len(batch.t_ns) else 0
        for node, name in self._nodes.items():
            lane = f"nodes/{name}"
            rows = batch.rows(0x700 + node)
            for t_ns, code in zip(batch.t_ns[rows].tolist(), batch.payload[rows, 0].tolist(), strict=True):
                yield from self._silence(node, lane, t_ns)
                self._last_beat[node] = t_ns
                state = NMT_STATES.get(code & 0x7F, f"unknown {code}")
                if self._last.get(lane) != state:
                    self._last[lane] = state
                    yield StateChange(t_ns, lane, state)
            yield from self._silence(node, lane, end_ns)

    def _silence(self, node: int, lane: str, t_ns: int) -> Iterable[StateChange]:
        beat_ns = self._last_beat.get(node)
        if beat_ns is not None and t_ns - beat_ns > HEARTBEAT_TIMEOUT_NS and self._last.get(lane) != LOST:
            self._last[lane] = LOST
            yield StateChange(beat_ns + HEARTBEAT_TIMEOUT_NS, lane, LOST)

    def _emergencies(self, batch: FrameBatch) -> Iterable[Event]:
        for node, name in self._nodes.items():
            rows = batch.rows(0x080 + node, 8)
            for t_ns, data in zip(batch.t_ns[rows].tolist(), batch.payload[rows].tolist(), strict=True):
                code = data[0] | data[1] << 8
                if code >> 8 == 0:
                    yield Event(t_ns, Level.INFO, name, "EMCY 0000h: error reset")
                else:
                    yield Event(t_ns, Level.ERROR, name, f"EMCY {code:04X}h, register {data[2]:02X}h: {_emcy(code)}")


def _event_of(change: StateChange) -> Event | None:
    """The event of a state change, or None for what is no news."""
    group, _, name = change.lane.partition("/")
    if group == "nodes":
        level = {LOST: Level.ERROR, "stopped": Level.WARN}.get(change.state, Level.DEBUG)
        return Event(change.t_ns, level, name, f"NMT state: {change.state}")
    if group == "drives" and name != "all":
        if change.state.startswith("fault"):
            return Event(change.t_ns, Level.ERROR, name, change.state)
        return Event(change.t_ns, Level.DEBUG, name, change.state)
    if change.lane == "planner/phase":
        level = Level.ERROR if change.state == "fault" else Level.DEBUG  # the planner tells of the others itself
        return Event(change.t_ns, level, "planner", f"phase: {change.state}")
    if group == "mission":
        level = Level.INFO if name == "mode" else Level.DEBUG
        return Event(change.t_ns, level, "strategic", f"{name}: {change.state}")
    if change.lane == "planner/restrictions" and (
        "infeasible" in change.state or "stale" in change.state or "degraded" in change.state
    ):
        return Event(change.t_ns, Level.WARN, "planner", f"restricted: {change.state}")
    return None


def _enum_text(kind: type[Mode] | type[PlannerPhase] | type[SingularityKind], code: int) -> str:
    try:
        return _text(kind(code))
    except ValueError:
        return f"unknown {code}"


def _change_time(change: StateChange) -> int:
    return change.t_ns


def _event_time(event: Event) -> int:
    return event.t_ns
