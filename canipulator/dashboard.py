"""A run in the terminal while it goes on: drives, cycle, load, errors, events. Costs the loop one entry in a dictionary per frame."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from drivers.catalogue import DRIVE_IDS
from drivers.codec import MISSION, PLANNER_STATE
from drivers.drive_codec import DriveCodec
from drivers.frame import Frame
from drivers.frame_codec import CodecError
from drivers.objects import DeviceDef
from logs.events import Event, Level
from logs.states import drive_state, restriction_text
from logs.tape import SYNC_ID

REFRESH_S = 0.5
SILENT_NS = 350_000_000
EVENTS = 8
_STYLES = {Level.WARN: "yellow", Level.ERROR: "bold red"}
_HEALTHY = ("operation enabled", "executing", "idle")


@dataclass(frozen=True, slots=True)
class Status:
    """What frames do not tell: time of the run, bus load (parts of 1), cycles of this process; None or empty for what it does not do."""

    t_ns: int
    load_mean: float = 0.0
    load_peak: float = 0.0
    missed_cycles: int | None = None
    max_lateness_us: float | None = None
    cycle_ns: Sequence[int] = ()


class Dashboard:
    """Give `on_frame` to `Bus.observe` and `on_event` every event; `render` is a picture of the present."""

    def __init__(self, title: str, devices: Iterable[DeviceDef], status: Callable[[], Status]) -> None:
        self._title, self._status = title, status
        self._codecs = {device.node_id: DriveCodec(device) for device in devices if device.node_id in DRIVE_IDS}
        self._last: dict[int, Frame] = {}
        self._syncs = 0
        self._events: deque[Event] = deque(maxlen=EVENTS)

    def on_frame(self, frame: Frame) -> None:
        """The last frame of every identifier."""
        self._last[frame.can_id] = frame
        if frame.can_id == SYNC_ID:
            self._syncs += 1

    def on_event(self, event: Event) -> None:
        """From INFO on."""
        if event.level >= Level.INFO:
            self._events.append(event)

    def render(self) -> RenderableType:
        """The whole dashboard."""
        status = self._status()
        return Group(self._head(status), self._drives(status.t_ns), self._log())

    def _head(self, status: Status) -> RenderableType:
        table = Table.grid(padding=(0, 3))
        table.add_row(
            Text(self._title, "bold"), f"{status.t_ns * 1e-9:.1f} s", *self._planner(), Text(self._mission(), "dim")
        )
        table.add_row(
            "cycle",
            f"{self._syncs} SYNC",
            _computing(status.cycle_ns),
            _lateness(status),
            f"{_load(status)} of the bus",
        )
        return table

    def _planner(self) -> tuple[Text, str]:
        frames = [self._last.get(can_id) for can_id in PLANNER_STATE.can_ids]
        state = None
        assembler = PLANNER_STATE.assembler()
        with contextlib.suppress(CodecError):
            for frame in frames:
                state = None if frame is None else assembler.feed(frame.can_id, frame.data)
        if state is None:
            return Text("planner not heard", "yellow"), ""
        phase = state.phase.name.lower()
        style = "green" if phase in _HEALTHY else "red" if phase == "fault" else "yellow"
        return Text(phase, style), f"ϑ {state.path_scale:.2f}, {restriction_text(int(state.restrictions))}"

    def _mission(self) -> str:
        assembler = MISSION.assembler()
        with contextlib.suppress(CodecError):
            for can_id in MISSION.can_ids:
                frame = self._last.get(can_id)
                mission = None if frame is None else assembler.feed(frame.can_id, frame.data)
                if mission is not None:
                    return f"{mission.mode.name.lower().replace('_', ' ')}, step {mission.step}"
        return "no mission"

    def _drives(self, now_ns: int) -> RenderableType:
        table = Table(box=None, pad_edge=False, padding=(0, 2))
        for name in ("drive", "state", "position", "error", "effort"):
            table.add_column(name, justify="left" if name in ("drive", "state") else "right")
        for node, codec in sorted(self._codecs.items()):
            table.add_row(f"{node} {codec.name}", *self._drive(codec, now_ns))
        return table

    def _drive(self, codec: DriveCodec, now_ns: int) -> tuple[Text, str, str, str]:
        frame, target = self._last.get(codec.feedback_id), self._last.get(codec.set_point_id)
        if frame is None or now_ns - frame.t_ns > SILENT_NS:
            return Text("not heard" if frame is None else "silent", "red"), "", "", ""
        try:
            feedback = codec.decode_feedback(frame.data)
            wanted = None if target is None else codec.decode_set_point(target.data)[1]
        except CodecError as error:
            return Text(str(error), "red"), "", "", ""
        state = drive_state(feedback.statusword)
        style = "green" if state in _HEALTHY else "red" if state.startswith("fault") else "yellow"
        wheel = codec.name.startswith("wheel")
        unit, force = ("m", "N") if codec.name == "tower_lift" else ("rad", "N·m")
        off = "" if wanted is None or wheel else f"{1e3 * (wanted - feedback.position):+.2f} m{unit}"
        position = f"{feedback.position:+.3f} {unit}"
        return Text(state, style), position, off, f"{feedback.effort:+.1f} {force}"

    def _log(self) -> RenderableType:
        table = Table.grid(padding=(0, 1))
        for event in tuple(self._events):
            style = _STYLES.get(event.level, "")
            text = " ".join(event.text.split())
            table.add_row(f"{event.t_ns * 1e-9:9.3f}", Text(event.level.name, style), event.source, Text(text, style))
        return table

    @contextlib.contextmanager
    def live(self, console: Console | None = None) -> Iterator[None]:
        """Shows it twice a second, from a thread of its own, on stderr; the last picture stays."""
        ended = threading.Event()
        with Live(self.render(), console=console or Console(stderr=True), auto_refresh=False) as live:

            def show() -> None:
                while not ended.wait(REFRESH_S):
                    live.update(self.render(), refresh=True)

            thread = threading.Thread(target=show, name="dashboard", daemon=True)
            thread.start()
            try:
                yield
            finally:
                ended.set()
                thread.join(2.0)
                live.update(self.render(), refresh=True)


def wanted(asked: bool | None, *, quiet: bool, real_time: bool) -> bool:
    """Whether to show one: what was asked for, else in real time on a terminal."""
    if quiet:
        return False
    return asked if asked is not None else real_time and Console(stderr=True).is_terminal


def _computing(cycle_ns: Sequence[int]) -> str:
    if not cycle_ns:
        return "planner elsewhere"
    recent = sorted(cycle_ns[-200:])
    return f"computes {recent[len(recent) // 2] * 1e-3:.0f} µs, {recent[-1] * 1e-3:.0f} at most"


def _lateness(status: Status) -> str:
    if status.missed_cycles is None or status.max_lateness_us is None:
        return "in virtual time"
    return f"{status.missed_cycles} missed, {status.max_lateness_us:.0f} µs late at most"


def _load(status: Status) -> str:
    return f"{100 * status.load_mean:.1f} %, {100 * status.load_peak:.1f} % at most"
