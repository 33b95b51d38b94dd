"""The command line. Every error is one line on stderr, `canipulator: …`, and exit code 2; Ctrl-C ends with 130."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from canipulator.campaigns.command import COMMANDS as CAMPAIGN_COMMANDS
from canipulator.log_commands import COMMANDS as LOG_COMMANDS
from canipulator.picture_commands import COMMANDS as PICTURE_COMMANDS
from canipulator.soak_command import COMMANDS as SOAK_COMMANDS
from canipulator.tool_commands import COMMANDS as TOOL_COMMANDS
from canipulator.tool_commands import serve_options, served_run
from canipulator.wire_commands import COMMANDS as WIRE_COMMANDS
from config.errors import ConfigError, nearest

INTERRUPTED = 130


class _Commands(click.Group):
    """Click's group with our error line for a misspelt command."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and self.get_command(ctx, args[0]) is None and not args[0].startswith("-"):
            raise click.UsageError(f"unknown command {args[0]!r}, {nearest(args[0], self.list_commands(ctx))}")
        return super().resolve_command(ctx, args)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.version_option(package_name="canipulator", message="canipulator %(version)s")
def cli() -> None:
    """A mobile manipulator whose layers talk only over CAN: run it, look at it, take it apart."""


for _command in (*CAMPAIGN_COMMANDS, *LOG_COMMANDS, *PICTURE_COMMANDS, *SOAK_COMMANDS, *TOOL_COMMANDS, *WIRE_COMMANDS):
    cli.add_command(_command)


@cli.command("list")
def list_scenarios() -> None:
    """The scenarios, one line each."""
    from config.load import load_scenario, scenario_names

    names = scenario_names()
    width = max(map(len, names))
    for name in names:
        click.echo(f"{name:<{width}}  {load_scenario(name).title}")


@cli.command()
@click.argument("scenario")
@click.option("--out", type=click.Path(path_type=Path), help="Where the run's files go [default: runs/<scenario>-<n>].")
@click.option("--seed", type=int, help="Seed of slip and noise [default: the scenario's, 1].")
@click.option(
    "--duration", type=float, help="Cut the scenario short after so many seconds; expectations are not judged."
)
@click.option("--method", help="Redundancy resolution: pns, fsp, gradient, qp.")
@click.option("--coordination", help="Arm and base: abc, unified, arm-only.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Any scenario key, dotted; repeatable.")
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="KIND@S[:K=V,...]",
    help="Injects a fault after so many seconds, e.g. drive-reboot@3.2:node=23 (docs/faults.md); repeatable.",
)
@click.option(
    "--bus",
    "bus_url",
    default="lockstep",
    show_default=True,
    metavar="URL",
    help="The wire: lockstep (virtual time), or interface:channel of python-can, e.g. socketcan:vcan0 (real time).",
)
@click.option(
    "--external",
    multiple=True,
    metavar="PART",
    help="With --bus URL: planner, strategic or drives (21,22) that somebody else brings; repeatable.",
)
@click.option("--no-rerun", is_flag=True, help="No Rerun recording (bus.log and metrics are written all the same).")
@click.option(
    "--record",
    type=click.Choice(["minimal", "full"]),
    help="How much the recording holds; minimal: robot, paths, error, platform, joints, states, events [default: full].",
)
@click.option(
    "--view", is_flag=True, help="Shows the run in a Rerun viewer while it goes on (one that is open, or its own)."
)
@click.option(
    "--dashboard/--no-dashboard",
    default=None,
    help="Drives, cycle, load, error and events in the terminal [default: in real time, where stderr is a terminal].",
)
@click.option("--json", "as_json", is_flag=True, help="The metrics on stdout, nothing else.")
@serve_options
def run(
    scenario: str,
    out: Path | None,
    seed: int | None,
    duration: float | None,
    method: str | None,
    coordination: str | None,
    overrides: tuple[str, ...],
    faults: tuple[str, ...],
    bus_url: str,
    external: tuple[str, ...],
    no_rerun: bool,
    record: str | None,
    view: bool,
    dashboard: bool | None,
    as_json: bool,
    serve: int | None,
    allow_inject: bool,
    pace: float | None,
) -> None:
    """Run SCENARIO (a name of `canipulator list`, or a TOML file).

    Exit code 0: its expectations hold. 1: one of them does not. 2: bad input.
    """
    from canipulator.outcome import RunOptions
    from config.load import load_scenario
    from config.scenario import Scenario
    from logs.detail import Detail
    from logs.viewer import live_viewer

    on_wire = bus_url != "lockstep"
    if external and not on_wire:
        raise ConfigError("--external: only on a real wire (--bus interface:channel)")
    if serve is not None and on_wire:
        raise ConfigError("--serve: only for lockstep runs; `canipulator attach` serves a real wire")
    sets = list(overrides)
    for key, value in (("seed", seed), ("planner.method", method), ("planner.coordination", coordination)):
        if value is not None:
            sets.append(f"{key}={json.dumps(value)}")
    if duration is not None and not 0.0 < duration < float("inf"):
        raise ConfigError(f"--duration {duration:g}: must be a positive number of seconds")
    loaded = load_scenario(scenario, sets, faults)
    if serve is not None and not isinstance(loaded, Scenario):
        raise ConfigError(f"--serve: {loaded.name} is a kinematic scenario, it has no bus")
    served = served_run(serve, allow_inject, None if on_wire else pace)
    if no_rerun and (record is not None or view):
        raise ConfigError(f"--no-rerun: not together with {'--view' if view else '--record'}")
    options = RunOptions(
        out=out,
        duration_s=duration,
        record=not no_rerun,
        detail=Detail(record or "full"),
        viewer=live_viewer() if view else None,
        quiet=as_json,
        served=served,
        dashboard=dashboard,
    )
    if on_wire:
        from canipulator.realtime import run_on_wire
        from canipulator.wire import Wire, external_parts

        if not isinstance(loaded, Scenario):
            raise ConfigError(f"--bus {bus_url}: {loaded.name} is a kinematic scenario, it has no bus")
        outcome = run_on_wire(loaded, options, Wire(bus_url, *external_parts(external), 1.0 if pace is None else pace))
    elif isinstance(loaded, Scenario):
        from canipulator.run import run_scenario

        outcome = run_scenario(loaded, options)
    else:
        from canipulator.kinematic_run import run_kinematic

        outcome = run_kinematic(loaded, options)
    if as_json:
        click.echo(json.dumps(outcome.metrics))
    raise SystemExit(outcome.exit_code)


@cli.command()
@click.argument("run_dir", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="In a browser instead of a window; served on 127.0.0.1 only.")
def view(run_dir: Path, web: bool) -> None:
    """Open the recording of RUN (its directory, or the .rrd file) in the Rerun viewer."""
    from logs.optimise import optimise
    from logs.viewer import has_display, is_torn, open_viewer

    path = run_dir / "run.rrd" if run_dir.is_dir() else run_dir
    if not path.is_file():
        raise ConfigError(f"{path}: no recording there (a run with --no-rerun has none)")
    if is_torn(path):  # a run that was killed: the viewer shows nothing of it until it is mended
        optimise(path)
    if not web and not has_display():
        raise ConfigError(f"{path}: no display here to open a window on; try --web")
    raise SystemExit(open_viewer(path, web=web))


@cli.group("bus")
def bus_group() -> None:
    """What other CAN tools need to understand the bus."""


@bus_group.command("export")
@click.argument("what", type=click.Choice(["dbc", "eds"]))
@click.argument("directory", metavar="[DIR]", required=False, type=click.Path(path_type=Path))
def export(what: str, directory: Path | None) -> None:
    """Write the DBC or the EDS files into DIR [default: config/bus]."""
    from canipulator.bus_files import write_bus_files

    for path in write_bus_files(what, directory):
        click.echo(path)


def main() -> None:
    """Entry point: runs the command line and turns what went wrong into one line and an exit code."""
    try:
        cli.main(standalone_mode=False)
    except click.exceptions.Exit as finished:
        sys.exit(finished.exit_code)
    except (click.exceptions.Abort, KeyboardInterrupt):
        click.echo("canipulator: interrupted", err=True)
        sys.exit(INTERRUPTED)
    except click.ClickException as error:
        _fail(error.format_message())
    except ConfigError as error:
        _fail(str(error))
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}")


def _fail(message: str) -> None:
    """One line on stderr, exit code 2."""
    click.echo("canipulator: " + " ".join(message.split()), err=True)
    sys.exit(2)
