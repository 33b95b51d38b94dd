"""A program: runs a scenario in a fresh process and prints, as JSON, which kernels of the planner were loaded after the warm-up.

loaded_late.py SCENARIO DIRECTORY
"""

import json
import sys
from pathlib import Path

from numba.core.dispatcher import Dispatcher

from canipulator.outcome import RunOptions
from canipulator.run import LockstepRun
from config.load import load_scenario
from config.robot import load_robot


def loaded() -> set[tuple[str, str]]:
    """(kernel, types of its arguments) of everything in `stack.planner` that is in memory."""
    modules = [module for name, module in sys.modules.items() if name.startswith("stack.planner")]
    kernels = [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
    return {(kernel.py_func.__qualname__, str(types)) for kernel in kernels for types in kernel.signatures}


def main(name: str, directory: Path) -> None:
    scenario = load_scenario(name)
    options = RunOptions(out=directory, record=False, quiet=True)
    with LockstepRun(scenario, load_robot(scenario.robot), options, directory) as run:
        before = loaded()
        run.go()
    print(json.dumps({"before": len(before), "late": sorted(loaded() - before)}))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
