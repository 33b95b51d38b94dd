"""Runs inside the kernel that has CAN: three processes on vcan0, candump beside them, and a second run that is stopped by `cansend`.

    session.py OUT PACE

Everything is judged afterwards, from the files that this leaves in OUT.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

BUS = "socketcan:vcan0"
SCENARIO = ("--set", "step.2.length_m=0.6", "--set", "expect.5.min=0.58")
"""The door line is cut short: a user-mode kernel has one processor, and its system calls take long."""
LIMIT_S = 400.0


def canipulator(out: Path, pace: str, role: str, *more: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "canipulator", role, "--bus", BUS, "--pace", pace, "--out", str(out / role)]
    with (out / f"{role}.txt").open("wb") as text:
        return subprocess.Popen([*command, *SCENARIO, *more], stdout=text, stderr=subprocess.STDOUT)


def mission(out: Path, pace: str, *, stopped: bool) -> dict[str, int]:
    """All three roles, the planner first; with `stopped` a drive's quick stop from outside once the hand moves."""
    out.mkdir(parents=True)
    with (out / "candump.log").open("wb") as log:
        candump = subprocess.Popen(["candump", "-L", "-r", "4000000", "vcan0"], stdout=log)
    roles = {"planner": canipulator(out, pace, "planner")}
    wait_for(lambda: (out / "planner" / "bus.log").exists())
    roles["sim"] = canipulator(out, pace, "sim", "--no-rerun")
    roles["strategic"] = canipulator(out, pace, "strategic")
    if stopped:
        wait_for(lambda: "step 3/4" in (out / "strategic.txt").read_text())
        subprocess.run(["cansend", "vcan0", "617#2B40600002000000"], check=True)
    codes = {role: process.wait(LIMIT_S) for role, process in roles.items() if not (stopped and role != "strategic")}
    if stopped:
        for role in ("planner", "sim"):
            roles[role].send_signal(signal.SIGTERM)
            codes[role] = roles[role].wait(LIMIT_S)
    candump.send_signal(signal.SIGINT)
    candump.wait(LIMIT_S)
    return codes


def wait_for(condition) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("the roles did not get going")
        time.sleep(0.1)  # other processes, in real time


if __name__ == "__main__":
    root, speed = Path(sys.argv[1]), sys.argv[2]
    (root / "codes.json").write_text(
        json.dumps({name: mission(root / name, speed, stopped=name == "stopped") for name in ("mission", "stopped")})
    )
