"""Real time as far as the machine allows: `python -m benchmarks.realtime [SECONDS]`.

All roles in one process over python-can's `virtual` bus, on the machine's own clock, at 100 and 250 arm cycles a second: SYNCs that were
left out, cycles that went ahead without the answer of every drive, and the worst timer as a share of the period. With real-time priority
(`chrt -f 10`) where the machine grants it. No goal: what the machine beside can do is what this says.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

RATES_HZ = ((100, 20), (250, 25))
"""Arm and platform cycles."""


def real_time_priority() -> list[str]:
    """The command in front, empty where the machine does not grant it."""
    if shutil.which("chrt") is None:
        return []
    granted = subprocess.run(["chrt", "-f", "10", "true"], capture_output=True, check=False).returncode == 0
    return ["chrt", "-f", "10"] if granted else []


def measure(arm_hz: int, platform_hz: int, seconds: float, front: list[str]) -> None:
    """One run, one line."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *front, sys.executable, "-m", "canipulator", "run", "sliding-door", "--bus", f"virtual:bench-{arm_hz}",
            "--set", f"planner.arm_cycle_hz={arm_hz}", "--set", f"planner.platform_cycle_hz={platform_hz}",
            "--set", "expect=[]", "--duration", f"{seconds:g}", "--no-rerun", "--json", "--out", str(Path(folder) / "run"),
        ]  # fmt: skip
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
        if not answer.stdout.strip():
            raise SystemExit(f"benchmarks.realtime: {answer.stderr.strip()}")
        found = json.loads(answer.stdout)
    cycles, period_us = round(seconds * arm_hz), 1e6 / arm_hz
    print(
        f"{arm_hz:4d} Hz {cycles:7d} cycles{found['missed_cycles']:8.0f} SYNCs missed{found['incomplete_cycles']:7.0f} incomplete"
        f"   worst timer {found['max_lateness_us'] / 1e3:7.2f} ms late = {found['max_lateness_us'] / period_us:5.2f} periods"
        f"   TCP {1e3 * found['tcp_error_rms_m']:.2f} mm rms   faults {len(found['faults'])}"
    )


def main(arguments: list[str]) -> int:
    """Prints a line per rate."""
    seconds = float(arguments[0]) if arguments else 20.0
    front = real_time_priority()
    load, _, _ = os.getloadavg()
    print(
        f"{seconds:g} s of sliding-door each, {' '.join(front) or 'no real-time priority'}, load of the machine {load:.1f}"
    )
    for arm_hz, platform_hz in RATES_HZ:
        measure(arm_hz, platform_hz, seconds, front)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
