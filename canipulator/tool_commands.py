"""The commands for other people's CAN tools: attach, export, and the options of `run` that serve a run to them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from config.errors import ConfigError

if TYPE_CHECKING:
    from canipulator.serving import ServedRun

DEFAULT_PORT = 29536
"""The protocol's own; drivers.socketcand has it, too, but is not loaded for a mere --help."""
_INJECT_HELP = "Tools may send frames; without it they only listen."


def serve_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Adds the options that `served_run` takes."""
    for option in (
        click.option(
            "--pace", type=float, help="With --serve or --bus URL: simulated seconds per second [default: 1]."
        ),
        click.option("--allow-inject", is_flag=True, help=f"With --serve: {_INJECT_HELP[0].lower()}{_INJECT_HELP[1:]}"),
        click.option(
            "--serve",
            type=int,
            is_flag=False,
            flag_value=str(DEFAULT_PORT),
            metavar="[PORT]",
            help=f"Serve the bus to CAN tools (socketcand, on 127.0.0.1 only) [port: {DEFAULT_PORT}], in real time.",
        ),
    ):
        command = option(command)
    return command


def served_run(serve: int | None, allow_inject: bool, pace: float | None) -> ServedRun | None:
    """How the run is served, None: not at all. Raises ConfigError for options that do not go together or cannot be had."""
    if serve is None:
        if allow_inject or pace is not None:
            raise ConfigError(f"{'--allow-inject' if allow_inject else '--pace'}: only together with --serve")
        return None
    from canipulator.serving import ServedRun

    return ServedRun(serve, allow_inject=allow_inject, pace=1.0 if pace is None else pace)


@click.command()
@click.option("--bus", "bus_url", required=True, metavar="URL", help="interface:channel, e.g. socketcan:vcan0.")
@click.option("--port", type=int, default=DEFAULT_PORT, show_default=True, help="On 127.0.0.1; 0: any free one.")
@click.option("--allow-inject", is_flag=True, help=_INJECT_HELP)
def attach(bus_url: str, port: int, allow_inject: bool) -> None:
    """Serve a running bus to CAN tools (socketcand protocol, on 127.0.0.1 only) until Ctrl-C."""
    from canipulator.attach import attach as serve_bus

    serve_bus(bus_url, port, allow_inject=allow_inject)


@click.command()
@click.argument("run", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--to", "name", required=True, metavar="FORMAT", help="blf, asc, trc, csv (decoded), mf4 (with asammdf).")
@click.option("--out", type=click.Path(path_type=Path), help="The file [default: RUN/bus.FORMAT].")
def export(run: Path, name: str, out: Path | None) -> None:
    """Convert the bus log of RUN to FORMAT; csv has one row for each signal, decoded by the DBC."""
    from canipulator.log_export import export_log

    path, frames = export_log(run, name, out)
    click.echo(f"{path}  {frames} frames")


COMMANDS = (attach, export)
