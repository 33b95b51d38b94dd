"""The command that lets random faults loose on random tasks; what it needs is loaded when it is used."""

from __future__ import annotations

import random
from pathlib import Path

import click


@click.command("soak")
@click.option("--minutes", type=click.FloatRange(0.0, min_open=True), default=10.0, show_default=True, help="How long.")
@click.option("--seed", type=click.IntRange(0), help="Repeats the cases of another soak [default: a new one, printed].")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("runs"), show_default=True, help="For failing cases."
)
def soak_command(minutes: float, seed: int | None, out: Path) -> None:
    """Random scenarios with random faults for some minutes. Exit code 1 if one broke what must hold; its TOML repeats it."""
    from canipulator.soak import soak

    chosen = random.SystemRandom().randrange(1_000_000) if seed is None else seed
    click.echo(f"seed {chosen}")
    raise SystemExit(1 if soak(minutes, chosen, out) else 0)


COMMANDS = (soak_command,)
