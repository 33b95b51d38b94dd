"""The metrics of a run as a table for the terminal. Rendering only."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table

from logs.metrics import Metrics

_NONE = "–"


def summary(metrics: Metrics) -> RenderableType:
    """What `console.print` shows at the end of a run: the numbers in units for people, then the expectations."""
    numbers = Table.grid(padding=(0, 2))
    numbers.add_column(style="dim")
    numbers.add_column(justify="right")
    numbers.add_column()
    for name, value, unit in _rows(metrics):
        numbers.add_row(name, value, unit)
    title = f"[bold]{metrics.scenario}[/bold]  seed {metrics.seed}  {metrics.method}  {metrics.coordination}"
    parts: list[RenderableType] = [title, numbers]
    if metrics.expectations:
        parts.append(_expectations(metrics))
    parts += [f"[red]fault:[/red] {fault}" for fault in metrics.faults]
    if metrics.recorder_fault:
        parts.append(f"[yellow]recording incomplete:[/yellow] {metrics.recorder_fault}")
    return Group(*parts)


def _rows(m: Metrics) -> list[tuple[str, str, str]]:
    error = [_number(value, 1e3, 2) for value in (m.tcp_error_rms_m, m.tcp_error_p99_m, m.tcp_error_max_m)]
    cycle = [_number(value, 1, 0) for value in (m.arm_cycle_us.p50, m.arm_cycle_us.p99, m.arm_cycle_us.max)]
    load = [_number(value, 100, 1) for value in (m.bus_load_mean, m.bus_load_peak)]
    pace = f"s in {_number(m.wall_time_s, 1, 1)} s, {_number(m.real_time_factor, 1, 2)} x real time"
    return [
        ("run time", _number(m.sim_time_s, 1, 1), pace),
        ("TCP error", error[0], f"mm rms, {error[1]} p99, {error[2]} max"),
        ("orientation error", _number(m.tcp_orientation_error_max_rad, 1e3, 2), "mrad max"),
        ("manipulability, arm", _number(m.min_manipulability_arm, 1, 4), "least"),
        ("manipulability, robot", _number(m.min_manipulability_robot, 1, 4), "least"),
        ("limit violations", str(m.limit_violations.position), f"position, {m.limit_violations.velocity} velocity"),
        ("arm cycle", cycle[0], f"µs median, {cycle[1]} p99, {cycle[2]} max, {m.arm_cycles} cycles"),
        ("bus load", load[0], f"% mean, {load[1]} peak"),
        ("frames", str(m.frames), f"{m.frames_lost} lost"),
        ("recording", _number(m.recording_mb_per_minute, 1, 1), "MB a minute"),
    ]


def _expectations(metrics: Metrics) -> Table:
    table = Table(show_edge=False, pad_edge=False, box=None, padding=(0, 2))
    table.add_column("")
    table.add_column("expected")
    table.add_column("", justify="right")
    table.add_column("measured", justify="right")
    for verdict in metrics.expectations:
        mark = "[green]ok[/green]" if verdict.ok else "[red]no[/red]"
        measured = _NONE if verdict.value is None else f"{verdict.value:.4g}"
        table.add_row(mark, verdict.name, f"{verdict.op} {verdict.bound:g}", measured)
    return table


def _number(value: float | None, scale: float, digits: int) -> str:
    return _NONE if value is None else f"{value * scale:.{digits}f}"
