"""One way to say that a configuration is wrong: file, key, value, and what would be right."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError


class ConfigError(ValueError):
    """A configuration that cannot be used; the message is one line for the person who wrote it."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """`did you mean …` for the closest valid name, else the list of all that are valid."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"valid: {', '.join(names)}"


def from_validation(error: ValidationError, source: Path | str, valid_keys: dict[str, list[str]]) -> ConfigError:
    """The first finding of a pydantic validation as one line. `valid_keys`: table path -> its keys."""
    finding = error.errors(include_url=False)[0]
    key = dotted(finding["loc"])
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if finding["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        *table, name = finding["loc"]
        keys = valid_keys.get(_table_path(table, valid_keys), [])
        return ConfigError(f"{source}: unknown key {key!r}, {nearest(str(name), keys)}{more}")
    if finding["type"] in ("missing", "missing_argument"):
        return ConfigError(f"{source}: key {key!r} is missing{more}")
    reason = finding["msg"].removeprefix("Value error, ")
    return ConfigError(f"{source}: {key} = {shown(finding['input'])}: {reason[0].lower()}{reason[1:]}{more}")


def _table_path(table: Iterable[Any], valid_keys: Iterable[str]) -> str:
    """The path of a table without the positions of lists and the names that a table of tables is free to have (`drives.25`)."""
    path = ""
    for part in table:
        longer = f"{path}.{part}" if path else str(part)
        path = longer if longer in valid_keys else path
    return path


def dotted(location: Iterable[Any]) -> str:
    """A pydantic location as the key that a TOML author would write."""
    return ".".join(str(part) for part in location)


def shown(value: Any) -> str:
    """A value for an error line, cut to a readable length."""
    try:
        text = json.dumps(value)
    except TypeError:
        text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def one_of(value: str, valid: Sequence[str], what: str) -> str:
    """`value` if it is one of `valid`, else a ConfigError with the nearest."""
    if value not in valid:
        raise ConfigError(f"unknown {what} {value!r}, {nearest(value, valid)}")
    return value
