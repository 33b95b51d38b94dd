"""A run of a scenario with faults, watched by the physics itself: every millisecond of the truth, every frame, every event."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from canipulator.outcome import RunOptions
from canipulator.run import LockstepRun
from config.load import load_scenario
from config.robot import load_robot
from config.scenario import Scenario
from drivers.frame import Frame
from logs.events import Event
from stack.messages import Matrix, Vector
from stack.planner.parameters import Limits

TICK_S = 1e-3


@dataclass
class Record:
    """`t` (s), `q`, `dq` (rows of 8), `tcp` (rows of 3, m), `wheels` (rows of 2, rad/s of the encoders): the truth, tick by tick.

    `set_point`, `set_velocity`: (rows of 10, wheels first) what the loops of the drives follow.
    """

    directory: Path
    run: LockstepRun
    t: Vector
    q: Matrix
    dq: Matrix
    tcp: Matrix
    wheels: Matrix
    set_point: Matrix
    set_velocity: Matrix
    frames: list[Frame]
    events: list[Event]

    @property
    def limits(self) -> Limits:
        return self.run.robot.limits

    def after(self, t_s: float) -> slice:
        """The rows from `t_s` on."""
        return slice(int(np.searchsorted(self.t, t_s)), None)

    def tcp_deceleration(self) -> Vector:
        """|d²x/dt²| of the TCP (m/s²), by differences over 20 ms: what a body in the hand would feel, without single ticks."""
        n = 20
        velocity = (self.tcp[n:] - self.tcp[:-n]) / (n * TICK_S)
        return np.linalg.norm((velocity[n:] - velocity[:-n]) / (n * TICK_S), axis=1)  # type: ignore[no-any-return]

    def said(self, text: str) -> list[Event]:
        """Events with `text` in them."""
        return [event for event in self.events if text in event.text]

    def emergencies(self, node: int, after_s: float = 0.0) -> list[tuple[float, int]]:
        """(time, code) of a node's emergency messages on the bus."""
        return [
            (frame.t_ns * 1e-9, int.from_bytes(frame.data[:2], "little"))
            for frame in self.frames
            if frame.can_id == 0x080 + node and len(frame.data) == 8 and frame.t_ns * 1e-9 >= after_s
        ]


def scenario_with(name: str, faults: Iterable[str], overrides: Iterable[str] = ()) -> Scenario:
    loaded = load_scenario(name, overrides, faults)
    assert isinstance(loaded, Scenario)
    return loaded


def watch(scenario: Scenario, directory: Path, duration_s: float, *, record: bool = False) -> Record:
    """Runs `scenario` for `duration_s` and keeps everything. Files are those of an ordinary run."""
    directory.mkdir(parents=True, exist_ok=True)
    options = RunOptions(out=directory, duration_s=duration_s, record=record, quiet=True)
    q, dq, tcp, wheels, set_point, set_velocity = [], [], [], [], [], []
    frames: list[Frame] = []
    with LockstepRun(scenario, load_robot(scenario.robot), options, directory) as run:
        run.bus.observe(frames.append)
        world = run.sim.world
        step = world.step

        def watched() -> None:
            step()
            physics = world.physics
            q.append(physics.q.copy())
            dq.append(physics.dq.copy())
            tcp.append(physics.pose_WE()[:3, 3])
            wheels.append(world.plant.wheels.encoder_rate.copy())
            servo = run.sim.bank.servo.state
            set_point.append(servo.set_point.copy())
            set_velocity.append(servo.set_velocity.copy())

        world.step = watched  # type: ignore[method-assign]
        run._done = lambda: False  # type: ignore[method-assign]  # a mission that has failed is no reason to look away
        run.go()
    t = TICK_S * np.arange(1, len(q) + 1)
    events = list(run.log.table.events)
    rows = [np.array(each) for each in (q, dq, tcp, wheels, set_point, set_velocity)]
    return Record(directory, run, t, *rows, frames, events)
