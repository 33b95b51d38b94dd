"""Compaction of a finished recording, which also mends one that was torn off in mid-message."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import rerun_cli


def optimise(path: Path, timeout_s: float = 120.0) -> bool:
    """Rewrites a `.rrd` by `rerun rrd optimize`, about a third smaller; the file is replaced only when that went well.

    Needed after a run that was killed: a message that was cut off hides the whole file from the viewer until then.
    False, and the file as it was, when it could not be done (disk full, not a recording, time-out).
    """
    target = path.with_suffix(".optimised.rrd")
    binary = Path(rerun_cli.__file__).with_name("rerun")  # `bin/rerun` is a wrapper that outlives its signals
    try:
        done = subprocess.run(
            [binary, "rrd", "optimize", str(path), "-o", str(target)],
            capture_output=True,
            timeout=timeout_s,
            check=False,
        )
        if done.returncode == 0 and target.stat().st_size > 0:
            os.replace(target, path)
            return True
    except (OSError, subprocess.TimeoutExpired):
        pass
    target.unlink(missing_ok=True)
    return False
