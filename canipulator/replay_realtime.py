"""Replay of a run in real time: the planner gets the recorded frames cycle by cycle, and its set points are compared within a tolerance.

Times in such a log have the jitter of the machine, so frames are not expected where they were to the microsecond, nor to the bit: each
is moved to the grid of its SYNC, and set points are compared as values, cycle by cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from canipulator.outcome import progress_bar
from canipulator.replay import planner_ids, read_run
from canipulator.roles import planner_role
from config.errors import ConfigError
from config.robot import load_robot
from config.scenario import Scenario
from drivers.bus.base import OnFrame
from drivers.catalogue import DRIVE_IDS
from drivers.clock import LockstepClock
from drivers.drive_codec import DriveCodec
from drivers.frame import Frame
from logs.tape import SYNC_ID

TOLERANCE = 0.02
"""rad, m or rad/s by which a set point may differ."""
LEAST_SHARE = 0.99
"""Share of the set points that must agree within the tolerance."""
_SYNC_END_NS = 60_000
_CLEAR_NS = 100_000
_TOGETHER_NS = 50_000_000
"""Roles of one process: the planner hears the boot-ups that the log has before its own."""


@dataclass(frozen=True, slots=True)
class RealTimeReplay:
    """`compared` set points in `cycles` arm cycles; `agreeing` share of them within `tolerance`; `largest` difference by drive."""

    cycles: int
    compared: int
    agreeing: float
    tolerance: float
    largest: dict[str, float]

    @property
    def ok(self) -> bool:
        return self.compared > 0 and self.agreeing >= LEAST_SHARE


class _Port:
    """Everything that is sent is taken at once."""

    __slots__ = ("_sent", "can_ids", "on_frame")

    def __init__(self, can_ids: frozenset[int] | None, on_frame: OnFrame, sent: Callable[[int, bytes], None]) -> None:
        self.can_ids, self.on_frame, self._sent = can_ids, on_frame, sent

    def send(self, can_id: int, data: bytes) -> bool:
        self._sent(can_id, data)
        return True


class _GridBus:
    """Delivers the recorded frames of the others at their times on the grid; notes what the planner sends, by cycle and identifier."""

    def __init__(self, clock: LockstepClock, period_ns: int) -> None:
        self._clock, self._period_ns = clock, period_ns
        self._ports: list[_Port] = []
        self.sent: dict[tuple[int, int], bytes] = {}

    def attach(self, name: str, can_ids: Iterable[int] | None, on_frame: OnFrame) -> _Port:
        port = _Port(None if can_ids is None else frozenset(can_ids), on_frame, self._take)
        self._ports.append(port)
        return port

    def observe(self, on_frame: OnFrame) -> None:
        """Nobody listens to a replay."""

    def deliver(self, frame: Frame) -> None:
        for port in self._ports:
            if port.can_ids is None or frame.can_id in port.can_ids:
                port.on_frame(frame)

    def _take(self, can_id: int, data: bytes) -> None:
        self.sent[self._clock.now_ns() // self._period_ns, can_id] = bytes(data)


def on_grid(frames: Iterable[Frame], period_ns: int) -> list[tuple[int, Frame]]:
    """(number of its cycle on the grid of SYNC, frame with its time on that grid), in the order of the wire.

    The first SYNC belongs to the multiple of the period before it, each further one to the next: where the machine skipped cycles,
    the planner did, too. What follows a SYNC keeps its distance from it, inside the cycle. Frames before the first keep their times.
    """
    moved: list[tuple[int, Frame]] = []
    cycle, sync_ns, last_ns = -1, None, 0
    for frame in frames:
        t_ns = frame.t_ns
        if frame.can_id == SYNC_ID:
            cycle, sync_ns = t_ns // period_ns if sync_ns is None else cycle + 1, t_ns
            t_ns = cycle * period_ns + _SYNC_END_NS
        elif sync_ns is not None:
            after_ns = min(t_ns - sync_ns + _SYNC_END_NS, period_ns - _CLEAR_NS)
            t_ns = cycle * period_ns + after_ns
        last_ns = max(last_ns, t_ns)
        moved.append((cycle if sync_ns is not None else t_ns // period_ns, frame._replace(t_ns=last_ns)))
    return moved


def replay_real_time(
    scenario: Scenario,
    frames: list[Frame],
    own_ids: frozenset[int],
    *,
    tolerance: float = TOLERANCE,
    on_progress: Callable[[int], None] = lambda t_ns: None,
) -> RealTimeReplay:
    """Plays the others' frames to a new planner, and compares the set points that it sends with those of the log."""
    robot = load_robot(scenario.robot)
    period_ns = round(1e9 / scenario.planner.arm_cycle_hz)
    clock = LockstepClock()
    bus = _GridBus(clock, period_ns)
    grid = on_grid(frames, period_ns)
    planner = planner_role(robot, scenario, clock, bus, lambda level, source, text: None)
    first_ns = next((frame.t_ns for _, frame in grid if frame.can_id in own_ids), 0)
    early_ns = min(grid[0][1].t_ns, first_ns) if first_ns - grid[0][1].t_ns < _TOGETHER_NS else first_ns
    clock.run_until(early_ns)
    planner.power_on()
    for _, frame in grid:
        if frame.t_ns > clock.now_ns():
            clock.run_until(frame.t_ns)
            on_progress(frame.t_ns)
        if frame.can_id not in own_ids:
            bus.deliver(frame)
    return _compared(grid, bus.sent, [DriveCodec(robot.devices[node]) for node in DRIVE_IDS], tolerance)


def replay_run_in_real_time(run_dir: Path, *, quiet: bool = False) -> RealTimeReplay:
    """`replay_real_time` of a run's folder, with a progress bar unless `quiet`. Raises ConfigError for what `read_run` does not take."""
    scenario, frames = read_run(run_dir)
    own_ids = planner_ids(load_robot(scenario.robot).devices)
    if not any(frame.can_id == SYNC_ID for frame in frames):
        raise ConfigError(f"{run_dir / 'bus.log'}: holds no SYNC, so there is no arm cycle to compare")
    with progress_bar(f"replay {run_dir.name}", frames[-1].t_ns, quiet=quiet) as advance:
        shown = partial(_show, advance)
        return replay_real_time(scenario, frames, own_ids, on_progress=shown)


def _show(advance: Callable[[float, str], None], t_ns: int) -> None:
    advance(t_ns, f"{t_ns * 1e-9:.1f} s")


def _compared(
    grid: list[tuple[int, Frame]], sent: dict[tuple[int, int], bytes], codecs: list[DriveCodec], tolerance: float
) -> RealTimeReplay:
    by_id = {codec.set_point_id & 0x7FF: codec for codec in codecs}
    off: dict[str, list[float]] = {codec.name: [] for codec in codecs}
    cycles = set()
    for cycle, frame in grid:
        codec = by_id.get(frame.can_id)
        if codec is None or frame.data[:2] != b"\x0f\x00":  # only what moves: the drive is enabled
            continue
        cycles.add(cycle)
        data = sent.get((cycle, frame.can_id))
        recorded = codec.decode_set_point(frame.data)[1]
        off[codec.name].append(np.inf if data is None else abs(codec.decode_set_point(data)[1] - recorded))
    everything = np.concatenate([np.array(values) for values in off.values()])
    return RealTimeReplay(
        len(cycles),
        len(everything),
        float(np.mean(everything <= tolerance)) if len(everything) else 0.0,
        tolerance,
        {name: max(values, default=0.0) for name, values in off.items()},
    )
