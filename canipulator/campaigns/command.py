"""`canipulator campaign`."""

from __future__ import annotations

import math
from pathlib import Path

import click

from canipulator.campaigns.cluster import cluster_command
from config.errors import ConfigError


@click.command("campaign")
@click.argument("name")
@click.option(
    "--pairs", type=click.IntRange(min=1), help="Pairs per robot, or runs per variant [default: 1000; 10; 5]."
)
@click.option("--jobs", type=click.IntRange(min=1), help="Processes on this machine [default: one for each core].")
@click.option("--resume", is_flag=True, help="Go on with what is in the folder; also with more --pairs than before.")
@click.option(
    "--cluster", metavar="URL", help="A Dask scheduler (canipulator cluster), tcp://…, instead of processes here."
)
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the results [default: runs/campaign-NAME].")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=1, show_default=True)
@click.option("--duration", type=float, help="slip, methods, soak: cut every run short after so many seconds.")
def campaign_command(
    name: str,
    pairs: int | None,
    jobs: int | None,
    resume: bool,
    cluster: str | None,
    out: Path | None,
    seed: int,
    duration: float | None,
) -> None:
    """Compute a campaign on every core: beck, slip, methods, soak.

    beck: point-to-point trajectories of Beck et al., three objectives, three robots. slip: the sliding door under slip of 0 to 5 %, three
    coordinations. methods: four methods in four cases of preferences. soak: random faults.

    Exit code 0: done. 1: done, but units failed or what must hold does not. 2: bad input.
    """
    from canipulator.campaigns.go import CampaignOptions, run_campaign
    from canipulator.campaigns.registry import campaign_named

    if duration is not None and not (duration > 0.0 and math.isfinite(duration)):
        raise ConfigError(f"--duration {duration:g}: must be a positive number of seconds")
    if cluster is not None and jobs is not None:
        raise ConfigError("--jobs: not together with --cluster, which has workers of its own")
    campaign = campaign_named(name, duration)
    folder = out or Path("runs") / f"campaign-{name}"
    options = CampaignOptions(folder, pairs=pairs, jobs=jobs, cluster=cluster, seed=seed, resume=resume)
    raise SystemExit(run_campaign(campaign, options))


COMMANDS = (campaign_command, cluster_command)
