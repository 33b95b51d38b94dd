"""Drives on a lockstep bus, a linear plant that is integrated for real, and a plain master that sends raw frames."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

import numpy as np

from drivers.bus.lockstep import LockstepBus, LockstepPort
from drivers.catalogue import devices
from drivers.cia402.bank import DriveBank
from drivers.cia402.device import Drive
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.objects import DeviceDef, Value
from stack.messages import Vector
from stack.servo.state import BoolVector, ServoParameters

TICK_NS = 1_000_000
SYNC_NS = 10_000_000
MS = 1_000_000


class LinearPlant:
    """inertia · a = torque + load - friction · v per axis; a velocity axis follows its command with a lag of 5 ms."""

    def __init__(
        self, position: Vector, velocity_axes: BoolVector, inertia: float = 0.5, friction: float = 0.5
    ) -> None:
        self.position = np.array(position)
        self.velocity = np.zeros_like(self.position)
        self.load = np.zeros_like(self.position)
        self.command = np.zeros_like(self.position)
        self.blocked = np.zeros(len(position), dtype=np.bool_)
        self.peak_acceleration = np.zeros_like(self.position)
        self.broken_encoder: int | None = None
        self.trembling = 1e-9
        self.brakes: list[BoolVector] = []
        self._velocity_axes = velocity_axes
        self._inertia, self._friction = inertia, friction

    def step(self, dt_s: float) -> None:
        free = (self.command + self.load - self._friction * self.velocity) / self._inertia
        lagged = (self.command - self.velocity) / 0.005
        acceleration = np.where(self._velocity_axes, lagged, free)
        acceleration = np.where(self.blocked, -self.velocity / dt_s, acceleration)
        self.peak_acceleration = np.maximum(self.peak_acceleration, np.abs(acceleration))
        self.velocity += acceleration * dt_s
        self.position += self.velocity * dt_s

    def read(self, position: Vector, velocity: Vector) -> None:
        position[:] = self.position
        self.trembling = -self.trembling
        position[self.blocked] += (
            self.trembling
        )  # an axis that something holds still gives, by the last bit of its encoder
        velocity[:] = self.velocity
        if self.broken_encoder is not None:
            position[self.broken_encoder] = math.nan

    def write(self, command: Vector) -> None:
        assert np.all(np.isfinite(command))
        self.command[:] = command


class BrakedPlant(LinearPlant):
    def brake(self, engaged: BoolVector) -> None:
        self.brakes.append(engaged)


def servo_parameters(velocity_axes: BoolVector) -> ServoParameters:
    """Gains that suit the linear plant: position loop 20 1/s, velocity loop 100 1/s."""
    count = len(velocity_axes)

    def every(value: float) -> Vector:
        return np.full(count, value)

    return ServoParameters(
        every(20.0), every(50.0), every(100.0), every(30.0), every(1.0), every(-3.0), every(3.0), every(1.5),
        every(6.0), every(12.0), every(100.0), velocity_axes,
    )  # fmt: skip


def with_defaults(device: DeviceDef, values: dict[tuple[int, int], Value]) -> DeviceDef:
    """`device` with other power-on values."""
    objects = tuple(replace(entry, default=values.get(entry.key, entry.default)) for entry in device.objects)
    return replace(device, objects=objects)


class Rig:
    """Drives `node_ids` of the catalogue on one bus, ticking; nobody commands them yet."""

    def __init__(
        self,
        *node_ids: int,
        position: float = 0.5,
        defaults: dict[tuple[int, int], Value] | None = None,
        plant_type: type[LinearPlant] = LinearPlant,
    ) -> None:
        self.clock = LockstepClock()
        self.bus = LockstepBus(self.clock)
        wheels = np.array([node_id < 20 for node_id in node_ids])
        self.plant = plant_type(np.where(wheels, 0.0, position), wheels)
        self.bank = DriveBank(servo_parameters(wheels), self.plant, TICK_NS)
        self.frames: list[Frame] = []
        self.bus.observe(self.frames.append)
        self.drives = {
            node_id: Drive(with_defaults(devices()[node_id], defaults or {}), self.clock, self.bus, self.bank, axis)
            for axis, node_id in enumerate(node_ids)
        }
        self.velocities: list[float] = []
        self.clock.call_at(0, self._tick)
        for drive in self.drives.values():
            drive.power_on()

    @property
    def drive(self) -> Drive:
        return next(iter(self.drives.values()))

    def run(self, duration_ns: int) -> None:
        self.clock.run_until(self.clock.now_ns() + duration_ns)

    def sent(self, can_id: int) -> list[bytes]:
        return [frame.data for frame in self.frames if frame.can_id == can_id]

    def _tick(self) -> None:
        now_ns = self.clock.now_ns()
        self.plant.step(TICK_NS * 1e-9)
        self.bank.tick(now_ns)
        self.velocities.append(float(self.plant.velocity[0]))
        self.clock.call_at(now_ns + TICK_NS, self._tick)


class Master:
    """SYNC every 10 ms and one RPDO1 per drive right after it; `target` and `word` are what it sends, in wire units.

    With `follow`, the target is what the drive last said, as a master seeds it.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.port: LockstepPort = rig.bus.attach("master", None, self._on_frame)
        self.word = dict.fromkeys(rig.drives, 0)
        self.target = dict.fromkeys(rig.drives, 0)
        self.offset = dict.fromkeys(rig.drives, 0)
        self.follow = True
        self.velocity = 0
        """Wire units per second that are added to every target."""
        self.feedback: dict[int, tuple[int, int, int]] = {}
        self.sdo_replies: list[bytes] = []
        self.alive = True
        self.sends_rpdo = True
        self.sends_heartbeat = False
        self._cycle()
        self._beat()

    def nmt(self, command: int, node_id: int = 0) -> None:
        self.port.send(0x000, bytes((command, node_id)))
        self.rig.run(MS)

    def write(self, node_id: int, index: int, subindex: int, data: bytes) -> int:
        """Expedited download; 0 or the abort code."""
        command = 0x23 | (4 - len(data)) << 2
        reply = self.sdo(node_id, struct.pack("<BHB4s", command, index, subindex, data))
        return 0 if reply[0] == 0x60 else int(struct.unpack_from("<I", reply, 4)[0])

    def read(self, node_id: int, index: int, subindex: int = 0) -> bytes:
        """Expedited upload."""
        reply = self.sdo(node_id, struct.pack("<BHB4x", 0x40, index, subindex))
        assert reply[0] & 0xE3 == 0x43, reply.hex()
        return reply[4 : 8 - (reply[0] >> 2 & 3)]

    def sdo(self, node_id: int, request: bytes) -> bytes:
        self.sdo_replies.clear()
        self.port.send(0x600 + node_id, request)
        self.rig.run(2 * MS)
        (reply,) = self.sdo_replies
        return reply

    def command(self, word: int, cycles: int = 3) -> None:
        """The same controlword to all drives, and some time for it."""
        for node_id in self.word:
            self.word[node_id] = word
        self.rig.run(cycles * SYNC_NS)

    def enable(self) -> None:
        self.nmt(1)
        for word in (0x06, 0x07, 0x0F):
            self.command(word)
        self.follow = False

    def move(self, velocity: int) -> None:
        """Constant velocity in wire units per second from now on."""
        self.follow = False
        self.velocity = velocity

    def _cycle(self) -> None:
        if self.alive:
            self.port.send(0x080, b"")
            for node_id in self.rig.drives:
                wheel = node_id < 20
                self.target[node_id] = self.velocity if wheel else self.target[node_id] + self.velocity // 100
                if self.sends_rpdo:
                    frame = struct.pack("<Hih", self.word[node_id], self.target[node_id], self.offset[node_id])
                    self.port.send(0x200 + node_id, frame)
        self.rig.clock.call_at(self.rig.clock.now_ns() + SYNC_NS, self._cycle)

    def _beat(self) -> None:
        if self.alive and self.sends_heartbeat:
            self.port.send(0x702, b"\x05")
        self.rig.clock.call_at(self.rig.clock.now_ns() + 100 * MS, self._beat)

    def _on_frame(self, frame: Frame) -> None:
        base, node_id = frame.can_id & 0x780, frame.can_id & 0x7F
        if base == 0x180 and node_id in self.rig.drives:
            self.feedback[node_id] = struct.unpack("<Hih", frame.data)
            if self.follow:
                self.target[node_id] = 0 if node_id < 20 else self.feedback[node_id][1]
        elif base == 0x580:
            self.sdo_replies.append(frame.data)
