"""Metrics of runs side by side: what is marked, and by how much it differs."""

import io

from rich.console import Console

from logs.comparison_table import comparison_table, markdown, metric_rows

A = {
    "method": "pns",
    "seed": 1,
    "wall_time_s": 3.0,
    "tcp_error_rms_m": 0.002,
    "limit_violations": {"position": 0},
    "faults": [],
    "expectations": [{"name": "tcp_error_rms_m", "ok": True}],
}
B = {
    **A,
    "method": "qp",
    "seed": 2,
    "wall_time_s": 4.0,
    "tcp_error_rms_m": 0.003,
    "limit_violations": {"position": 4},
    "faults": ["planner: a fault of which there is a lot to be said"],
    "expectations": [{"name": "tcp_error_rms_m", "ok": False}],
    "door_angle_rad": 0.5,
}


def test_what_differs_is_marked_and_says_by_how_much() -> None:
    rows = {row.name: row for row in metric_rows([A, B])}
    assert rows["tcp_error_rms_m"].differs
    assert rows["tcp_error_rms_m"].change(1) == "+50.0 %"
    assert rows["limit_violations.position"].change(1) == "+4", "of nothing there are no per cent"
    assert rows["method"].differs
    assert rows["method"].change(1) == ""
    assert rows["seed"].change(1) == "", "a seed is a name"
    assert rows["expectations_missed"].values == ("none", "tcp_error_rms_m")
    assert rows["door_angle_rad"].values == (None, 0.5)


def test_times_of_the_machine_are_no_difference() -> None:
    rows = {row.name: row for row in metric_rows([A, {**A, "wall_time_s": 9.0}])}
    assert rows["wall_time_s"].values == (3.0, 9.0)
    assert not any(row.differs for row in rows.values())


def test_both_tables_have_every_metric_of_every_run() -> None:
    rows = metric_rows([A, B])
    console = Console(file=io.StringIO(), width=120)
    console.print(comparison_table("AB", ["one", "two"], rows))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    page = markdown("AB", ["one", "two"], rows)
    for row in rows:
        assert row.name in text
        assert row.name in page
    assert "* tcp_error_rms_m" in text
    assert "…" in text, "long texts are cut for the terminal"
    assert B["faults"][0] in page, "and not for the recording"  # type: ignore[index]
    assert len({line.count("|") for line in page.splitlines()}) == 1
