"""The campaigns by name. A new one is one entry here; nothing is imported before it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Mapping

from canipulator.campaigns.campaign import Campaign
from config.errors import ConfigError, nearest

CAMPAIGNS: Mapping[str, str] = {
    "beck": "canipulator.campaigns.beck:beck_campaign",
    "slip": "canipulator.campaigns.scenarios:slip_campaign",
    "methods": "canipulator.campaigns.scenarios:methods_campaign",
    "soak": "canipulator.campaigns.soak:soak_campaign",
}
"""`module:function`; the function takes `duration_s` (--duration, or None) and gives the Campaign."""


def campaign_named(name: str, duration_s: float | None) -> Campaign:
    """Raises ConfigError for a name that is not there, for one whose module is not, and for what the campaign itself cannot do."""
    if name not in CAMPAIGNS:
        raise ConfigError(f"unknown campaign {name!r}, {nearest(name, CAMPAIGNS)}")
    module, function = CAMPAIGNS[name].split(":")
    try:
        made: Campaign = getattr(importlib.import_module(module), function)(duration_s)
    except ModuleNotFoundError as missing:
        raise ConfigError(f"campaign {name}: needs {missing.name}, which is not installed") from missing
    return made
