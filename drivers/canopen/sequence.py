"""Procedures of a master written as generators, many running side by side.

    def identify() -> Sequence[int]:
        vendor = yield Upload(0x1018, 1)
        yield Download(0x6060, 0, 8)
        yield Delay(10_000_000)
        yield Until(lambda: axis.state is State.SWITCHED_ON, 50_000_000, "Switched on")
        return vendor

A step that fails raises inside the generator (`SdoAborted`, `SdoTimeout`, `StepError`), which may catch it and go on;
uncaught it ends the sequence with a `SequenceFailure`. Other exceptions are programming errors and pass through.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from drivers.canopen.abort import SdoAbort
from drivers.canopen.data_types import decode, encode
from drivers.canopen.sdo_abort import StepError
from drivers.canopen.sdo_client import SdoClient
from drivers.clock import Clock, Timer
from drivers.objects import DataType, Value


@dataclass(frozen=True, slots=True)
class Upload:
    """Reads an object; gives its value. Without a known data type: the bytes as an unsigned integer."""

    index: int
    subindex: int
    data_type: DataType | None = None

    def __str__(self) -> str:
        return f"read {self.index:04X}h sub {self.subindex}"


@dataclass(frozen=True, slots=True)
class Download:
    """Writes an object. The data type comes from here or from the device's definition."""

    index: int
    subindex: int
    value: Value
    data_type: DataType | None = None

    def __str__(self) -> str:
        value = self.value if isinstance(self.value, str | float) else f"{self.value:#x}"
        return f"write {value} to {self.index:04X}h sub {self.subindex}"


@dataclass(frozen=True, slots=True)
class Delay:
    """Waits."""

    duration_ns: int

    def __str__(self) -> str:
        return f"wait {self.duration_ns / 1e6:g} ms"


@dataclass(frozen=True, slots=True)
class Until:
    """Waits until the predicate holds (looked at after every frame), at most `timeout_ns`.

    `what` is waited for, in words; `came` says what is there instead when the time is over.
    """

    predicate: Callable[[], bool]
    timeout_ns: int
    what: str
    came: Callable[[], str] = lambda: "nothing"

    def __str__(self) -> str:
        return f"wait for {self.what}"


Step = Upload | Download | Delay | Until
Result = TypeVar("Result")
Sequence = Generator[Step, Any, Result]


@dataclass(frozen=True, slots=True)
class SequenceFailure:
    """Which node, in which sequence and step, what was expected, what came; `code`: SDO abort or error code, or 0."""

    node_id: int
    sequence: str
    step: str
    expected: str
    came: str
    code: int = 0

    def __str__(self) -> str:
        return (
            f"node {self.node_id}: {self.sequence} failed at '{self.step}': expected {self.expected}, came {self.came}"
        )


class Run:
    """A sequence on its way."""

    def __init__(
        self,
        node_id: int,
        name: str,
        generator: Sequence[Any],
        client: SdoClient,
        data_types: Mapping[tuple[int, int], DataType],
        on_end: Callable[[Any], None],
        on_failure: Callable[[SequenceFailure], None],
    ) -> None:
        self.node_id = node_id
        self.name = name
        self.step = "start"
        self.done = False
        self.running = False
        self.generator = generator
        self.client = client
        self.data_types = data_types
        self.on_end = on_end
        self.on_failure = on_failure
        self.waiting: Until | None = None
        self.timer: Timer | None = None

    def cancel(self) -> None:
        """Ends the sequence without a result. Its SDO requests are the client's to cancel."""
        self.done = True
        self.waiting = None
        if self.timer is not None:
            self.timer.cancel()
        if not self.running:  # else it is cancelled by what it does itself, and closed at its next step
            self.generator.close()


class Sequencer:
    """Runs sequences side by side, driven by the answers of SDO servers, the clock, and `poll` after frames."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: list[Run] = []

    def start(
        self,
        client: SdoClient,
        name: str,
        sequence: Sequence[Result],
        on_end: Callable[[Result], None],
        on_failure: Callable[[SequenceFailure], None],
        data_types: Mapping[tuple[int, int], DataType] | None = None,
    ) -> Run:
        """Starts a sequence on the node of `client`; ends in one call of `on_end` or `on_failure`, unless cancelled."""
        run = Run(client.node_id, name, sequence, client, data_types or {}, on_end, on_failure)
        self._advance(run, None)
        return run

    def poll(self) -> None:
        """Looks at every `Until` that is waited for."""
        if not self._waiting:
            return
        for run in tuple(self._waiting):
            if run.done:
                self._waiting.remove(run)
            elif run.waiting is not None and run.waiting.predicate():
                self._forget(run)
                self._advance(run, None)

    def _advance(self, run: Run, outcome: Any) -> None:
        """Feeds the outcome of the last step to the generator and starts its next step(s)."""
        generator = run.generator
        while True:
            run.running = True
            try:
                step = generator.throw(outcome) if isinstance(outcome, StepError) else generator.send(outcome)
            except StopIteration as end:
                if not run.done:
                    run.done = True
                    run.on_end(end.value)
                return
            except StepError as error:
                if not run.done:
                    run.done = True
                    run.on_failure(_failure(run, error))
                return
            finally:
                run.running = False
            if run.done:  # cancelled meanwhile
                generator.close()
                return
            run.step = str(step)
            if isinstance(step, Until) and step.predicate():
                outcome = None
                continue
            self._begin(run, step)
            return

    def _begin(self, run: Run, step: Step) -> None:
        if isinstance(step, Upload):
            data_type = step.data_type or run.data_types.get((step.index, step.subindex))
            run.client.upload(
                step.index, step.subindex, lambda outcome: self._on_uploaded(run, step, data_type, outcome)
            )
        elif isinstance(step, Download):
            data = encode(self._type_of(run, step), step.value)
            run.client.download(
                step.index,
                step.subindex,
                data,
                lambda outcome: self._resume(run, outcome if isinstance(outcome, StepError) else None),
            )
        elif isinstance(step, Delay):
            due_ns = self._clock.now_ns() + step.duration_ns
            run.timer = self._clock.call_at(due_ns, lambda: self._resume(run, None))
        else:
            run.waiting = step
            self._waiting.append(run)
            due_ns = self._clock.now_ns() + step.timeout_ns
            run.timer = self._clock.call_at(due_ns, lambda: self._on_timeout(run, step))

    @staticmethod
    def _type_of(run: Run, step: Download) -> DataType:
        data_type = step.data_type or run.data_types.get((step.index, step.subindex))
        if data_type is None:
            raise KeyError(
                f"node {run.node_id}: cannot {step}: its data type is not known; give it in the Download, or have the"
                " object in the device's definition"
            )
        return data_type

    def _on_uploaded(self, run: Run, step: Upload, data_type: DataType | None, outcome: bytes | StepError) -> None:
        if isinstance(outcome, StepError):
            self._resume(run, outcome)
            return
        if data_type is None:
            self._resume(run, int.from_bytes(outcome, "little"))
            return
        try:
            value: Any = decode(data_type, outcome)
        except SdoAbort as error:
            value = StepError(f"{data_type.name} at {step.index:04X}h sub {step.subindex}", str(error))
        self._resume(run, value)

    def _on_timeout(self, run: Run, step: Until) -> None:
        self._forget(run)
        if step.predicate():
            self._resume(run, None)
        else:
            self._resume(run, StepError(f"{step.what} within {step.timeout_ns / 1e6:g} ms", step.came()))

    def _resume(self, run: Run, outcome: Any) -> None:
        if not run.done:
            self._advance(run, outcome)

    def _forget(self, run: Run) -> None:
        run.waiting = None
        if run.timer is not None:
            run.timer.cancel()
            run.timer = None
        if run in self._waiting:
            self._waiting.remove(run)


def _failure(run: Run, error: StepError) -> SequenceFailure:
    return SequenceFailure(run.node_id, run.name, run.step, error.expected, error.came, error.code)
