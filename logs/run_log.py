"""The log of a run: takes frames, truth and events from the loop, and does all the rest in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

from drivers.frame import Frame
from drivers.objects import DeviceDef
from logs.decoder import SignalDecoder
from logs.detail import Detail
from logs.dexterity import Dexterity
from logs.events import Event, EventLog, Level
from logs.optimise import optimise
from logs.recorder import RerunRecorder, RunInfo
from logs.signals import DecodedBlock, SignalTable
from logs.tape import Block, Tape
from logs.tracking import PathTracking
from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory
from stack.messages import Truth

QUEUED_BLOCKS = 8
BLOCK_NS = 1_000_000_000


class RunLog:
    """Listens to a run; never answers, so the run is the same with and without it.

    Give `on_frame` to `Bus.observe`, and call `on_truth` and `on_event` from the loop. Blocks of about a second go to a daemon
    thread that decodes them, writes `events.log` and, unless `recording` is None, the Rerun file. Everything is decoded into the
    table in any case. With `wait` (lockstep) the loop stands still while the thread works on a block, and nothing is lost: side by
    side they would take the interpreter away from each other, which costs both more than it saves. Without (real time) a block
    that comes too late for the Rerun file is left out of it and counted in `dropped_blocks`.

    With `postpone` the thread begins when the run is over: in real time it would take the interpreter away from the loop for longer
    than a SYNC period. What has been heard stays in memory until then, about 1 MB per second of run.

    `detail`: what is recorded; `viewer`: address of one that shows the run while it goes on (see `logs.viewer`), beside the file.

    With `compact` a recording that is complete is rewritten a third smaller by `close` (0.1 s per MB at most).

    A fault of the disk or of Rerun ends the recording with one ERROR event; the run and the table go on.
    """

    def __init__(
        self,
        devices: Iterable[DeviceDef],
        robot: str,
        info: RunInfo,
        *,
        sync_period_ns: int,
        bitrate: int = 1_000_000,
        platform_ratio: int = 5,
        world_reference: bool = False,
        recording: Path | None,
        event_log: Path | None,
        detail: Detail = Detail.FULL,
        viewer: str | None = None,
        wait: bool = True,
        postpone: bool = False,
        compact: bool = True,
        block_ns: int = BLOCK_NS,
    ) -> None:
        """Opens the files and starts the thread. Raises OSError when `event_log` cannot be made, ValueError for an unknown robot."""
        devices = tuple(devices)
        arm = ArmModel.load(robot)  # not the planner's: an ArmModel belongs to one thread
        platform = arm.description.platform
        self._decoder = SignalDecoder(
            devices,
            sync_period_ns=sync_period_ns,
            bitrate=bitrate,
            wheel_radius=platform.wheel_radius if platform else 1.0,
            track=platform.track if platform else 1.0,
        )
        self._tracking = PathTracking(sync_period_ns, world_reference=world_reference)
        self._dexterity = Dexterity(arm)
        self._events = EventLog(event_log) if event_log is not None else None
        self._queue: SimpleQueue[tuple[Block, bool] | None] = SimpleQueue()
        self._block_done = threading.Semaphore(0) if wait and not postpone else None
        self._may_drop = not wait and not postpone
        self._decoder_fault: Exception | None = None
        self._last_ns = 0
        self.table = SignalTable()
        """Complete after `close`; before that it belongs to the thread."""
        self.written_blocks = self.dropped_blocks = 0
        self.recorder_fault: str | None = None
        """Why the recording ended early, or None."""
        self.recording_bytes: int | None = None
        """Size of the recording, known after `close`."""
        self._recorder: RerunRecorder | None = None
        self._live: RerunRecorder | None = None
        self._recording = recording
        if recording is not None:
            urdf = robot_directory(robot) / "robot.urdf"

            def begin(sink: Path | str) -> RerunRecorder:
                return RerunRecorder(
                    sink,
                    arm,
                    urdf,
                    info,
                    sync_period_ns=sync_period_ns,
                    platform_ratio=platform_ratio,
                    devices=devices,
                    detail=detail,
                )

            self._recorder = self._open(recording, begin)
            self._live = None if viewer is None else self._open(viewer, begin)
        self._tape = Tape(self._hand_over, block_ns)
        self.on_frame: Callable[[Frame], None] = self._tape.on_frame
        """For `Bus.observe`: an append and a comparison."""
        self._closed = False
        self._compact = recording if compact else None
        self._thread = threading.Thread(target=self._work, name="run-log", daemon=True)
        if not postpone:
            self._thread.start()

    def on_truth(self, truth: Truth) -> None:
        """One sample at a SYNC."""
        self._tape.on_truth(truth)

    def on_timing(self, t_ns: int, computing_ns: int) -> None:
        """How long the arm cycle that began at `t_ns` took to compute."""
        self._tape.on_timing(t_ns, computing_ns)

    def on_event(self, t_ns: int, level: Level, source: str, text: str) -> None:
        """Something that the frames do not tell, e.g. an injected fault, an overrun."""
        self._tape.on_event(Event(t_ns, level, source, text))

    def event_fileno(self) -> int:
        """The system's number of events.log; ValueError where there is none."""
        if self._events is None:
            raise ValueError("this log writes no events.log")
        return self._events.fileno()

    @property
    def frames(self) -> int:
        """Frames that were handed over so far; all of them after `close`."""
        return self._tape.frame_count

    def close(self) -> SignalTable:
        """Hands over the rest, waits for the thread, closes the files, and gives the whole table. May be called twice.

        Raises what the decoder raised, if it did: metrics from half a table would be wrong.
        """
        if not self._closed:
            self._closed = True
            self._tape.cut()
            self._queue.put(None)
            if self._thread.ident is None:
                self._thread.start()
            self._thread.join()
        if self._decoder_fault is not None:
            raise self._decoder_fault
        return self.table

    def _hand_over(self, block: Block) -> None:
        self._queue.put((block, self._closed))
        if self._block_done is not None:
            self._block_done.acquire()

    def _work(self) -> None:
        while (entry := self._queue.get()) is not None:
            block, last = entry
            try:
                if self._decoder_fault is None:
                    self._take(block, last)
            except Exception as fault:  # the loop must not notice, `close` raises it
                self._decoder_fault = fault
            finally:
                if self._block_done is not None:
                    self._block_done.release()
        self._finish()

    def _take(self, block: Block, last: bool) -> None:
        decoded = self._derive(self._decoder.decode(block, last=last))
        self.table.add(decoded)
        for event in decoded.events:
            self._last_ns = max(self._last_ns, event.t_ns)
            if self._events is not None:
                self._events.write(event)
        if "sync" in decoded.signals:
            self._last_ns = max(self._last_ns, int(decoded.signals["sync"].t_ns[-1]))
        if self._live is not None:
            try:
                self._live.write(decoded)
            except Exception as fault:
                self._leave_viewer(fault)
        if self._recorder is None:
            return
        if self._may_drop and self._queue.qsize() > QUEUED_BLOCKS:
            self.dropped_blocks += 1
            if self.dropped_blocks == 1:
                self._note(Level.WARN, "cannot keep up: blocks are left out of run.rrd")
            return
        try:
            self._recorder.write(decoded)
            self.written_blocks += 1
        except Exception as fault:  # whatever the writer does, the run goes on without it
            self._give_up(fault)

    def _derive(self, decoded: DecodedBlock) -> DecodedBlock:
        """Adds what follows from several signals."""
        signals = dict(decoded.signals)
        pose = signals.get("truth/pose_WE")
        signals |= self._tracking.add(signals.get("reference/pose"), signals.get("reference/segment"), pose)
        if pose is not None:
            signals |= self._dexterity.add(signals["truth/q"], pose)
        return replace(decoded, signals=signals)

    def _open(self, sink: Path | str, begin: Callable[[Path | str], RerunRecorder]) -> RerunRecorder | None:
        """A recorder, or None with an event that says why there is none."""
        try:
            return begin(sink)
        except Exception as fault:
            if isinstance(sink, Path):
                self._give_up(fault)
            else:
                self._leave_viewer(fault)
            return None

    def _give_up(self, fault: Exception) -> None:
        self.recorder_fault = f"{type(fault).__name__}: {fault}"
        if self._recorder is not None:
            self._recorder.abandon()
            self._recorder = None
        self._note(Level.ERROR, f"recording ended: {self.recorder_fault}")

    def _leave_viewer(self, fault: Exception) -> None:
        """The viewer has been closed: the file is written all the same."""
        if self._live is not None:
            self._live.abandon()
            self._live = None
        self._note(Level.WARN, f"the viewer is gone: {fault}")

    def _note(self, level: Level, text: str) -> None:
        """An event of the log itself."""
        event = Event(self._last_ns, level, "recorder", text)
        self.table.events.append(event)
        if self._events is not None:
            self._events.write(event)

    def _finish(self) -> None:
        if self._live is not None:
            try:
                self._live.close()
            except Exception as fault:
                self._leave_viewer(fault)
        if self._recorder is not None:
            try:
                self._recorder.close()
                if self._compact is not None:
                    optimise(self._compact)
                if self._recording is not None:
                    self.recording_bytes = self._recording.stat().st_size
            except Exception as fault:
                self._give_up(fault)
        if self._events is not None:
            self._events.close()
