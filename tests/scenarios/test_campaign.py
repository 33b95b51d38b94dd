"""Campaigns with real processes, which are killed: nothing is lost, nothing counts twice, the numbers are those of an undisturbed run."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from canipulator.campaigns.beck import beck_campaign
from canipulator.campaigns.beck_pairs import draw_pair
from canipulator.campaigns.campaign import Batch, unit_generator
from canipulator.campaigns.scenarios import methods_campaign
from canipulator.campaigns.soak import soak_campaign
from canipulator.campaigns.store import Store
from canipulator.campaigns.workers import compute_batch
from canipulator.cli import cli
from stack.kinematics import ArmModel

ROOT = Path(__file__).resolve().parents[2]
PAIRS = 80
BATCH = 5
PATIENCE_S = 60.0


def start(*arguments: str | Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "tests.unit.campaigns.counting", *map(str, arguments)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def ends_well(process: subprocess.Popen[bytes]) -> None:
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, errors.decode()


def parts(out: Path) -> list[Path]:
    return list((out / "parts").glob("*.parquet")) if out.exists() else []


def wait_until(condition: Callable[[], object], process: subprocess.Popen[bytes]) -> None:
    """Polls, there is nothing to be notified by; a process that has ended by then has failed the test."""
    until = time.monotonic() + PATIENCE_S
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.01)


def workers_of(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    """The client's children that compute (not multiprocessing's resource tracker)."""
    found = []
    for child in psutil.Process(process.pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it has been killed
            if "spawn_main" in str(child.cmdline()):
                found.append(child)
    return found


def listens_only_here(*processes: psutil.Process, allow_none: bool = False) -> bool:
    """Some socket is open for others, and none beyond 127.0.0.1."""
    open_at = {c.laddr.ip for p in processes for c in p.net_connections("tcp") if c.status == psutil.CONN_LISTEN}
    return open_at == {"127.0.0.1"} or (allow_none and not open_at)


def is_whole(out: Path, pairs: int = PAIRS) -> set[int]:
    """Every unit is there once with the number that its seed gives; the processes that computed them."""
    rows = pq.read_table(out / "results.parquet").to_pylist()
    assert [(row["group"], row["index"]) for row in rows] == list(itertools.product(("left", "right"), range(pairs)))
    for row in rows:
        assert row["error"] is None
        assert row["end"] == unit_generator(1, row["group"], row["index"]).normal(size=1000).sum()
    return {row["pid"] for row in rows}


@pytest.mark.slow
def test_workers_and_the_client_are_killed_and_nothing_is_lost(tmp_path: Path) -> None:
    client = start(tmp_path, "--pairs", str(PAIRS), "--jobs", "2", "--busy", "0.07")
    wait_until(lambda: len(parts(tmp_path)) > 3, client)
    first = workers_of(client)
    assert listens_only_here(psutil.Process(client.pid), *first)
    first[0].kill()
    wait_until(lambda: {worker.pid for worker in workers_of(client)} - {worker.pid for worker in first}, client)
    so_far = len(parts(tmp_path))
    wait_until(lambda: len(parts(tmp_path)) > so_far, client)
    orphans = workers_of(client)
    client.send_signal(signal.SIGKILL)
    client.communicate()
    before = {path.name: path.stat().st_mtime_ns for path in parts(tmp_path)}
    assert 3 < len(before) < 2 * PAIRS // BATCH
    _, alive = psutil.wait_procs(orphans, timeout=20.0)
    assert not alive, "workers outlive their client"
    ends_well(start(tmp_path, "--pairs", str(PAIRS), "--jobs", "2", "--resume", "--busy", "0.0"))
    after = {path.name: path.stat().st_mtime_ns for path in parts(tmp_path)}
    assert {name: after[name] for name in before} == before, "what was there is not computed again"
    assert first[0].pid in is_whole(tmp_path)
    assert json.loads((tmp_path / "throughput.json").read_text())["units"] == 2 * PAIRS - BATCH * len(before)


@contextmanager
def canipulator(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process of a cluster, as a user would start it."""
    command = [sys.executable, "-m", "canipulator", *arguments]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        family = [process.pid, *(child.pid for child in psutil.Process(process.pid).children(recursive=True))]
        for pid in reversed(family):
            if psutil.pid_exists(pid):
                os.kill(pid, signal.SIGKILL)
        process.wait()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def family(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    """A process with all that it has started, also what Dask starts beside its workers."""
    parent = psutil.Process(process.pid)
    return [parent, *parent.children(recursive=True)]


def connected(process: subprocess.Popen[bytes], port: int) -> int:
    """How many connections to the scheduler's port there are in the family of `process`."""
    links = [c for p in family(process) for c in p.net_connections("tcp") if c.raddr and c.raddr.port == port]
    return len(links)


@pytest.mark.slow
def test_on_a_cluster_workers_die_and_join_and_only_this_machine_reaches_them(tmp_path: Path) -> None:
    port = free_port()
    url = f"tcp://127.0.0.1:{port}"
    with canipulator("cluster", "--port", str(port), "--workers", "1") as scheduler:
        wait_until(lambda: connected(scheduler, port), scheduler)
        client = start(tmp_path, "--pairs", str(PAIRS), "--cluster", url, "--busy", "0.02")
        wait_until(lambda: parts(tmp_path), client)
        assert listens_only_here(*family(scheduler))
        with canipulator("cluster", "--join", url, "--workers", "1") as more:
            wait_until(lambda: connected(more, port) > 1, more)  # nanny and worker
            assert listens_only_here(*family(more))
            assert listens_only_here(psutil.Process(client.pid), allow_none=True)
            workers_of(scheduler)[0].kill()
            ends_well(client)
    assert len(is_whole(tmp_path)) >= 2


@pytest.mark.slow
def test_whole_runs_become_a_table(tmp_path: Path) -> None:
    methods = methods_campaign(0.1)
    assert len(methods.groups(None)) == 16
    groups = {"fsp-case2": 1, "gradient-case4": 2}
    with Store(tmp_path, methods, 1, resume=False) as store:
        for batch in store.missing(groups, methods.batch):
            store.keep(batch, compute_batch(methods, 1, batch).rows)
        table = store.results(groups)
        methods.summarise(table, tmp_path)
    assert table["error"].null_count == 3
    assert table["method"].to_pylist() == ["fsp", "gradient", "gradient"]
    seeds = table["seed"].to_pylist()
    assert seeds[0] == seeds[1] != seeds[2], "run i has the same seed in every variant"
    assert "| gradient-case4 | 2 | 0 |" in (tmp_path / "summary.md").read_text()
    assert (tmp_path / "methods.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_soaked_case_is_the_same_on_every_worker_and_a_failure_leaves_its_scenario(tmp_path: Path) -> None:
    soak = soak_campaign(0.2)
    one, again = (compute_batch(soak, 1, Batch("cases", 3, 1)).rows for _ in range(2))
    assert one == again
    assert one[0]["error"] is None
    failed = one[0] | {"index": 4, "failure": "q = nan", "smallest": "title = 'kept'"}
    good = one[0] | {"failure": None, "smallest": None}
    summary = soak.summarise(pa.Table.from_pylist([good, failed]), tmp_path)
    assert summary.holds is False
    assert (tmp_path / "soak-4.toml").read_text() == "# q = nan\ntitle = 'kept'"
    assert f"| {one[0]['task']} | 2 | 1 |" in (tmp_path / "summary.md").read_text()


@pytest.mark.slow
def test_the_solvers_trajectories_become_rows_that_any_worker_repeats() -> None:
    beck = beck_campaign(None)
    batch = Batch("iiwa14", 17, 1)
    one, again = ([row | {"computing_s": None} for row in compute_batch(beck, 5, batch).rows] for _ in range(2))
    assert one == again
    assert [row["objective"] for row in one] == ["none", "manipulability", "potentials"]
    pair = draw_pair(ArmModel.load("iiwa14"), 5, 17)
    for row in one:
        assert row["error"] is None
        assert row["solved"] is True
        assert row["m_min"] <= row["end_points_m_min"] * (1 + 1e-6) == pair.manipulability * (1 + 1e-6)
    none, manipulability, potentials = (row["t_f"] for row in one)
    assert none <= potentials * (1 + 1e-3)
    assert none <= manipulability * (1 + 1e-3)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["becks"], "unknown campaign 'becks'.*beck"),
        (["slip", "--duration", "nan"], "--duration"),
        (["slip", "--cluster", "tcp://127.0.0.1:1", "--jobs", "2"], "--jobs"),
        (["slip", "--pairs", "0"], "--pairs"),
    ],
)
def test_bad_input_is_named(arguments: list[str], complaint: str, tmp_path: Path) -> None:
    answer = CliRunner().invoke(cli, ["campaign", *arguments, "--out", str(tmp_path)])
    assert answer.exit_code != 0
    assert re.search(complaint, answer.output + str(answer.exception))
