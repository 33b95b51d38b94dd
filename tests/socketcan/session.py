"""Runs inside the kernel that has CAN: three processes on vcan0, candump beside them, and a second run that is stopped by `cansend`.

    session.py OUT PACE

Everything is judged afterwards, from the files that this leaves in OUT.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

BUS = "socketcan:vcan0"
HERE = Path(__file__).parent
MEMORY = Path(
    "/dev/shm"
)  # files of the machine itself are written by its kernel: the whole session waits for its disk then
LIMIT_S = 200.0
PRIORITY = 20
"""Of all roles: none interrupts another, each gets all that has arrived when it is its turn. What else there is comes after them."""
SPEAKS_UP = (("planner", b" 702#00"), ("strategic", b" 701#00"), ("sim", b" 70B#00"))
"""Boot-up messages. The robot comes last: nothing is loaded any more when it is at work."""
PROCESSORS = {"planner": 0, "sim": 1, "strategic": 2, "candump": 2}
"""Where each of them runs, of the processors that there are: the last two beside the robot, if there are but two."""


def stay(name: str) -> None:
    """Before the program is loaded: the kernel runs it where it was loaded (see with-vcan)."""
    os.sched_setaffinity(0, {min(PROCESSORS[name], (os.cpu_count() or 1) - 1)})


def canipulator(out: Path, pace: str, role: str) -> subprocess.Popen[bytes]:
    program = [str(HERE / "timeless_physics.py")] if role == "sim" else ["-m", "canipulator"]
    command = [sys.executable, *program, role, "--bus", BUS, "--pace", pace, "--out", str(out / role)]
    if role == "sim":
        command.append("--no-rerun")
    with (out / f"{role}.txt").open("wb") as text:
        return subprocess.Popen(command, stdout=text, stderr=subprocess.STDOUT, preexec_fn=lambda: stay(role))


def mission(out: Path, pace: str, *, stopped: bool) -> dict[str, int]:
    """All three roles, the robot last; with `stopped` a drive's quick stop from outside once the hand moves."""
    out.mkdir(parents=True)
    heard = out / "candump.log"
    with heard.open("wb") as log:
        command = ["candump", "-L", "-r", "8000000", "vcan0"]
        candump = subprocess.Popen(command, stdout=log, preexec_fn=lambda: stay("candump"))
    roles: dict[str, subprocess.Popen[bytes]] = {}
    for role, boot_up in SPEAKS_UP:
        roles[role] = canipulator(out, pace, role)
        wait_for(lambda boot_up=boot_up: boot_up in heard.read_bytes(), roles)
    for process in roles.values():
        os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
    if stopped:
        wait_for(lambda: "step 3/4" in (out / "strategic.txt").read_text(), roles)
        subprocess.run(["cansend", "vcan0", "617#2B40600002000000"], check=True)
    codes = {role: process.wait(LIMIT_S) for role, process in roles.items() if not (stopped and role != "strategic")}
    if stopped:
        for role in ("planner", "sim"):
            roles[role].send_signal(signal.SIGTERM)
            codes[role] = roles[role].wait(LIMIT_S)
    candump.send_signal(signal.SIGINT)
    candump.wait(LIMIT_S)
    return codes


def wait_for(condition: Callable[[], bool], roles: dict[str, subprocess.Popen[bytes]]) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        ended = [role for role, process in roles.items() if process.poll() is not None]
        if ended or time.monotonic() > deadline:
            raise TimeoutError(f"the roles did not get going; ended: {ended}")
        time.sleep(0.1)  # other processes, in real time


if __name__ == "__main__":
    root, speed = Path(sys.argv[1]), sys.argv[2]
    Path("/proc/sys/kernel/sched_rt_runtime_us").write_text(
        "-1"
    )  # else 50 ms of each busy second are taken from the roles
    work = MEMORY / "session"
    try:
        codes = {name: mission(work / name, speed, stopped=name == "stopped") for name in ("mission", "stopped")}
        (work / "codes.json").write_text(json.dumps(codes))
    finally:
        shutil.copytree(work, root, dirs_exist_ok=True)
