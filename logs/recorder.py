"""Writes a run to a Rerun file: blocks of columns, flushed one by one, so that a killed run keeps all but its last second."""

from __future__ import annotations

import atexit
import ctypes
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from drivers.objects import DeviceDef
from logs import palette
from logs.around import Around, AroundScene, around_series, around_values
from logs.blueprint import Stage, blueprint
from logs.columns import ColumnSender, WallClock
from logs.detail import Detail
from logs.events import Event
from logs.frame_batch import FrameBatch
from logs.frame_lines import FrameLineWriter
from logs.plots import MINIMAL_PLOTS, Plots, all_series
from logs.scene import Scene
from logs.signals import DecodedBlock, StateChange
from logs.states import SINGULARITIES
from stack.kinematics import ArmModel
from stack.messages import Vector

APPLICATION = "canipulator"
FLUSH_TIMEOUT_S = 2.0
FRAME_BLOCKS = 5
RESTRICTIONS = "planner/restrictions"
STATE_LANES = ("mission/mode", "mission/step", "planner/phase", RESTRICTIONS, SINGULARITIES, "drives/all")


@dataclass(frozen=True, slots=True)
class RunInfo:
    """What identifies a run: goes into the recording's properties. `settings` is the resolved configuration as text or flat values.

    `wall_clock`: of a run in real time.
    """

    name: str
    seed: int = 1
    method: str = ""
    coordination: str = ""
    revision: str = ""
    settings: Mapping[str, str | int | float | bool] = field(default_factory=dict)
    around: Around = Around()
    wall_clock: WallClock | None = None


class RerunRecorder:
    """One recording. All calls from one thread. `write` and `close` raise what the disk or the writer raises: see `RunLog`."""

    def __init__(
        self,
        sink: Path | str,
        arm: ArmModel,
        urdf: Path,
        info: RunInfo,
        *,
        sync_period_ns: int,
        platform_ratio: int = 5,
        devices: Iterable[DeviceDef] = (),
        detail: Detail = Detail.FULL,
    ) -> None:
        """Begins with geometry, styles, properties and layout. `sink`: a file, or the address of a viewer that is listening.

        `platform_ratio`: arm cycles per platform cycle. `devices`: whose frames are recorded in words (with Detail.FULL).
        """
        self._info, self._arm, self._detail = info, arm, detail
        self._plots, self._scene, self._around = Plots(arm), Scene(arm, urdf), AroundScene(info.around)
        self._frame_lines = FrameLineWriter(devices) if detail is Detail.FULL else None
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._ends: dict[str, tuple[Vector, Vector]] = {}
        self._batches: list[FrameBatch] = []
        self._styled: set[str] = set()
        self._restrictions: set[str] = {"none"}
        self._stream = rr.RecordingStream(APPLICATION, send_properties=True)
        target = rr.FileSink(sink) if isinstance(sink, Path) else rr.GrpcSink(sink)
        self._stream.set_sinks(target, default_blueprint=blueprint(arm, around=info.around, detail=detail))
        self._columns = ColumnSender(self._stream, sync_period_ns, platform_ratio, info.wall_clock)
        self._log_statics()

    def write(self, block: DecodedBlock) -> None:
        """Sends one block and waits until it is in the file. Raises when it did not get there within 2 s."""
        columns, full = self._columns, self._detail is Detail.FULL
        columns.begin_block(block.signals.get("sync"))
        for path, signal in self._plots.values(block.signals, None if full else MINIMAL_PLOTS):
            columns.scalars(path, signal.t_ns, signal.values)
        for path, signal in around_values(block.signals, self._info.around):
            columns.scalars(path, signal.t_ns, signal.values)
        self._scene.send(block.signals, columns.columns, ellipsoids=full)
        self._around.send(block.signals, columns.columns)
        self._note_extent(block)
        self._send_states(block.states)
        self._send_events(block.events)
        if self._frame_lines is not None and block.frames is not None:
            self._batches.append(block.frames)
            if len(self._batches) >= FRAME_BLOCKS:
                self._send_frames()
        self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)

    def close(self) -> None:
        """Sets the eye to where the robot went, flushes, and closes the file."""
        if self._ends:
            stage = Stage.of(self._ends["truth/pose_WE"], self._ends["truth/pose_WB"], self._low, self._high)
            self._stream.send_blueprint(blueprint(self._arm, stage, self._info.around, self._detail))
        self._send_frames()
        self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        self._stream.disconnect()

    def _send_frames(self) -> None:
        """The frames of several blocks at once: they are the greater part, and bus.log has those that are lost with a killed run."""
        if self._frame_lines is not None and self._batches:
            for line in self._frame_lines.lines(FrameBatch.joined(self._batches)):
                self._columns.texts(line.path, line.t_ns, line.texts)
        self._batches.clear()

    def abandon(self) -> None:
        """Gives the stream up without closing it: after a disk fault its destructor, and the SDK's own clean-up at the end of the
        process, may wait for ever for a writer that is gone. Recordings that are closed do not need either."""
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._stream))
        atexit.unregister(rr.rerun_shutdown)

    def _log_statics(self) -> None:
        stream = self._stream
        self._scene.log_statics(stream)
        self._around.log_statics(stream)
        for path, names, colors in around_series(self._info.around):
            stream.log(path, rr.SeriesLines(names=names, colors=colors, widths=[1.5] * len(names)), static=True)
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

    def _note_extent(self, block: DecodedBlock) -> None:
        for name in ("truth/pose_WB", "truth/pose_WE"):
            pose = block.signals.get(name)
            if pose is not None:
                position = pose.values[:, :3, 3]
                self._low = np.minimum(self._low, position.min(axis=0))
                self._high = np.maximum(self._high, position.max(axis=0))
                first = self._ends[name][0] if name in self._ends else position[0]
                self._ends[name] = (first, position[-1])

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
            self._columns.columns(
                f"states/{lane}", t_ns, rr.StateChange.columns(state=[change.state for change in changes])
            )

    def _send_events(self, events: tuple[Event, ...]) -> None:
        if events:
            t_ns = np.array([event.t_ns for event in events], np.int64)
            texts = [f"{event.source}: {event.text}" for event in events]
            self._columns.texts("events", t_ns, texts, [event.level.name for event in events])


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
