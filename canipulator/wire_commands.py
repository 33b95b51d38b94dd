"""The commands `sim`, `planner`, `strategic`: one role each on a real wire."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from config.errors import ConfigError

_PURPOSE = {
    "sim": "Simulated robot on the bus URL: ten drives, sensors, and the world that they are in.",
    "planner": "The local planner on the bus URL: SYNC, drive master, arm and platform cycles.",
    "strategic": "The strategic node on the bus URL: the mission of the scenario.",
}


def _role_command(role: str) -> click.Command:
    def play(
        bus_url: str,
        scenario: str,
        overrides: tuple[str, ...],
        out: Path | None,
        duration: float | None,
        pace: float,
        **more: Any,
    ) -> None:
        from canipulator.outcome import RunOptions
        from canipulator.realtime import run_on_wire
        from canipulator.wire import Wire, external_parts
        from config.load import load_scenario
        from config.scenario import Scenario

        if duration is not None and not 0.0 < duration < float("inf"):
            raise ConfigError(f"--duration {duration:g}: must be a positive number of seconds")
        loaded = load_scenario(scenario, overrides)
        if not isinstance(loaded, Scenario):
            raise ConfigError(f"{role}: {loaded.name} is a kinematic scenario, it has no bus")
        _, absent = external_parts(more.get("external", ()))
        options = RunOptions(out=out, duration_s=duration, record=not more.get("no_rerun", True))
        raise SystemExit(run_on_wire(loaded, options, Wire(bus_url, (role,), absent, pace)).exit_code)

    command: Callable[..., Any] = play
    if role == "sim":
        command = click.option("--no-rerun", is_flag=True, help="No Rerun recording.")(command)
        command = click.option(
            "--external", multiple=True, metavar="IDS", help="Drives that somebody else brings, e.g. 21,22."
        )(command)
    for option in (
        click.option(
            "--pace",
            type=float,
            default=1.0,
            show_default=True,
            help="Seconds of the run in a real one, the same for every role: below 1 where a machine is too slow.",
        ),
        click.option("--duration", type=float, help="End after so many seconds, whatever the mission does."),
        click.option("--out", type=click.Path(path_type=Path), help="Where the files go [default: runs/…-<n>]."),
        click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Any scenario key, repeatable."),
        click.option("--scenario", default="sliding-door", show_default=True, help="A name, or a TOML file."),
        click.option("--bus", "bus_url", required=True, metavar="URL", help="interface:channel, e.g. socketcan:vcan0."),
    ):
        command = option(command)
    return click.command(role, help=f"{_PURPOSE[role]} Ends with the mission, or with Ctrl-C (exit code 130).")(command)


@click.command("drives")
@click.option("--bus", "bus_url", metavar="URL", help="interface:channel, e.g. socketcan:vcan0.")
@click.option(
    "--serve", type=int, metavar="PORT", help="Instead of --bus: a bus of its own, served on 127.0.0.1 (0: any port)."
)
@click.option("--nodes", default="11,12,21-28", show_default=True, metavar="IDS", help="Which of the ten drives.")
@click.option(
    "--scenario", default="hold-still", show_default=True, help="Where the robot stands: a name, or a TOML file."
)
@click.option("--duration", type=float, help="End after so many seconds.")
@click.option(
    "--pace",
    type=float,
    default=1.0,
    show_default=True,
    help="Seconds of the bench in a real one, the same as of the master: below 1 where a machine is too slow.",
)
def drives_command(
    bus_url: str | None, serve: int | None, nodes: str, scenario: str, duration: float | None, pace: float
) -> None:
    """Only simulated drives, with their physics behind them: a test bench for your own CANopen master, until Ctrl-C.

    The joints of drives that are not there stay braked. EDS files: config/bus.
    """
    from canipulator.drives import drives_on_wire, drives_served, node_ids
    from canipulator.roles import TICK_NS
    from canipulator.serving import ServedRun
    from config.load import load_scenario
    from config.scenario import Scenario

    if (bus_url is None) == (serve is None):
        raise ConfigError("drives: needs --bus URL or --serve PORT, one of the two")
    if duration is not None and not 0.0 < duration < float("inf"):
        raise ConfigError(f"--duration {duration:g}: must be a positive number of seconds")
    loaded, ids = load_scenario(scenario), node_ids(nodes)
    if not isinstance(loaded, Scenario):
        raise ConfigError(f"drives: {loaded.name} is a kinematic scenario, it has no drives")
    if bus_url is not None:
        drives_on_wire(loaded, bus_url, ids, duration, pace)
    else:
        assert serve is not None
        drives_served(loaded, ServedRun(serve, allow_inject=True, pace=pace, step_ns=TICK_NS), ids, duration)


COMMANDS = (*(_role_command(role) for role in _PURPOSE), drives_command)
