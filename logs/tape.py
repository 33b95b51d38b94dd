"""What a run leaves behind, as raw as it comes: frames, truth samples, events. Collecting is all that the loop pays for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.frame import Frame
from logs.events import Event
from stack.messages import Truth

SYNC_ID = 0x080


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of a run: frames in wire order, truth samples and events in the order of their arrival.

    `timings`: time of each arm cycle, and how long it took to compute, both ns.
    """

    frames: list[Frame]
    truths: list[Truth]
    events: list[Event]
    timings: list[tuple[int, int]] = field(default_factory=list)


class Tape:
    """Collects a run in plain lists and hands on one `Block` per `block_ns`, always cut at a SYNC.

    Adding a frame costs a list append and one comparison (well below 1 µs) and never fails; nothing is decoded here.
    """

    __slots__ = ("_block_ns", "_cut_at_ns", "_events", "_frames", "_on_block", "_timings", "_truths", "frame_count")

    def __init__(self, on_block: Callable[[Block], None], block_ns: int = 1_000_000_000) -> None:
        if block_ns <= 0:
            raise ValueError(f"block_ns = {block_ns}: must be positive")
        self._on_block = on_block
        self._block_ns = block_ns
        self._cut_at_ns: int | None = None
        self._frames: list[Frame] = []
        self._truths: list[Truth] = []
        self._events: list[Event] = []
        self._timings: list[tuple[int, int]] = []
        self.frame_count = 0

    def on_frame(self, frame: Frame) -> None:
        """One frame of the wire; give this to `Bus.observe`."""
        self._frames.append(frame)
        if frame[0] == SYNC_ID:
            self._on_sync(frame[2])

    def on_truth(self, truth: Truth) -> None:
        """One sample of what the physics knows, taken at a SYNC."""
        self._truths.append(truth)

    def on_event(self, event: Event) -> None:
        """Something that happened and that no frame tells."""
        self._events.append(event)

    def on_timing(self, t_ns: int, computing_ns: int) -> None:
        """How long the arm cycle that began at `t_ns` took to compute."""
        self._timings.append((t_ns, computing_ns))

    def cut(self) -> None:
        """Hands on what there is; for the end of a run."""
        self.frame_count += len(self._frames)
        block = Block(self._frames, self._truths, self._events, self._timings)
        self._frames, self._truths, self._events, self._timings = [], [], [], []
        self._on_block(block)

    def _on_sync(self, t_ns: int) -> None:
        if self._cut_at_ns is None:
            self._cut_at_ns = t_ns + self._block_ns
        elif t_ns >= self._cut_at_ns:
            self._cut_at_ns = t_ns + self._block_ns
            self.cut()
