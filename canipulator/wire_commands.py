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


COMMANDS = tuple(_role_command(role) for role in _PURPOSE)
