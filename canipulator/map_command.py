"""The command that draws manipulability maps."""

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
        where = f"at {wrist.radius[best]:.3f} m from the tower, φ = {wrist.phi[best]:.2f} rad, {wrist.height[best]:.3f} m"
        where += " above the shoulder"
        click.echo(f"best {wrist.manipulability[best]:.4f} {where}")
    else:
        hand = pose_map(arm, samples or POSE_SAMPLES)
        draw_pose_map(hand, figure)
        reached = np.isfinite(hand.manipulability)
        click.echo(f"best {np.nanmax(hand.manipulability):.4f}; {reached.sum()} of {reached.size} cells are in reach")
    click.echo(figure)


COMMANDS = (map_command,)
