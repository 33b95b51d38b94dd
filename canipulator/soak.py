"""Random tasks with random faults, for as long as one likes; the smallest case that breaks what must hold is kept."""

from __future__ import annotations

import random
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from canipulator.judging import check_scenario
from canipulator.outcome import RunOptions, progress_bar
from canipulator.run import LockstepRun
from config.errors import ConfigError
from config.faults import DRIVES, JOINTS, KINDS, WHEELS
from config.load import dump_scenario, load_scenario, scenario_names
from config.robot import load_robot
from config.scenario import Scenario
from drivers.catalogue import PLANNER_ID
from logs.bus_log import read_bus_log

TASKS = ("sliding-door", "hold-still", "drive-square", "force-guided", "hinged-door", "point-to-point")
LEFT_OUT = ("sigkill", "disk-full")
"""Kinds that are about files, not about motion."""
POSITION_TOLERANCE = 2e-3
VELOCITY_SHARE = 1.1 * 1.2
"""Of the robot's velocity limits: what the drives let a set point do (607Fh), and what a joint at full speed gets beyond it where the
others push it and its torque offset comes late (1.27 seen) or the brake of one closes (1.16 seen)."""
SHOCK_SHARE, SHOCK_STEPS = 1.5, 20
"""What a joint may get, and for how many milliseconds, when the one next to it is stopped from one moment to the next or all catch up
after a blocked bus: its own loop has to take back what it was given (1.34 for 6 ms seen)."""
FALLING = ("following-error",)
"""Kinds under which a joint may be faster than its limit until its brake closes."""
SHORTEST_S = 0.5


@dataclass(frozen=True)
class Case:
    """One run: a scenario with faults, cut at `duration_s`."""

    scenario: Scenario
    duration_s: float

    @property
    def text(self) -> str:
        faults = "; ".join(f"{fault.at:g} s {fault.text}" for fault in self.scenario.fault) or "no fault"
        return f"{self.scenario.name}, seed {self.scenario.seed}, {self.duration_s:g} s: {faults}"


@dataclass(frozen=True)
class Failure:
    """What did not hold, and at which time of the run (s)."""

    what: str
    at_s: float


def random_case(draw: random.Random) -> Case:
    """A task of the project, one to four faults."""
    name = draw.choice([task for task in TASKS if task in scenario_names()])
    duration_s = round(draw.uniform(2.5, 7.0), 1)
    scenario = load_scenario(name, [f"seed={draw.randrange(1, 10_000)}"])
    assert isinstance(scenario, Scenario)
    faults = [_random_fault(draw, duration_s) for _ in range(draw.randrange(1, 5))]
    data = scenario.model_dump(exclude_none=True)
    return Case(Scenario.model_validate({**data, "fault": tuple(faults)}), duration_s)


def _random_fault(draw: random.Random, duration_s: float) -> dict[str, Any]:
    kind = draw.choice([kind for kind in KINDS if kind not in LEFT_OUT])
    fault: dict[str, Any] = {"kind": kind, "at": round(draw.uniform(0.0, duration_s - 0.5), 3)}
    if kind.startswith(("frame-", "wire-")):
        fault["probability"] = round(draw.choice((0.01, 0.1, 0.3, 1.0)) * draw.uniform(0.3, 1.0), 4)
        if draw.random() < 0.5:
            fault["node"] = draw.choice((1, 2, 31, 32, *DRIVES))
        if kind == "frame-corruption":
            fault["checksum"] = draw.choice(("valid", "invalid"))
    elif kind in ("bus-off", "duplicate-node"):
        fault["node"] = draw.choice((1, 2, 31, *DRIVES))
    elif kind.startswith("wheel-"):
        fault["node"] = draw.choice(WHEELS)
    elif kind in ("drive-stuck", "following-error"):
        fault["node"] = draw.choice(JOINTS)
    elif kind.startswith(("drive-", "encoder-")) or kind == "over-current":
        fault["node"] = draw.choice(DRIVES)
    if kind == "encoder-jump":
        fault["amount"] = round(draw.choice((-1, 1)) * 10.0 ** draw.uniform(-3.0, 1.0), 4)
    if draw.random() < 0.5 and kind not in ("over-current", "planner-killed", "strategic-killed"):
        fault["for_s"] = round(draw.uniform(0.02, 1.0), 3)
        if not _takes_end(kind):
            del fault["for_s"]
    return fault


def _takes_end(kind: str) -> bool:
    try:
        load_scenario("hold-still", faults=[f"{kind}@1:for_s=0.5"])
    except ConfigError:
        return False
    return True


def run_case(case: Case) -> Failure | None:
    """Runs it and looks: nothing raised, nothing beyond its limits in the physics, files whole."""
    scenario = case.scenario
    robot = load_robot(scenario.robot)
    check_scenario(scenario, robot)
    found: list[Failure] = []
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        options = RunOptions(out=Path(folder), duration_s=case.duration_s, record=False, quiet=True)
        try:
            with LockstepRun(scenario, robot, options, Path(folder)) as run:
                world, arm = run.sim.world, robot.arm
                low, high = arm.q_min - POSITION_TOLERANCE, arm.q_max + POSITION_TOLERANCE
                fastest, ever = _share(scenario) * arm.dq_max, max(SHOCK_SHARE, _share(scenario)) * arm.dq_max
                too_fast = np.zeros(len(arm.q_min), dtype=np.int64)
                step = world.step

                def watched() -> None:
                    step()
                    physics = world.physics
                    speed = abs(physics.dq)
                    too_fast[:] = np.where(speed > fastest, too_fast + 1, 0)
                    slow = np.all(speed <= ever) and np.all(too_fast <= SHOCK_STEPS)
                    if found or (np.all(physics.q >= low) and np.all(physics.q <= high) and slow):
                        return  # NaN compares as False, and is found
                    now_s = run.clock.now_ns() * 1e-9
                    found.append(
                        Failure(f"q = {physics.q.round(4)}, dq = {physics.dq.round(3)} at {now_s:.3f} s", now_s)
                    )

                world.step = watched  # type: ignore[method-assign]
                if run.go():
                    raise KeyboardInterrupt
                now_s = run.clock.now_ns() * 1e-9
            run.metrics(judged=False)
            for _ in read_bus_log(Path(folder) / "bus.log"):
                pass
        except KeyboardInterrupt:
            raise
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            at_s = run.clock.now_ns() * 1e-9 if "run" in locals() else 0.0
            found.append(Failure(f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})", at_s))
    return found[0] if found else None


def _share(scenario: Scenario) -> float:
    """How fast joints may be, of their velocity limits."""
    falls = any(fault.kind in FALLING for fault in scenario.fault)
    # A set point frame has no room for a checksum: torque offsets that are plausible one by one may drive a light joint faster than its
    # loop would, until its drive's overspeed supervision takes its power away.
    forged = any(fault.checksum == "valid" and fault.node in (None, PLANNER_ID) for fault in scenario.fault)
    return float(np.inf) if falls or forged else VELOCITY_SHARE


def smaller(case: Case, failure: Failure) -> Iterator[Case]:
    """Cases that are simpler than this one: shorter, then with one fault less each."""
    shorter = max(SHORTEST_S, round(failure.at_s + 0.05, 2))
    if shorter < case.duration_s - 0.05:
        yield Case(case.scenario, shorter)
    for i in range(len(case.scenario.fault)):
        rest = case.scenario.fault[:i] + case.scenario.fault[i + 1 :]
        yield Case(case.scenario.model_copy(update={"fault": rest}), case.duration_s)


def minimise(case: Case, failure: Failure) -> tuple[Case, Failure]:
    """The smallest case on the way down that still fails, in whatever way."""
    while True:
        for candidate in smaller(case, failure):
            again = run_case(candidate)
            if again is not None:
                case, failure = candidate, again
                break
        else:
            return case, failure


def soak(minutes: float, seed: int, folder: Path, *, quiet: bool = False) -> int:
    """Runs cases until the time is over; the number of failures. Each leaves `soak-<seed>-<n>.toml` in `folder`."""
    draw = random.Random(seed)
    began, failures, cases = time.monotonic(), 0, 0
    with progress_bar(f"soak, seed {seed}", 60.0 * minutes, quiet=quiet) as advance:
        while (elapsed := time.monotonic() - began) < 60.0 * minutes:
            advance(elapsed, f"{cases} cases, {failures} failures")
            case = random_case(draw)
            cases += 1
            failure = run_case(case)
            if failure is None:
                continue
            failures += 1
            click.echo(f"case {cases} fails: {case.text}\n  {failure.what}", err=True)
            case, failure = minimise(case, failure)
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / f"soak-{seed}-{cases}.toml"
            scenario = case.scenario.model_copy(update={"duration_s": case.duration_s, "expect": ()})
            path.write_text(f"# {' '.join(failure.what.split())}\n{dump_scenario(scenario)}", encoding="utf-8")
            click.echo(f"  smallest: {case.text}\n  {failure.what}\n  canipulator run {path}", err=True)
    click.echo(f"soak, seed {seed}: {cases} cases in {time.monotonic() - began:.0f} s, {failures} failures")
    return failures
