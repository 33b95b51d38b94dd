"""Why a run stopped, told from its recording alone: what came first, which node, which fault, what followed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

from logs.columns import TIMELINE
from logs.events import Event, Level
from logs.signals import Signal, StateChange
from logs.states import LOST

WINDOW_NS = 700_000_000
"""So long before the stop its cause may lie, and so long after it what tells about the cause may come: time-outs of heartbeats."""
FULL_PERCENT = 97.0
_WITNESS = "fault"  # the injector's own events are not evidence: a real fault does not announce itself
_MOVING = ("idle", "executing")
_SYNC_EMCY, _CONSUMER_EMCY = "EMCY 87", "EMCY 81"
_SERIES = ("bus/load_percent", "tcp/error_mm", "joints/position_share", "joints/velocity_share", "planner/path_scale_1")


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a recording holds of events (by time), changes of state (by time) and of some numbers."""

    events: tuple[Event, ...]
    states: tuple[StateChange, ...]
    series: Mapping[str, Signal]
    joints: tuple[str, ...] = ()

    def lane(self, name: str) -> list[StateChange]:
        return [change for change in self.states if change.lane == name]

    def state_at(self, lane: str, t_ns: int) -> str | None:
        """The state that a lane had just before `t_ns`."""
        return next((change.state for change in reversed(self.lane(lane)) if change.t_ns < t_ns), None)

    def value_at(self, name: str, t_ns: int) -> np.ndarray | None:
        """The last row of a series before `t_ns`."""
        signal = self.series.get(name)
        row = 0 if signal is None else int(np.searchsorted(signal.t_ns, t_ns))
        return signal.values[row - 1] if signal is not None and row else None


@dataclass(frozen=True, slots=True)
class Story:
    """`headline`: one sentence. `stopped_ns` None: the run did not stop before its time. `node`: whom the fault befell, if one does."""

    headline: str
    stopped_ns: int | None
    node: str | None
    before: tuple[str, ...] = ()
    evidence: tuple[Event, ...] = ()
    after: tuple[str, ...] = ()

    def text(self) -> str:
        """For the terminal: headline, what was before, events in the order of time, what was after."""
        lines = [self.headline]
        if self.stopped_ns is not None:
            lines += ["", "just before", *(f"  {line}" for line in self.before)]
            lines += ["", "what happened", *(f"  {event.line().strip()}" for event in self.evidence)]
            lines += ["", "after", *(f"  {line}" for line in self.after)]
        return "\n".join(lines)


def tell(recording: Path) -> Story:
    """Reads a `run.rrd` and nothing else. Raises OSError, and ValueError for a file that is no recording (or torn: see `optimise`)."""
    return story_of(read_evidence(recording))


def story_of(found: Evidence) -> Story:
    """The story that the evidence tells."""
    if not found.states:
        return Story("the recording holds no run", None, None)
    stopped_ns = _stop(found)
    if stopped_ns is None:
        done = any("all steps done" in event.text for event in found.events)
        return Story(
            "finished: all steps done" if done else "no fault: the recording ends while all is well", None, None
        )
    near = [event for event in found.events if abs(event.t_ns - stopped_ns) <= WINDOW_NS and event.source != _WITNESS]
    headline, node = _cause(found, near, stopped_ns)
    graver = [event for event in near if event.level >= Level.WARN or "EMCY" in event.text]
    evidence = _without_repetition(graver)
    return Story(
        f"stopped at {stopped_ns * 1e-9:.3f} s: {headline}",
        stopped_ns,
        node,
        tuple(_before(found, evidence[0].t_ns if evidence else stopped_ns)),
        tuple(evidence),
        tuple(_after(found, stopped_ns)),
    )


def _stop(found: Evidence) -> int | None:
    """When the planner left its work although the mission was not done, or was not heard any more."""
    done_ns = next((event.t_ns for event in found.events if "all steps done" in event.text), None)
    phases = found.lane("planner/phase")
    times = [
        change.t_ns
        for before, change in pairwise(phases)
        if before.state in _MOVING and change.state in ("fault", "stopping")
    ]
    times += [change.t_ns for change in found.lane("nodes/planner") if change.state == LOST]
    times += [event.t_ns for event in found.events if event.text == "the planner has fallen silent"]
    first = min(times, default=None)
    return first if first is not None and (done_ns is None or first < done_ns) else None


def _cause(found: Evidence, near: Sequence[Event], stopped_ns: int) -> tuple[str, str | None]:
    """The headline, and the node that it is about."""
    lost = [
        change.lane.removeprefix("nodes/")
        for change in found.states
        if change.lane.startswith("nodes/") and change.state == LOST and abs(change.t_ns - stopped_ns) <= WINDOW_NS
    ]
    drives = {lane.lane.removeprefix("drives/") for lane in found.states if lane.lane.startswith("drives/")} - {"all"}
    own = [e for e in near if e.source in drives and "EMCY" in e.text and "EMCY 0000h" not in e.text]
    sync_lost = {event.source for event in own if _SYNC_EMCY in event.text}
    faults = [e for e in own if _SYNC_EMCY not in e.text and _CONSUMER_EMCY not in e.text and e.t_ns <= stopped_ns]
    load = found.series.get("bus/load_percent")
    if load is not None:
        rows = np.abs(load.t_ns - stopped_ns) <= WINDOW_NS
        if rows.any() and load.values[rows].max() >= FULL_PERCENT and len(sync_lost) > 1:
            return (
                f"the bus was full ({load.values[rows].max():.0f} %): SYNC did not get through to {len(sync_lost)} drives",
                None,
            )
    if len(sync_lost) > 1:
        if "planner" in lost:
            return (
                f"the planner fell silent: {len(sync_lost)} drives heard no SYNC any more, its heartbeat is missing",
                "planner",
            )
        return f"SYNC was lost: {len(sync_lost)} drives heard none any more, while the planner was still alive", None
    if faults:
        first = faults[0]
        return f"fault of drive {first.source}: {first.text}{_limit(found, first)}", first.source
    silent = [name for name in lost if name in drives]
    if silent:
        late = next((event.text for event in near if "feedback late" in event.text), "its heartbeat is missing")
        return f"drive {silent[0]} fell silent: {late}", silent[0]
    if "strategic" in lost:
        return "the strategic node fell silent: its heartbeat is missing", "strategic"
    if "planner" in lost:
        return "the planner fell silent: its heartbeat is missing", "planner"
    graver = [event for event in near if event.level >= Level.ERROR and event.t_ns <= stopped_ns + 1_000_000]
    first_error = next((event for event in graver if not event.text.startswith("phase:")), None)
    if first_error is not None:
        return f"{first_error.source}: {first_error.text}", first_error.source
    last = [event for event in near if event.level >= Level.WARN and event.t_ns <= stopped_ns]
    return (f"{last[-1].source}: {last[-1].text}", last[-1].source) if last else ("nothing recorded says why", None)


def _limit(found: Evidence, event: Event) -> str:
    """Where the joint stood in its range and how fast it was, for faults of a joint's drive."""
    if event.source not in found.joints:
        return ""
    column = found.joints.index(event.source)
    share, speed = (found.value_at(f"joints/{name}", event.t_ns) for name in ("position_share", "velocity_share"))
    parts = []
    if share is not None and abs(share[column]) > 0.95:
        parts.append(f"at {100 * abs(share[column]):.0f} % of its {'upper' if share[column] > 0 else 'lower'} limit")
    if speed is not None and abs(speed[column]) > 0.95:
        parts.append(f"at {100 * abs(speed[column]):.0f} % of its velocity limit")
    return f" ({', '.join(parts)})" if parts else ""


def _before(found: Evidence, t_ns: int) -> Iterable[str]:
    for lane in ("mission/step", "planner/phase", "drives/all", "planner/restrictions"):
        state = found.state_at(lane, t_ns)
        if state is not None:
            yield f"{lane:<21} {state}"
    error, scale = found.value_at("tcp/error_mm", t_ns), found.value_at("planner/path_scale_1", t_ns)
    if error is not None:
        yield f"{'TCP error':<21} {error[0]:.2f} mm"
    if scale is not None:
        yield f"{'path scale':<21} {scale[0]:.2f}"
    share = found.value_at("joints/position_share", t_ns)
    if share is not None and found.joints:
        nearest = int(np.argmax(np.abs(share)))
        yield f"{'nearest to a limit':<21} {found.joints[nearest]}, {100 * abs(share[nearest]):.0f} % of the way from the middle"


def _after(found: Evidence, stopped_ns: int) -> Iterable[str]:
    for change in found.states:
        lane = change.lane
        told = lane in ("mission/mode", "planner/phase", "drives/all") or (
            lane.startswith(("drives/", "nodes/")) and change.state in ("fault", "boot-up", LOST)
        )
        if told and stopped_ns <= change.t_ns <= stopped_ns + 2 * WINDOW_NS:
            yield f"{change.t_ns * 1e-9:10.3f} s  {lane:<22} {change.state}"


def _without_repetition(events: Sequence[Event]) -> list[Event]:
    """The first of those that say the same of several nodes, with their number."""
    told: dict[str, list[Event]] = {}
    for event in events:
        told.setdefault(event.text, []).append(event)
    return [
        same[0] if len(same) == 1 else Event(same[0].t_ns, same[0].level, same[0].source, f"{text} ({len(same)} times)")
        for text, same in told.items()
    ]


def read_evidence(path: Path) -> Evidence:
    """What `tell` needs of a recording. Raises OSError, ValueError as `tell` does."""
    with path.open("rb"):
        pass
    events: list[Event] = []
    states: list[StateChange] = []
    series: dict[str, list[Signal]] = {}
    joints: tuple[str, ...] = ()
    try:
        for chunk in RrdReader(str(path)).stream():
            entity = str(chunk.entity_path).lstrip("/")
            if entity == "joints/position_share" and chunk.is_static:
                joints = tuple(chunk.to_record_batch().column("SeriesLines:names").to_pylist()[0])
            elif not chunk.is_static and (entity == "events" or entity in _SERIES or entity.startswith("states/")):
                _take(entity, chunk.to_record_batch(), events, states, series)
    except (RuntimeError, ValueError, KeyError) as error:
        raise ValueError(f"{path}: not a recording that can be read: {error}") from None
    joined = {name: _joined(parts) for name, parts in series.items()}
    return Evidence(
        tuple(sorted(events, key=lambda e: e.t_ns)), tuple(sorted(states, key=lambda s: s.t_ns)), joined, joints
    )


def _take(
    entity: str, batch: Any, events: list[Event], states: list[StateChange], series: dict[str, list[Signal]]
) -> None:
    t_ns = batch.column(TIMELINE).to_numpy(zero_copy_only=False).astype(np.int64)
    if entity == "events":
        levels = batch.column("TextLog:level").to_pylist()
        for t, (text,), (level,) in zip(t_ns.tolist(), batch.column("TextLog:text").to_pylist(), levels, strict=True):
            source, _, said = text.partition(": ")
            events.append(Event(t, Level[level], source, said))
    elif entity.startswith("states/"):
        lane = entity.removeprefix("states/")
        for t, state in zip(t_ns.tolist(), batch.column("StateChange:state").to_pylist(), strict=True):
            states.append(StateChange(t, lane, state[0]))
    else:
        flat = np.asarray(batch.column("Scalars:scalars").flatten().to_numpy(zero_copy_only=False), np.float64)
        series.setdefault(entity, []).append(Signal(t_ns, flat.reshape(len(t_ns), -1)))


def _joined(parts: Sequence[Signal]) -> Signal:
    t_ns, values = np.concatenate([p.t_ns for p in parts]), np.vstack([p.values for p in parts])
    order = np.argsort(t_ns, kind="stable")
    return Signal(t_ns[order], values[order])
