"""A cell to try the master in: ten real drives on a linear plant, the planner's node, one lockstep bus."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from drivers.bus.interception import Verdict
from drivers.bus.lockstep import LockstepBus
from drivers.canopen.node import CanopenNode, NodeApplication
from drivers.catalogue import DRIVE_IDS, PLANNER_ID, devices
from drivers.cia402.bank import DriveBank
from drivers.cia402.bring_up import MasterTimes
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.device import Drive
from drivers.cia402.master import DriveMaster
from drivers.cia402.phases import DriveEvent, EventKind, MasterPhase
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.objects import DeviceDef
from stack.messages import Vector
from stack.servo.state import BoolVector, ServoParameters

MS = 1_000_000
TICK_NS = MS
SYNC_NS = 10 * MS
COUNT = len(DRIVE_IDS)
WHEELS = 2
START = np.array([0.0, 0.0, 0.3, 0.6, -0.4, 0.5, 1.0, -1.2, 0.2, 0.7])
LOAD = np.array([0.0, 0.0, 0.0, 50.0, 8.0, -5.0, 3.0, 0.0, 0.5, 0.0])
"""Constant load on each axis, N·m or N: what an arm's weight is to its drives."""


class LinearPlant:
    """Unit inertias under a constant load; wheels take velocity; brakes hold what has no power."""

    def __init__(self) -> None:
        self.position = START.copy()
        self.velocity = np.zeros(COUNT)
        self.command = np.zeros(COUNT)
        self.engaged = np.ones(COUNT, dtype=np.bool_)
        self._trembling = 1e-6

    def read(self, position: Vector, velocity: Vector) -> None:
        position[:] = self.position
        velocity[:] = self.velocity

    def write(self, command: Vector) -> None:
        self.command = command.copy()

    def brake(self, engaged: BoolVector) -> None:
        self.engaged = engaged

    def step(self, dt_s: float) -> None:
        self.velocity += (self.command - LOAD) * dt_s
        self.velocity[:WHEELS] = self.command[:WHEELS]
        self.velocity[self.engaged] = 0.0
        self._trembling = -self._trembling
        self.velocity[self.engaged] += (
            self._trembling
        )  # what a brake holds still gives, by the last bits of its encoder
        self.position += self.velocity * dt_s


def servo_parameters() -> ServoParameters:
    def each(value: float) -> Vector:
        return np.full(COUNT, value)

    return ServoParameters(
        position_gain=each(20.0),
        velocity_gain=each(60.0),
        integral_gain=each(600.0),
        integral_limit=each(100.0),
        velocity_feed_forward=each(1.0),
        lower=each(-np.inf),
        upper=each(np.inf),
        velocity_limit=each(10.0),
        acceleration_limit=each(50.0),
        stop_deceleration=each(10.0),
        torque_limit=each(1000.0),
        outputs_velocity=np.arange(COUNT) < WHEELS,
    )


class Cell(NodeApplication):
    """The owner of the master: sends SYNC, and targets once all drives have answered (`control` makes them)."""

    def __init__(
        self,
        *,
        sync_ns: int = SYNC_NS,
        settings: DriveSettings | None = None,
        times: MasterTimes | None = None,
        drive_devices: dict[int, DeviceDef] | None = None,
        shuffle_seed: int | None = None,
    ) -> None:
        self.clock = LockstepClock()
        self.bus = LockstepBus(self.clock, intercept=self._intercept)
        self.plant = LinearPlant()
        self.load = LOAD
        self.bank = DriveBank(servo_parameters(), self.plant, TICK_NS)
        catalogue = devices()
        shipped = drive_devices or {}
        self.devices = {node: catalogue[node] for node in DRIVE_IDS}
        self.drives = {
            node: Drive(shipped.get(node, catalogue[node]), self.clock, self.bus, self.bank, axis)
            for axis, node in enumerate(DRIVE_IDS)
        }
        self.node = CanopenNode(catalogue[PLANNER_ID], self.clock, self.bus, self)
        self.sync_ns = sync_ns
        self.control: Callable[[Cell], tuple[Vector, Vector] | None] = hold
        self.on_event: Callable[[DriveEvent], None] | None = None
        self.fault: Callable[[str, Frame], Verdict | None] | None = None
        self.wire: list[Frame] = []
        self.syncs = 0
        self.bus.observe(self.wire.append)
        self._random = None if shuffle_seed is None else random.Random(shuffle_seed)
        self.master = DriveMaster(
            self.devices.values(),
            self.node.line.send,
            self.clock,
            settings or DriveSettings(sync_period_ns=sync_ns),
            times,
            self._on_event,
        )
        for can_id in sorted(self.master.can_ids):
            self.node.subscribe(can_id, self.master.on_frame)
        self._tick()

    def power_on(self, late: Iterable[int] = ()) -> None:
        """All drives but the late ones, then the planner's node with SYNC, then the master."""
        for node, drive in self.drives.items():
            if node not in late:
                drive.power_on()
        self.node.power_on()
        self.node.dictionary.entry(0x1006).store(self.sync_ns // 1000)
        self.node.start()
        self.master.start()

    def run(self, seconds: float) -> None:
        self.clock.run_until(self.clock.now_ns() + round(seconds * 1e9))

    def run_to(self, phase: MasterPhase, seconds: float = 10.0) -> float:
        """Runs until the master is in `phase`; gives the virtual time that it took, s."""
        begin_ns = self.clock.now_ns()
        while self.master.phase is not phase:
            if self.clock.now_ns() - begin_ns > seconds * 1e9:
                events = "\n".join(event.text for event in self.master.events)
                raise AssertionError(f"{self.master.phase.name} after {seconds} s, not {phase.name}\n{events}")
            self.run(0.001)
        return (self.clock.now_ns() - begin_ns) * 1e-9

    def enabled(self) -> Cell:
        """Powered on, set up, and enabled."""
        self.power_on()
        self.run_to(MasterPhase.READY)
        self.master.enable()
        self.run_to(MasterPhase.ENABLED)
        return self

    def failures(self) -> list[DriveEvent]:
        return [event for event in self.master.events if event.kind.is_failure]

    def of_kind(self, kind: EventKind) -> list[DriveEvent]:
        return [event for event in self.master.events if event.kind is kind]

    def on_sync(self, counter: int | None) -> None:
        self.syncs += 1
        self.master.on_sync()
        command = self.control(self)
        if command is not None:
            self.master.send_targets(*command)

    def _on_event(self, event: DriveEvent) -> None:
        if self.on_event is not None:
            self.on_event(event)

    def _intercept(self, sender: str, frame: Frame) -> Verdict | None:
        verdict = self.fault(sender, frame) if self.fault is not None else None
        if verdict is None and self._random is not None:
            return Verdict(delay_ns=self._random.randrange(2 * MS))
        return verdict

    def _tick(self) -> None:
        self.plant.step(TICK_NS * 1e-9)
        self.bank.tick(self.clock.now_ns())
        self.clock.call_at(self.clock.now_ns() + TICK_NS, self._tick)


def hold(cell: Cell) -> tuple[Vector, Vector] | None:
    """Targets as they last went out, with the load carried by the torque offsets."""
    return cell.master.targets(), cell.load


@pytest.fixture
def cell() -> Cell:
    return Cell()


@pytest.fixture
def make_cell() -> type[Cell]:
    return Cell
