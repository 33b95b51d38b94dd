"""Replay: the recorded frames of a run into its planner, and the planner's own frames against the recorded ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from canipulator.fault_injection import FAULT_LOG
from canipulator.outcome import progress_bar
from canipulator.roles import planner_role
from config.errors import ConfigError
from config.load import load_scenario
from config.robot import load_robot
from config.scenario import Scenario
from drivers.bus.playback import Pair, PlaybackBus
from drivers.canopen.nmt import ERROR_CONTROL_BASE, NMT_CAN_ID
from drivers.catalogue import DRIVE_IDS, PLANNER_ID
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.objects import DeviceDef, PdoKind
from drivers.tables.planner import METHOD
from logs.bus_log import BusLogError, read_bus_log
from logs.frame_text import FrameReader, differing_fields
from logs.open_loop import SetPoints, set_points
from logs.tape import SYNC_ID
from stack.planner.parameters import Method

CHUNK_NS = 100_000_000


@dataclass(slots=True)
class Replayed:
    """How the planner's frames compare. `frames`: of the log; `differing`: changed, missing, or sent in excess; `first` the first of them.

    `pairs`: all that were compared, in the order of the wire.
    """

    frames: int = 0
    differing: int = 0
    cycles: int = 0
    first: Pair | None = None
    pairs: list[Pair] = field(default_factory=list)

    @property
    def identical(self) -> bool:
        return self.differing == 0


def read_run(run_dir: Path) -> tuple[Scenario, list[Frame]]:
    """Scenario and frames of a lockstep run. Raises ConfigError for a folder that is none, or whose log cannot be read."""
    path, log = run_dir / "scenario.toml", run_dir / "bus.log"
    for needed in (path, log):
        if not needed.is_file():
            raise ConfigError(f"{needed}: no such file; RUN must be the folder of a run")
    scenario = load_scenario(str(path))
    if not isinstance(scenario, Scenario):
        raise ConfigError(
            f"{run_dir}: a kinematic run ({scenario.name}) has no bus, so there is nothing to replay or decode"
        )
    try:
        frames = list(read_bus_log(log))
    except BusLogError as error:
        raise ConfigError(str(error)) from None
    if not frames:
        raise ConfigError(f"{log}: holds no frame")
    return scenario, frames


def read_as_sent(run_dir: Path) -> list[Frame]:
    """Frames that injected faults swallowed or changed, as they were sent. Raises ConfigError for a log that cannot be read."""
    log = run_dir / FAULT_LOG
    try:
        return list(read_bus_log(log)) if log.is_file() else []
    except BusLogError as error:
        raise ConfigError(str(error)) from None


def planner_ids(devices: dict[int, DeviceDef]) -> frozenset[int]:
    """Identifiers that node 2 sends: its own, NMT and SYNC, and as master of the drives their set points and SDO requests."""
    own = {NMT_CAN_ID, SYNC_ID, 0x080 + PLANNER_ID, 0x580 + PLANNER_ID, ERROR_CONTROL_BASE + PLANNER_ID}
    own |= {pdo.cob_id & 0x7FF for pdo in devices[PLANNER_ID].pdos if pdo.kind is PdoKind.TPDO}
    for node_id in DRIVE_IDS:
        own.add(0x600 + node_id)
        own |= {pdo.cob_id & 0x7FF for pdo in devices[node_id].pdos if pdo.kind is PdoKind.RPDO}
    return frozenset(own)


def replay(
    scenario: Scenario,
    frames: list[Frame],
    *,
    as_sent: Iterable[Frame] = (),
    tolerance: float = 0.0,
    on_progress: Callable[[int], None] = lambda t_ns: None,
) -> Replayed:
    """Rebuilds the planner of `scenario`, plays `frames` to it in virtual time, and compares what it sends.

    The same scenario and log give the same answer, and for the log of a lockstep run it is bit-identical: the log's microseconds are
    the bus's own wherever a bit takes whole microseconds, and at 800 kbit/s nothing that the planner computes depends on the rest.
    `as_sent`: see `read_as_sent`. `tolerance` (SI): see `differing_fields`.
    """
    robot = load_robot(scenario.robot)
    reader = FrameReader(robot.devices.values())
    result = Replayed()

    def compare(pair: Pair) -> None:
        result.pairs.append(pair)
        result.frames += pair.recorded is not None
        result.cycles = pair.sync_count
        if not pair.same and not (tolerance > 0.0 and _within(reader, pair, tolerance)):
            result.differing += 1
            result.first = result.first or pair

    clock = LockstepClock()
    bus = PlaybackBus(
        clock,
        frames,
        planner_ids(robot.devices),
        compare,
        as_sent=as_sent,
        bitrate=scenario.bus.bitrate,
        queue_limit=scenario.bus.queue_frames,
    )
    planner = planner_role(robot, scenario, clock, bus, lambda level, source, text: None)
    bus.start()
    planner.power_on()
    while not bus.ended:
        clock.run_until(clock.now_ns() + CHUNK_NS)
        on_progress(clock.now_ns())
    return result


def replay_run(run_dir: Path, method: str | None = None, *, quiet: bool = False) -> tuple[Scenario, Replayed]:
    """`replay` of a run's folder, with another method of the planner if one is given; with a progress bar unless `quiet`.

    Raises ConfigError for what `read_run` does not take, and for a run in real time.
    """
    scenario, frames = read_run(run_dir)
    if was_in_real_time(run_dir):
        raise ConfigError(
            f"{run_dir}: a run in real time; only runs on the lockstep bus can be replayed frame by frame"
        )
    if method is not None:
        scenario = load_scenario_with(run_dir, method)
        frames = [_with_method(frame, Method.named(method)) for frame in frames]
    end_ns = frames[-1].t_ns
    with progress_bar(f"replay {run_dir.name}", end_ns, quiet=quiet) as advance:
        as_sent = read_as_sent(run_dir)
        result = replay(
            scenario, frames, as_sent=as_sent, on_progress=lambda t_ns: advance(t_ns, f"{t_ns * 1e-9:.1f} s")
        )
    return scenario, result


def was_in_real_time(run_dir: Path) -> bool:
    """By the files that such a run leaves; their times have the jitter of the machine, which no virtual clock repeats."""
    metrics = run_dir / "metrics.json"
    late = metrics.is_file() and '"max_lateness_us"' in metrics.read_text(encoding="utf-8", errors="replace")
    return late or (run_dir / "timing.json").is_file()


def _with_method(frame: Frame, method: Method) -> Frame:
    """The strategic node's write of the planner's object "method" asks for another one; every other frame is as it was."""
    is_write = frame.can_id == 0x600 + PLANNER_ID and frame.data[:4] == _WRITE_METHOD
    return frame._replace(data=_WRITE_METHOD + bytes((method, 0, 0, 0))) if is_write else frame


_WRITE_METHOD = b"\x2f" + METHOD.to_bytes(2, "little") + b"\x00"
"""Expedited SDO download of one byte (CiA 301, 7.2.4.3.3)."""


def drive_set_points(result: Replayed, devices: dict[int, DeviceDef]) -> list[SetPoints]:
    """Set points of every drive as they were sent in the run and in the replay, wheels first."""
    found = []
    for node_id in DRIVE_IDS:
        device = devices[node_id]
        can_id = next(pdo.cob_id for pdo in device.pdos if pdo.kind is PdoKind.RPDO and pdo.number == 1) & 0x7FF
        both = [
            (pair.recorded, pair.sent)
            for pair in result.pairs
            if pair.recorded is not None and pair.sent is not None and pair.recorded.can_id == can_id
        ]
        times = [recorded.t_ns for recorded, _ in both]
        found.append(set_points(device, times, [a.data for a, _ in both], [b.data for _, b in both]))
    return found


def load_scenario_with(run_dir: Path, method: str) -> Scenario:
    """The run's scenario, its planner with another method. Raises ConfigError for a method that does not exist."""
    scenario = load_scenario(str(run_dir / "scenario.toml"), [f'planner.method="{method}"'])
    assert isinstance(scenario, Scenario)
    return scenario


def explain(pair: Pair, devices: Iterable[DeviceDef]) -> str:
    """A difference in words: cycle, time, message, and each field that differs with what was expected (the log) and what came."""
    reader = FrameReader(devices)
    known = pair.recorded or pair.sent
    assert known is not None
    message = reader.read(known.can_id, known.data)
    where = f"arm cycle {pair.sync_count - 1}, {known.t_ns * 1e-9:.6f} s, {known.can_id:03X}h {message.message}"
    if pair.sent is None:
        return f"{where}\n  expected  {_fields(reader, known)}\n  got       nothing: the planner did not send it"
    if pair.recorded is None:
        return f"{where}\n  expected  nothing: it is not in the log\n  got       {_fields(reader, known)}"
    lines = [where]
    got = reader.read(pair.sent.can_id, pair.sent.data)
    for a, b in differing_fields(message, got):
        name = a.name if a is not None else b.name if b is not None else ""
        lines.append(f"  {name}: expected {a if a is not None else 'nothing'}, got {b if b is not None else 'nothing'}")
    lines.append(f"  bytes: expected {pair.recorded.data.hex(' ').upper()}, got {pair.sent.data.hex(' ').upper()}")
    return "\n".join(lines)


def _fields(reader: FrameReader, frame: Frame) -> str:
    texts = [f"{entry.name} {entry}" for entry in reader.read(frame.can_id, frame.data).fields]
    return ", ".join(texts) or "a frame without data"


def _within(reader: FrameReader, pair: Pair, tolerance: float) -> bool:
    if pair.recorded is None or pair.sent is None:
        return False
    a, b = (reader.read(frame.can_id, frame.data) for frame in (pair.recorded, pair.sent))
    return not differing_fields(a, b, tolerance)
