"""`canipulator cluster`: a scheduler and workers for `campaign --cluster`, which nobody outside this machine can reach unless told so."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

import click

from config.errors import ConfigError

LOOPBACK = "127.0.0.1"


@click.command("cluster")
@click.option(
    "--workers", type=click.IntRange(min=0), help="Processes with one thread each [default: one for each core]."
)
@click.option("--host", default=LOOPBACK, show_default=True, help="Address of this machine to listen at.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=8786, show_default=True, help="The scheduler's; 0: a free one."
)
@click.option("--join", metavar="URL", help="Only workers, for a scheduler that runs already.")
def cluster_command(workers: int | None, host: str, port: int, join: str | None) -> None:
    """Start a scheduler and workers for `campaign --cluster`, until Ctrl-C.

    Scheduler, workers, their nannies and Dask's status page listen on 127.0.0.1; --host opens all but the status page to others, without a
    password: whoever reaches the port can run programs here.
    """
    count = (os.cpu_count() or 1) if workers is None else workers
    if join is not None:
        _become_workers(join, count, host)
    signal.signal(signal.SIGTERM, _end)
    from canipulator.campaigns.workers import local_cluster

    try:
        with local_cluster(count, host=host, port=port) as cluster:
            click.echo(f"{cluster.scheduler_address}  {count} workers; ends with Ctrl-C")
            while True:
                signal.pause()
    except (OSError, RuntimeError) as error:
        raise ConfigError(f"--host {host} --port {port}: cannot listen there ({error.__cause__ or error})") from None


def _become_workers(url: str, count: int, host: str) -> None:
    if count == 0:
        raise ConfigError("--workers 0: with --join there would be nothing to start")
    command = [sys.executable, "-m", "dask", "worker", url, "--nworkers", str(count), "--nthreads", "1"]
    os.execv(sys.executable, [*command, "--host", host, "--dashboard-address", f"{LOOPBACK}:0", "--memory-limit", "0"])


def _end(_signal: int, _frame: FrameType | None) -> None:
    raise SystemExit(0)
