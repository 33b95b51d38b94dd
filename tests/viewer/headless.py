"""A Rerun viewer without a screen: opens recordings, goes to a time, takes pictures of its window and of single views.

Software Vulkan (Debian's mesa-vulkan-drivers) draws the same pixels everywhere. Everything stays on 127.0.0.1.
"""

from __future__ import annotations

import io
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rerun_cli
from PIL import Image
from rerun.experimental import ViewerClient

VULKAN = "/usr/share/vulkan/icd.d/lvp_icd.x86_64.json"
PATIENCE_S = 60.0


class HeadlessViewer:
    """`client`: the viewer's own remote control; `url`: where recordings are sent to; `port` of its server."""

    def __init__(self, port: int, client: Any, process: subprocess.Popen[bytes]) -> None:
        self.port, self.client, self._process = port, client, process
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"

    def kill(self) -> None:
        """As when somebody closes the window."""
        _kill(self._process)

    def open(self, recording: Path) -> None:
        """Opens a file and waits until it is there."""
        self.client.open([str(recording.resolve())])
        self.wait_for(lambda state: bool(state.recordings) and not state.loading, "the recording")

    def wait_for(self, done: Any, what: str) -> Any:
        began = time.monotonic()
        while not done(state := self.client.get_state()):
            assert time.monotonic() - began < PATIENCE_S, f"{what} did not appear: {self.complaints()}"
            time.sleep(0.2)
        return state

    def go_to(self, t_s: float, timeline: str = "sim_time") -> None:
        self.client.set_time(timeline, play_state="paused", duration=np.timedelta64(round(t_s * 1e9), "ns"))
        time.sleep(1.0)

    def picture(self, view: str | None = None) -> np.ndarray:
        """(h, w, 3) of the window or of one view, once it no longer changes."""
        view_id = None if view is None else self._view(view).view_id
        last, began = b"", time.monotonic()
        while time.monotonic() - began < PATIENCE_S:
            png = self.client.take_screenshot(view_id=view_id)
            if png == last:
                break
            last = png
            time.sleep(0.5)
        return np.asarray(Image.open(io.BytesIO(last)).convert("RGB"))

    def views(self) -> dict[str, Any]:
        """Views by title."""
        return {view.name: view for view in self.client.get_state().views}

    def complaints(self) -> list[str]:
        """What the views report and the viewer has logged as warnings or errors."""
        reports = [
            f"{view.name}: {report.severity}: {report.summary}"
            for view in self.views().values()
            for report in view.reports
        ]
        logs = [
            entry.message
            for entry in self.client.get_logs()
            if entry.level.lower() in ("warn", "error") and "oftware rasterizer" not in entry.message
        ]
        return reports + logs

    def _view(self, title: str) -> Any:
        views = self.views()
        assert title in views, f"no view {title!r}; there are {sorted(views)}"
        return views[title]


@contextmanager
def headless_viewer(size: str = "1920x1080") -> Iterator[HeadlessViewer]:
    """A viewer of its own, gone afterwards."""
    home = tempfile.mkdtemp(prefix="viewer.")
    binary = Path(rerun_cli.__file__).with_name("rerun")
    folders = {name: f"{home}/{name}" for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME")}
    env = {**os.environ, "HOME": home, "XDG_RUNTIME_DIR": home, "VK_ICD_FILENAMES": VULKAN, "VK_DRIVER_FILES": VULKAN}
    env |= folders
    subprocess.run([binary, "analytics", "disable"], env=env, capture_output=True, check=False)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [binary, "--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", size]
    with open(f"{home}/log", "wb") as log:
        process = subprocess.Popen(
            [*command, "--hide-welcome-screen"], env=env, stdout=log, stderr=log, start_new_session=True
        )
        try:
            _wait_for_port(process, port, Path(home, "log"))
            yield HeadlessViewer(port, ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy"), process)
        finally:
            _kill(process)
            shutil.rmtree(home, ignore_errors=True)


def _kill(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait(20)


def _wait_for_port(process: subprocess.Popen[bytes], port: int, log: Path) -> None:
    began = time.monotonic()
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
            return
        except OSError:
            ended = process.poll() is not None or time.monotonic() - began > PATIENCE_S
            assert not ended, log.read_text(errors="replace")
            time.sleep(0.1)


def spread(picture: np.ndarray) -> float:
    """How much is to be seen: standard deviation of the brightness inside the frame, 0 for a plane of one colour."""
    inside = picture[30:-5, 5:-5].astype(float).mean(axis=2)
    return float(inside.std())


def share_like(picture: np.ndarray, color: tuple[int, int, int], tolerance: int = 40) -> float:
    """Share of the pixels that are of about this colour."""
    off = np.abs(picture.astype(int) - np.array(color)).max(axis=2)
    return float((off <= tolerance).mean())
