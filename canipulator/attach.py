"""`canipulator attach`: any python-can bus, served to tools that speak socketcand."""

from __future__ import annotations

import contextlib

from canipulator.serving import announce, open_server, report
from config.errors import ConfigError
from drivers.tool_bridge import BridgeError, ToolBridge


def attach(bus_url: str, port: int, *, allow_inject: bool) -> None:
    """Serves the bus until Ctrl-C. Raises ConfigError for a bus that is none, cannot be opened, or goes away."""
    interface, colon, channel = bus_url.partition(":")
    if interface == "lockstep":
        raise ConfigError(
            "--bus lockstep: a lockstep run has its bus in its own process; serve it with 'canipulator run SCENARIO --serve'"
        )
    if not (interface and colon and channel):
        raise ConfigError(f"--bus {bus_url!r}: must be interface:channel of python-can, e.g. socketcan:vcan0")
    server = open_server(port, allow_inject=allow_inject, extended=True)
    try:
        with contextlib.suppress(KeyboardInterrupt), ToolBridge(interface, channel, server) as bridge, server:
            announce(server, allow_inject=allow_inject)
            bridge.pump(lambda: True)
    except BridgeError as error:
        raise ConfigError(f"--bus {error}") from None
    report(server)
