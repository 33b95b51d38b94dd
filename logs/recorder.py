"""Writes a run to a Rerun file: blocks of columns, flushed one by one, so that a killed run keeps all but its last second."""

from __future__ import annotations

import atexit
import ctypes
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from logs import palette
from logs.blueprint import TIMELINE, Stage, blueprint
from logs.events import Event
from logs.plots import Plots, all_series
from logs.scene import Scene
from logs.signals import DecodedBlock, Ints, StateChange
from logs.states import SINGULARITIES
from stack.kinematics import ArmModel
from stack.messages import Vector

APPLICATION = "canipulator"
FLUSH_TIMEOUT_S = 2.0
RESTRICTIONS = "planner/restrictions"
STATE_LANES = ("mission/mode", "mission/step", "planner/phase", RESTRICTIONS, SINGULARITIES, "drives/all")


@dataclass(frozen=True, slots=True)
class RunInfo:
    """What identifies a run: goes into the recording's properties. `settings` is the resolved configuration as text or flat values."""

    name: str
    seed: int = 1
    method: str = ""
    coordination: str = ""
    revision: str = ""
    settings: Mapping[str, str | int | float | bool] = field(default_factory=dict)


class RerunRecorder:
    """One recording. All calls from one thread. `write` and `close` raise what the disk or the writer raises: see `RunLog`."""

    def __init__(
        self, path: Path, arm: ArmModel, urdf: Path, info: RunInfo, *, sync_period_ns: int, platform_ratio: int = 5
    ) -> None:
        """Creates the file with geometry, styles, properties and layout. `platform_ratio`: arm cycles per platform cycle."""
        self._info = info
        self._arm = arm
        self._period_ns = sync_period_ns
        self._platform_ratio = platform_ratio
        self._sync_ns = np.empty(0, np.int64)
        self._sync_cycle = np.empty(0, np.int64)
        self._plots, self._scene = Plots(arm), Scene(arm, urdf)
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._ends: dict[str, tuple[Vector, Vector]] = {}
        self._styled: set[str] = set()
        self._restrictions: set[str] = {"none"}
        self._stream = rr.RecordingStream(APPLICATION, send_properties=True)
        self._stream.set_sinks(rr.FileSink(path), default_blueprint=blueprint(arm))
        self._log_statics()

    def write(self, block: DecodedBlock) -> None:
        """Sends one block and waits until it is in the file. Raises when it did not get there within 2 s."""
        self._note_cycles(block)
        for path, signal in self._plots.values(block.signals):
            self._send(path, signal.t_ns, rr.Scalars.columns(scalars=signal.values))
        self._scene.send(block.signals, self._send)
        self._note_extent(block)
        self._send_states(block.states)
        self._send_events(block.events)
        self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)

    def close(self) -> None:
        """Sets the eye to where the robot went, flushes, and closes the file."""
        if self._ends:
            stage = Stage.of(self._ends["truth/pose_WE"], self._ends["truth/pose_WB"], self._low, self._high)
            self._stream.send_blueprint(blueprint(self._arm, stage))
        self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        self._stream.disconnect()

    def abandon(self) -> None:
        """Gives the stream up without closing it: after a disk fault its destructor, and the SDK's own clean-up at the end of the
        process, may wait for ever for a writer that is gone. Recordings that are closed do not need either."""
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._stream))
        atexit.unregister(rr.rerun_shutdown)

    def _log_statics(self) -> None:
        stream = self._stream
        self._scene.log_statics(stream)
        for series in all_series(self._arm.joint_names):
            style = rr.SeriesLines(names=series.names, colors=series.colors, widths=series.all_widths)
            stream.log(series.path, style, static=True)
        for lane in STATE_LANES:
            self._style_lane(lane)
        stream.send_recording_name(f"{self._info.name}, seed {self._info.seed}")
        stream.send_property("run", rr.AnyValues(**run_properties(self._info)))
        stream.flush(timeout_sec=FLUSH_TIMEOUT_S)  # columns overtake what is still in the batcher

    def _style_lane(self, lane: str) -> None:
        values = sorted(self._restrictions) if lane == RESTRICTIONS else list(palette.STATES)
        colors = [(*palette.state_color(value), 255) for value in values]
        self._stream.log(
            f"states/{lane}", rr.StateConfiguration(values=values, labels=values, colors=colors), static=True
        )
        self._styled.add(lane)

    def _note_cycles(self, block: DecodedBlock) -> None:
        """Keeps the SYNC times of this block and the last one: rows may be a little older than their block."""
        sync = block.signals.get("sync")
        if sync is not None:
            keep = len(sync) + 64
            self._sync_ns = np.append(self._sync_ns, sync.t_ns)[-keep:]
            self._sync_cycle = np.append(self._sync_cycle, sync.values.astype(np.int64))[-keep:]

    def _note_extent(self, block: DecodedBlock) -> None:
        for name in ("truth/pose_WB", "truth/pose_WE"):
            pose = block.signals.get(name)
            if pose is not None:
                position = pose.values[:, :3, 3]
                self._low = np.minimum(self._low, position.min(axis=0))
                self._high = np.maximum(self._high, position.max(axis=0))
                first = self._ends[name][0] if name in self._ends else position[0]
                self._ends[name] = (first, position[-1])

    def _cycles(self, t_ns: Ints) -> Ints:
        """Arm cycle of each time: that of the last SYNC at or before it; counted on by the period after the last one."""
        if not len(self._sync_ns):
            return np.zeros(len(t_ns), np.int64)
        row = np.clip(np.searchsorted(self._sync_ns, t_ns, "right") - 1, 0, len(self._sync_ns) - 1)
        beyond = (t_ns - self._sync_ns[-1]) // self._period_ns
        return np.where(
            row == len(self._sync_ns) - 1, self._sync_cycle[-1] + np.maximum(beyond, 0), self._sync_cycle[row]
        )

    def _send(self, path: str, t_ns: Ints, columns: Any) -> None:
        cycles = self._cycles(t_ns)
        index = [
            rr.TimeColumn(TIMELINE, duration=t_ns.astype("timedelta64[ns]")),
            rr.TimeColumn("arm_cycle", sequence=cycles),
            rr.TimeColumn("platform_cycle", sequence=cycles // self._platform_ratio),
        ]
        self._stream.send_columns(path, indexes=index, columns=columns)

    def _send_states(self, states: tuple[StateChange, ...]) -> None:
        lanes: dict[str, list[StateChange]] = {}
        for change in states:
            lanes.setdefault(change.lane, []).append(change)
        new = [lane for lane in lanes if lane not in self._styled]
        texts = {change.state for change in lanes.get(RESTRICTIONS, [])} - self._restrictions
        self._restrictions |= texts
        for lane in new:
            self._style_lane(lane)
        if texts:
            self._style_lane(RESTRICTIONS)
        if new or texts:
            self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        for lane, changes in lanes.items():
            t_ns = np.array([change.t_ns for change in changes], np.int64)
            self._send(f"states/{lane}", t_ns, rr.StateChange.columns(state=[change.state for change in changes]))

    def _send_events(self, events: tuple[Event, ...]) -> None:
        if events:
            t_ns = np.array([event.t_ns for event in events], np.int64)
            texts = [f"{event.source}: {event.text}" for event in events]
            self._send("events", t_ns, rr.TextLog.columns(text=texts, level=[event.level.name for event in events]))


def run_properties(info: RunInfo) -> dict[str, Any]:
    """Properties of a recording: what identifies the run, and its settings."""
    known = {
        "name": info.name,
        "seed": info.seed,
        "method": info.method,
        "coordination": info.coordination,
        "git_revision": info.revision,
    }
    return {**known, **{key.replace(".", "_"): value for key, value in info.settings.items()}}
