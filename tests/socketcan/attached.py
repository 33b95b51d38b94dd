"""Other people's tools on vcan0 by way of `canipulator attach`: one that logs, one that stalls, one that plays. Judged by test_vcan.py.

attached.py OUT        (inside the kernel that has CAN)
"""

import json
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

LIMIT_S = 60.0
FILLER = "7FF"
"""Identifier of frames that only push the loggers' file buffers out."""
MASS, CHUNK, CHUNK_GAP_MS = 16_000, 200, "0.5"
"""More than a client's queue (8192 frames) and the socket buffers before it hold; the next chunk goes out when the logger has got there."""
PLAYED, PLAYED_GAP_S = 1_000, 0.005


def cangen(identifier: str, count: int, gap_ms: str) -> None:
    command = ["cangen", "vcan0", "-I", identifier, "-L", "8", "-D", "i", "-n", str(count), "-g", gap_ms]
    subprocess.run(command, check=True, timeout=LIMIT_S)


def wait_for(condition: Callable[[], object], meanwhile: Callable[[], object] = lambda: time.sleep(0.1)) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("a tool did not get on")
        meanwhile()


def stalled_client(port: int) -> socket.socket:
    """Opens the bus as a tool does, and never reads a frame."""
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.connect(("127.0.0.1", port))
    for said, answer in ((b"< open vcan0 >", b"< ok >"), (b"< rawmode >", b"< ok >")):
        if said == b"< open vcan0 >":
            assert client.recv(64) == b"< hi >"
        client.sendall(said)
        assert client.recv(64) == answer
    return client


def attached(out: Path) -> None:
    out.mkdir(parents=True)
    began = time.monotonic()
    times: dict[str, float] = {}
    heard, logged, played = out / "candump.log", out / "logger.log", out / "played.log"
    played.write_text("".join(f"({i * PLAYED_GAP_S:.6f}) vcan0 456#{i:016X}\n" for i in range(PLAYED)))
    with heard.open("wb") as log, (out / "attach.txt").open("wb") as text:
        candump = subprocess.Popen(["candump", "-L", "-r", "8000000", "vcan0"], stdout=log)
        command = ["-m", "canipulator", "attach", "--bus", "socketcan:vcan0", "--port", "0", "--allow-inject"]
        attach = subprocess.Popen([sys.executable, *command], stderr=text)
    wait_for(lambda: "tools may send" in (out / "attach.txt").read_text())
    (port,) = re.findall(r"127\.0\.0\.1:(\d+)", (out / "attach.txt").read_text())
    where = ["--bus-kwargs", "host=127.0.0.1", f"port={port}", "tcp_tune=True", "-i", "socketcand", "-c", "vcan0"]
    logger = subprocess.Popen(
        [sys.executable, "-m", "can.logger", *where, "-f", str(logged)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    stalled = stalled_client(int(port))

    def push() -> None:
        cangen(FILLER, 100, "2")

    wait_for(lambda: logged.exists() and logged.stat().st_size > 0, push)
    times["up"] = time.monotonic() - began
    for sent in range(CHUNK, MASS + 1, CHUNK):
        cangen("321", CHUNK, CHUNK_GAP_MS)
        wait_for(lambda sent=sent: logged.read_bytes().count(b" 321#") >= sent - CHUNK, lambda: time.sleep(0.02))
    times["mass"] = time.monotonic() - began
    player = [sys.executable, "-m", "can.player", *where, str(played)]
    subprocess.run(player, check=True, timeout=LIMIT_S, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(lambda: heard.read_bytes().count(b" 456#") == PLAYED)
    times["played"] = time.monotonic() - began
    wait_for(
        lambda: logged.read_bytes().count(b" 456#") == PLAYED and logged.read_bytes().count(b" 321#") >= MASS, push
    )
    times["logged"] = time.monotonic() - began
    for process in (logger, attach, candump):
        process.send_signal(signal.SIGINT)
        process.wait(LIMIT_S)
    stalled.close()
    (out / "times.json").write_text(json.dumps({name: round(at, 1) for name, at in times.items()}))


if __name__ == "__main__":
    attached(Path(sys.argv[1]))
