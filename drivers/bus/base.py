"""What a node sees of a bus, whatever carries it: a port to send and hear, and the numbers of the traffic."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from drivers.frame import Frame

OnFrame = Callable[[Frame], None]


class Port(Protocol):
    """One node's access to the bus."""

    def send(self, can_id: int, data: bytes) -> bool:
        """Queues a frame. False: refused (queue full, bus off), the frame is lost and the sender must handle that."""


class Bus(Protocol):
    """What ports are attached to. A port never hears its own frames."""

    def attach(self, name: str, can_ids: Iterable[int] | None, on_frame: OnFrame) -> Port:
        """A new port that hears `can_ids` (None: all). `name` says who it is in statistics and faults."""

    def observe(self, on_frame: OnFrame) -> None:
        """`on_frame` gets every frame, in the order of the wire, before the nodes do. For logs: it must not send."""


@dataclass(frozen=True, slots=True)
class Latency:
    """Request to delivery of the frames of one id, in nanoseconds: waiting for the bus and being on it."""

    count: int
    mean_ns: float
    max_ns: int


@dataclass(frozen=True, slots=True)
class BusStatistics:
    """Traffic up to now. Loads are parts of 1: the time that frames (inter-frame space included) took of the bus.

    `load_peak` is the highest of any whole `window_ns`; `refused` and `dropped` are per port name: frames that a port
    would not take (queue full, bus off), and frames that were taken and never delivered.
    """

    frames: int = 0
    bits: int = 0
    busy_ns: int = 0
    load_mean: float = 0.0
    load_peak: float = 0.0
    window_ns: int = 100_000_000
    error_frames: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)
    latency: Mapping[int, Latency] = field(default_factory=dict)

    @property
    def frames_lost(self) -> int:
        return sum(self.refused.values()) + sum(self.dropped.values())
