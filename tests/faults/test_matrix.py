"""Every kind of fault, in mid-motion: what the joints and the hand do (by the physics), what the bus and the log say, and when."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from canipulator.outcome import RunOptions
from canipulator.run import run_scenario
from config.faults import KINDS
from config.load import scenario_names
from drivers.canopen.emcy import EmcyCode
from logs.bus_log import read_bus_log
from logs.columns import TIMELINE
from stack.planner.limits import Flags
from tests.faults.harness import TICK_S, Record, scenario_with, watch

pytestmark = pytest.mark.slow

TEXT = "TextLog:text"
STILL = 0.02
"""A joint stands below this share of its velocity limit."""
CONTROLLED = 10.0
"""m/s²: the hand under any stop that keeps its torque; 20 ms means."""
BRAKES = 60.0
"""m/s²: the hand where brakes fall in on an arm whose motor had let it fall."""
MOVING_FROM = {"sliding-door": 2.0, "hold-still": 1.5, "force-guided": 2.5, "hinged-door": 2.5}
"""When each scenario is in mid-motion."""


@dataclass(frozen=True)
class Row:
    """A fault and what must follow: `stops`: everything stands after `within_s`; else the task goes on. `emergencies`: (node, code)
    on the bus by `told_s`. `falls_s`: how long a joint may be faster than its limit (a dead motor under gravity).
    `task`: only in this scenario."""

    spec: str
    stops: bool
    within_s: float = 0.6
    emergencies: tuple[tuple[int, EmcyCode], ...] = ()
    told_s: float = 0.05
    deceleration: float = CONTROLLED
    falls_s: float = 0.0
    run_s: float = 2.0
    task: str | None = None

    @property
    def kind(self) -> str:
        return self.spec.partition("@")[0].partition(":")[0]

    def at(self, seconds: float) -> str:
        kind, _, parameters = self.spec.partition(":")
        return f"{kind}@{seconds:g}" + (f":{parameters}" if parameters else "")


ALL_DRIVES = (11, 12, *range(21, 29))
SYNC_LOST = tuple((node, EmcyCode.SYNC_LOST) for node in ALL_DRIVES)
ROWS = (
    Row("frame-loss:count=1,probability=1", stops=False),
    Row("frame-loss:probability=1,count=30,burst=30", stops=False),
    Row("frame-loss:probability=0.01", stops=False),
    Row("frame-loss:probability=0.1", stops=False),
    Row("frame-loss:probability=0.3,for_s=0.3", stops=False),
    Row("frame-loss:node=2,probability=1", stops=True, within_s=0.7, emergencies=SYNC_LOST),
    Row("frame-delay:delay_s=0.005", stops=False),
    Row("frame-duplicate:probability=0.3", stops=False),
    Row("frame-reorder:probability=0.2", stops=False),
    Row("frame-corruption:checksum=invalid,probability=0.2", stops=False),
    Row("frame-corruption:checksum=valid,probability=0.02,node=1", stops=False),
    Row("wire-error:probability=0.2", stops=False),
    Row("bus-off:node=23", stops=True),
    Row("bus-off:node=2", stops=True, within_s=0.7, emergencies=SYNC_LOST),
    Row("babbling-idiot", stops=True, told_s=0.3),
    Row("sync-loss:count=1", stops=False),
    Row("sync-loss:for_s=0.5", stops=True, emergencies=SYNC_LOST),
    Row("sync-jitter:jitter_s=0.002", stops=False),
    Row("duplicate-node:node=23", stops=True, emergencies=((23, EmcyCode.CAN_ID_COLLISION),)),
    Row("drive-reboot:node=23", stops=True),
    Row("drive-reboot:node=11", stops=True),
    Row(
        "drive-stuck:node=21",
        stops=True,
        within_s=2.6,
        run_s=3.0,
        emergencies=((21, EmcyCode.FOLLOWING_ERROR),),
        told_s=1.8,
    ),
    Row("over-current:node=24", stops=True, emergencies=((24, EmcyCode.OVER_CURRENT),), told_s=0.015),
    Row("encoder-jump:node=23", stops=True, emergencies=((23, EmcyCode.SENSOR),), told_s=0.015),
    Row("encoder-jump:node=11,amount=3", stops=True, emergencies=((11, EmcyCode.SENSOR),), told_s=0.015),
    Row("encoder-frozen:node=21", stops=True, emergencies=((21, EmcyCode.SENSOR),), told_s=0.1),
    Row(
        "encoder-frozen:node=24",
        stops=True,
        emergencies=((24, EmcyCode.SENSOR),),
        told_s=0.06,
        task="hold-still",  # no set point moves: its last digit stands still, which it never does
    ),
    Row("encoder-lost:node=25", stops=True, emergencies=((25, EmcyCode.SENSOR),), told_s=0.015),
    Row(
        "following-error:node=23",
        stops=True,
        within_s=0.8,
        emergencies=((23, EmcyCode.FOLLOWING_ERROR),),
        told_s=0.25,
        deceleration=BRAKES,
        falls_s=0.4,
        task="hold-still",  # a hand that holds a handle keeps the arm from falling
    ),
    Row("planner-killed", stops=True, within_s=0.7, emergencies=SYNC_LOST),
    Row("planner-slow", stops=False),
    Row("strategic-killed", stops=True, within_s=0.8),
    Row("force-stuck", stops=False, emergencies=((31, EmcyCode.SENSOR),), told_s=0.06),
    Row("force-saturated", stops=False, emergencies=((31, EmcyCode.SENSOR),)),
    Row("force-nan", stops=False, emergencies=((31, EmcyCode.SENSOR),)),
    Row(
        "wheel-blocked:node=12", stops=True, within_s=2.6, run_s=3.0, emergencies=((12, EmcyCode.VELOCITY),), told_s=1.6
    ),
    Row("wheel-slip:node=11", stops=False),
    Row("feedback-lost", stops=False),
    Row("disk-full", stops=False),
    Row("disk-full:file=events.log", stops=False),
)
EVERY_TIME = ("sliding-door", "hold-still")
LEANS_ON_FORCES = ("force-guided", "hinged-door")
"""Tasks that end when no force is heard: half a second, then the planner's controlled stop."""
FOUND_BY_ERROR = {"drive-stuck": 0.11, "wheel-blocked": 0.42}
"""Kinds that show only once something is asked of the axis that it does not do, and how long (s) after that its drive says so:
docs/faults.md, and a cycle or two."""


def in_task(row: Row, name: str) -> Row:
    """What follows in this task, where it is something else than in the others."""
    if name in LEANS_ON_FORCES and row.kind.startswith("force-"):
        return replace(row, stops=True, within_s=1.2)
    return row


def test_every_kind_is_in_the_matrix() -> None:
    assert {row.kind for row in ROWS} | {"sigkill"} == set(KINDS)


def cases() -> list[object]:
    """The sliding door with every fault; the other tasks, where they exist, in the full matrix (`make faults`)."""
    present = [name for name in MOVING_FROM if name in scenario_names()]
    return [
        pytest.param(name, row, id=f"{name}-{row.spec}", marks=() if name in EVERY_TIME else pytest.mark.faults)
        for name in present
        for row in ROWS
        if row.task == name or (row.task is None and name != "hold-still")
    ]


@pytest.mark.parametrize(("name", "row"), cases())
def test_a_fault_in_mid_motion(name: str, row: Row, tmp_path: Path) -> None:
    begin_s, row = MOVING_FROM[name], in_task(row, name)
    scenario = scenario_with(name, [row.at(begin_s)])
    record = watch(scenario, tmp_path, begin_s + row.run_s)
    assert_limits_hold(record, row, begin_s)
    shows_late = row.kind in FOUND_BY_ERROR and name not in EVERY_TIME
    if shows_late:
        assert_found_by_its_error(record, row, begin_s)
    elif name == "hinged-door" and row.spec == "frame-corruption:checksum=invalid,probability=0.2":
        assert_goes_on_or_gives_up(record)
    elif row.stops:
        assert_everything_stands(record, begin_s + row.within_s)
    else:
        assert_the_task_goes_on(record, moving=name == "sliding-door")
    for node, code in () if shows_late else row.emergencies:
        told = [t_s for t_s, found in record.emergencies(node, begin_s) if found == code]
        assert told, f"no EMCY {code:04X}h of node {node}"
        assert told[0] - begin_s < row.told_s
    assert_files_are_whole(record, row, begin_s)


def assert_stuck(record: Record, joint: int, from_s: float) -> None:
    """It stands, until the platform pulls at a door by it with more than a brake holds: then it gives a little way."""
    closed = record.t >= from_s
    assert np.abs(record.dq[closed & (record.t < from_s + 0.3), joint]).max() < 1e-3
    assert np.ptp(record.q[closed, joint]) < 0.05


def assert_found_by_its_error(record: Record, row: Row, begin_s: float) -> None:
    """Nothing is found, and nothing is asked of the axis that it does not do; or it is found in time, and everything stands."""
    ((node, code),) = row.emergencies
    axis = ALL_DRIVES.index(node)
    dictionary = record.run.sim.drives[axis].node.dictionary
    if row.kind == "drive-stuck":
        error = np.abs(record.set_point[:, axis] - record.q[:, axis - 2])
        allowed = 1e-6 * dictionary.integer(0x6065)
        assert_stuck(record, axis - 2, begin_s + 0.2)
    else:
        error = np.abs(record.set_velocity[:, axis] - record.wheels[:, axis])
        allowed = 0.15e-6 * dictionary.integer(0x607F)
    told = [t_s for t_s, found in record.emergencies(node, begin_s) if found == code]
    outside = (error > allowed) & (record.t > begin_s) & (record.t < (told[0] if told else np.inf))
    assert longest_s(outside) < FOUND_BY_ERROR[row.kind], f"{error[outside].max():.3f} off, allowed is {allowed:.3f}"
    if not told:
        return
    assert outside[record.t < told[0]][-1]
    assert_everything_stands(record, told[0] + 0.7)


def longest_s(holds: Flags) -> float:
    """The longest time for which it holds without a break."""
    edges = np.flatnonzero(np.diff(holds.astype(int), prepend=0, append=0))
    return float((edges[1::2] - edges[::2]).max(initial=0)) * TICK_S


def assert_goes_on_or_gives_up(record: Record) -> None:
    """A task that needs three frames of a kind at once may find too few of them; then it says so and everything stands."""
    if record.run.planner.phase.name == "EXECUTING":
        return
    (said,) = record.said("the planner does not say where the hand is")
    assert_everything_stands(record, said.t_ns * 1e-9 + 0.6)


def assert_limits_hold(record: Record, row: Row, begin_s: float) -> None:
    arm = record.run.robot.arm
    beyond = np.maximum(arm.q_min - record.q, record.q - arm.q_max).max()
    assert beyond < 1e-3, f"{beyond:.4f} rad (m) beyond a position limit"
    excess = (np.abs(record.dq) / arm.dq_max).max(axis=1)
    tolerated = (record.t > begin_s) & (record.t < begin_s + row.falls_s)
    fastest = excess[~tolerated].max()
    assert fastest < 1.05, f"a joint at {fastest:.2f} of its velocity limit"
    hardest = record.tcp_deceleration().max()
    assert hardest < row.deceleration, f"the hand at {hardest:.1f} m/s²"


def assert_everything_stands(record: Record, after_s: float) -> None:
    arm = record.run.robot.arm
    late = record.after(after_s)
    joints, wheels = (np.abs(record.dq[late]) / arm.dq_max).max(axis=1), np.abs(record.wheels[late]).max(axis=1)
    moving = record.t[late][(joints > STILL) | (wheels > 0.2)]  # rad/s: 2 cm/s
    assert not len(moving), (
        f"moves until {moving[-1]:.3f} s: joints {joints.max():.3f} of their limit, wheels {wheels.max():.2f}"
    )


def assert_the_task_goes_on(record: Record, *, moving: bool) -> None:
    assert record.run.planner.phase.name == "EXECUTING"
    if moving:
        way = np.linalg.norm(record.tcp[-1] - record.tcp[-501])
        assert way > 0.5 * 0.2 * 0.5  # at half of its speed at least, over the last half second


def assert_files_are_whole(record: Record, row: Row, begin_s: float) -> None:
    (injected,) = record.said(f"fault injected: {row.kind}")
    assert injected.t_ns == round(begin_s * 1e9)
    lines = (record.directory / "events.log").read_text(encoding="utf-8").splitlines()
    if "events.log" not in row.spec:
        assert any(f"fault injected: {row.kind}" in line and float(line.split()[0]) == begin_s for line in lines)
    logged = list(read_bus_log(record.directory / "bus.log"))
    if row.spec == "disk-full":
        assert any("No space left" in line for line in lines)
        assert logged[-1].t_ns * 1e-9 > begin_s - 0.02
    else:
        assert len(logged) == len(record.frames)
    metrics = record.run.metrics(judged=False).as_dict()
    assert metrics["faults_injected"] == 1
    assert any("fault injected" in fault for fault in metrics["faults"])


def test_the_recording_has_the_fault_at_its_time(tmp_path: Path) -> None:
    scenario = scenario_with("sliding-door", ["over-current@1.5:node=24"])
    outcome = run_scenario(scenario, RunOptions(out=tmp_path, duration_s=2.0, quiet=True))
    assert outcome.metrics["faults_injected"] == 1
    assert (1_500_000_000, "fault: fault injected: over-current node=24") in texts_of(tmp_path / "run.rrd")


def texts_of(path: Path) -> list[tuple[int, str]]:
    """(time, text) of all log lines in a recording."""
    found = []
    for chunk in RrdReader(str(path)).stream():
        batch = None if chunk.is_static else chunk.to_record_batch()
        if batch is not None and TEXT in batch.schema.names and TIMELINE in batch.schema.names:
            times = batch.column(TIMELINE).to_numpy(zero_copy_only=False).astype(np.int64)
            found += [(int(t), text[0]) for t, text in zip(times, batch.column(TEXT).to_pylist(), strict=True)]
    return found
