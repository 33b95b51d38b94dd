"""Only the simulated drives: a test bench for anybody's master, on a real wire or served to tools on 127.0.0.1."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

import click

from canipulator.collector import collector_off
from canipulator.realtime import SIM_CATCH_UP_NS
from canipulator.roles import SimulatedRobot, simulated_robot
from canipulator.serving import ServedRun
from canipulator.wire import run_time, undisturbed
from config.errors import ConfigError
from config.robot import load_robot
from config.scenario import Scenario
from drivers.bus.lockstep import LockstepBus
from drivers.bus.python_can import PythonCanBus
from drivers.catalogue import DRIVE_IDS
from drivers.cia402.states import State
from drivers.clock import LockstepClock
from drivers.realtime_clock import RealTimeClock

LOOK_NS = 50_000_000
"""Time between two looks at what has become of the drives."""


def node_ids(text: str) -> frozenset[int]:
    """`11,12,21-28` to node ids. Raises ConfigError for what is not a drive's."""
    found: set[int] = set()
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        if not low.isdecimal() or (dash and not high.isdecimal()):
            raise ConfigError(f"--nodes {text!r}: {part.strip()!r} must be a node id or a range, e.g. 11,12,21-28")
        span = range(int(low), int(high if dash else low) + 1)
        strangers = [node_id for node_id in span if node_id not in DRIVE_IDS]
        if strangers or not span:
            ids = ", ".join(map(str, DRIVE_IDS))
            raise ConfigError(f"--nodes {text!r}: {part.strip()!r} must be within the drives' ids ({ids})")
        found.update(span)
    return frozenset(found)


def drives_on_wire(
    scenario: Scenario, url: str, nodes: frozenset[int], duration_s: float | None, pace: float = 1.0
) -> None:
    """The drives `nodes` on the bus `url` in real time, until Ctrl-C (KeyboardInterrupt) or the time is over.

    `pace`: seconds of the bench in a real one. Raises ConfigError and BusError (an OSError) for a bus that cannot be opened or goes away.
    """
    bus = PythonCanBus(url, run_time(pace), bitrate=scenario.bus.bitrate, stamp_clock_ns=time.time_ns, pace=pace)
    with contextlib.closing(bus):
        clock = RealTimeClock(bus.now_ns, bus, catch_up_ns=SIM_CATCH_UP_NS)
        bench = simulated_robot(load_robot(scenario.robot), scenario, clock, bus, _others(nodes))
        with contextlib.closing(bench.world), collector_off(), undisturbed():
            bus.forget_arrived()
            _turn(bench, clock.run_until, clock.now_ns, duration_s)


def drives_served(scenario: Scenario, served: ServedRun, nodes: frozenset[int], duration_s: float | None) -> None:
    """The drives `nodes` on a modelled bus that tools on 127.0.0.1 send to and listen on; see `drives_on_wire`."""
    clock = LockstepClock()
    bus = LockstepBus(clock, scenario.bus.bitrate, queue_limit=scenario.bus.queue_frames)
    bench = simulated_robot(load_robot(scenario.robot), scenario, clock, bus, _others(nodes))
    with contextlib.closing(bench.world), collector_off(), served.paced(clock, bus) as run_until:
        _turn(bench, run_until, clock.now_ns, duration_s)


def _others(nodes: frozenset[int]) -> frozenset[int]:
    """The drives that are not there: their joints stay braked."""
    return frozenset(DRIVE_IDS) - nodes


def _turn(
    bench: SimulatedRobot, run_until: Callable[[int], None], now_ns: Callable[[], int], duration_s: float | None
) -> None:
    """Runs the bench and says what state each drive gets into."""
    end_ns = None if duration_s is None else now_ns() + round(1e9 * duration_s)
    said: dict[int, State] = {}
    bench.power_on(sensors=False)
    while end_ns is None or now_ns() < end_ns:
        run_until(now_ns() + LOOK_NS)
        for drive in bench.drives:
            node_id = drive.node.device.node_id
            if said.get(node_id) is not drive.state:
                said[node_id] = drive.state
                click.echo(
                    f"{node_id} {drive.node.device.name}: {drive.state.name.lower().replace('_', ' ')}", err=True
                )
