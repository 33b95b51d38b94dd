"""Common ground of all tests: Hypothesis without time limits, and what a machine must have for the tests that need more.

With CANIPULATOR_REQUIRE=all (as .ci/run sets it) a missing CAN kernel or viewer is a failure; otherwise such tests are
skipped, and say why.
"""

import os
import shutil
import signal
from pathlib import Path

import pytest
from hypothesis import settings

# In CI the same examples every time: a landing must not hang on a lucky draw. People's machines go on searching.
_FIXED = os.environ.get("CI") == "true"
settings.register_profile("canipulator", deadline=None, print_blob=True, derandomize=_FIXED)
settings.register_profile("quick", deadline=None, print_blob=True, max_examples=25, derandomize=_FIXED)
settings.load_profile("canipulator")

# One solver thread: the same bits on every machine, and no fight for cores between test processes.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

# A shell that starts a job in the background has it ignore Ctrl-C, and so does everything that the job starts: not what is tested here.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

_NEEDS = {
    "socketcan": (
        lambda: shutil.which("linux.uml") is not None,
        "Debian's package user-mode-linux (for a kernel with CAN)",
    ),
    "viewer": (
        lambda: Path("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json").exists(),
        "Debian's packages mesa-vulkan-drivers and libvulkan1",
    ),
}


def pytest_runtest_setup(item: pytest.Item) -> None:
    for marker, (present, package) in _NEEDS.items():
        if item.get_closest_marker(marker) is None or present():
            continue
        if os.environ.get("CANIPULATOR_REQUIRE") == "all":
            pytest.fail(f"needs {package}, and everything is required here")
        pytest.skip(f"needs {package}")
