"""Commands for pictures of what the robot can and does: manipulability maps, the report."""

from __future__ import annotations

from pathlib import Path

import click

from config.errors import ConfigError


@click.command("map")
@click.argument("kind", type=click.Choice(["wrist", "hand"]), default="wrist")
@click.option(
    "--samples", type=click.IntRange(1000, 1_000_000_000), help="Postures tried [default: 2 million, hand 10 million]."
)
@click.option("--out", type=click.Path(path_type=Path), help="The figure [default: map-KIND.png].")
def map_command(kind: str, samples: int | None, out: Path | None) -> None:
    """How dexterous the arm can be where: the manipulability map of its wrist centre (one parameter) or of its hand (full).

    The hand's map is what lift and elbow angle are chosen by when the strategic layer is given a pose. Maps are kept in .cache/maps.
    """
    import numpy as np

    from canipulator.maps import POSE_SAMPLES, RADIUS_SAMPLES, pose_map, radius_map
    from logs.map_figures import draw_pose_map, draw_radius_map
    from stack.kinematics import ArmModel

    arm = ArmModel.load("moma8")
    figure = out or Path(f"map-{kind}.png")
    if not figure.parent.is_dir():
        raise ConfigError(f"--out {figure}: {figure.parent} is no directory")
    if kind == "wrist":
        wrist = radius_map(arm, samples or RADIUS_SAMPLES)
        draw_radius_map(wrist, figure)
        best = int(np.nanargmax(wrist.manipulability))
        where = (
            f"at {wrist.radius[best]:.3f} m from the tower, φ = {wrist.phi[best]:.2f} rad, {wrist.height[best]:.3f} m"
        )
        where += " above the shoulder"
        click.echo(f"best {wrist.manipulability[best]:.4f} {where}")
    else:
        hand = pose_map(arm, samples or POSE_SAMPLES)
        draw_pose_map(hand, figure)
        reached = np.isfinite(hand.manipulability)
        click.echo(f"best {np.nanmax(hand.manipulability):.4f}; {reached.sum()} of {reached.size} cells are in reach")
    click.echo(figure)


@click.command("report")
@click.argument("sets", nargs=-1, metavar="[SET]...")
@click.option(
    "--out", type=click.Path(path_type=Path), default="report", show_default=True, help="Folder of page and runs."
)
@click.option("--jobs", type=click.IntRange(min=1), help="Runs at a time [default: one for each processor].")
@click.option("--duration", type=float, help="Cut every run short after so many seconds.")
def report_command(sets: tuple[str, ...], out: Path, jobs: int | None, duration: float | None) -> None:
    """Run sets of sliding doors and write one HTML page about them, next to what the thesis says.

    SETs: cases (four cases of preferences), coordination (abc, unified, arm only), cycles (arm cycles in a platform cycle),
    slip (0 to 5 %), methods (pns, fsp, gradient, qp). All of them by default, 27 runs.
    """
    from canipulator.report import write_report

    if duration is not None and not 0.0 < duration < float("inf"):
        raise ConfigError(f"--duration {duration:g}: must be a positive number of seconds")
    click.echo(write_report(sets, out, jobs=jobs or 0, duration_s=duration, quiet=False))


COMMANDS = (map_command, report_command)
