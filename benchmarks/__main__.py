"""All benchmarks, or those that are named: `python -m benchmarks [NAME ...]`. Exit code 1 if one of them failed, 2 for an unknown name."""

from __future__ import annotations

import subprocess
import sys

NAMES = ("stack", "physics", "bus", "drives", "resolvers", "recorder", "realtime", "trajectory")


def main(wanted: list[str]) -> int:
    """Each in a process of its own: a failing one does not hide the others, and none leaves anything behind in memory."""
    unknown = [name for name in wanted if name not in NAMES]
    if unknown:
        print(f"no benchmark {', '.join(unknown)}; there are {', '.join(NAMES)}", file=sys.stderr)
        return 2
    failed = []
    for name in wanted or NAMES:
        print(f"\n== {name} ==", flush=True)
        if subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=False).returncode != 0:
            failed.append(name)
    if failed:
        print(f"\nfailed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
