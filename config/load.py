"""Finding, reading, overriding and checking scenario files; writing the resolved one."""

from __future__ import annotations

import tomllib
import types
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin

import tomli_w
from pydantic import BaseModel, ValidationError

from config.errors import ConfigError, from_validation, nearest
from config.faults import parse_fault
from config.kinematic import KinematicScenario, kinematic_model
from config.scenario import Scenario

Model = TypeVar("Model", bound=BaseModel)
SCENARIO_DIR = Path(__file__).parent / "scenarios"


def scenario_names() -> list[str]:
    """Names of the scenarios that ship with the project, sorted."""
    return sorted(path.stem for path in SCENARIO_DIR.glob("*.toml"))


def load_scenario(name: str, overrides: Iterable[str] = (), faults: Iterable[str] = ()) -> Scenario | KinematicScenario:
    """The scenario `name` (of the project, or the path of a TOML file) with `KEY=VALUE` overrides applied, then further `faults`,
    each `KIND@SECONDS[:KEY=VALUE,…]`.

    A file with `kind = "kinematic"` is a KinematicScenario, one without `kind` a Scenario.
    Raises ConfigError with file, key, value and the nearest valid name.
    """
    path = _scenario_path(name)
    data = read_toml(path)
    for override in overrides:
        _apply(data, override)
    for fault in faults:
        data.setdefault("fault", []).append(parse_fault(fault))
    return validate(_model(data, path), data, path)


def _model(data: Mapping[str, Any], source: Path) -> type[Scenario] | type[KinematicScenario]:
    kind = data.get("kind")
    if kind is None:
        return Scenario
    if kind != "kinematic":
        raise ConfigError(f"{source}: kind = {kind!r}: must be 'kinematic', or left out for a run with physics and bus")
    return kinematic_model(data, source)


def validate(model: type[Model], data: Mapping[str, Any], source: Path | str) -> Model:
    """`data` as a checked `model`. Raises ConfigError that names the source."""
    try:
        return model.model_validate(_tuples(data))
    except ValidationError as error:
        raise from_validation(error, source, valid_keys(model)) from None


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file as a dict. Raises ConfigError with the path for anything that goes wrong."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text (byte {error.start})") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not TOML: {error}") from None


def dump_scenario(scenario: Scenario | KinematicScenario) -> str:
    """The resolved scenario as TOML; running it again reproduces the run."""
    return tomli_w.dumps(scenario.model_dump(mode="json", exclude_none=True))


def _scenario_path(name: str) -> Path:
    if name.endswith(".toml"):
        path = Path(name)
        if not path.is_file():
            raise ConfigError(f"no scenario file {name!r}")
        return path
    if name not in scenario_names():
        raise ConfigError(f"unknown scenario {name!r}, {nearest(name, scenario_names())}")
    return SCENARIO_DIR / f"{name}.toml"


def _apply(data: dict[str, Any], override: str) -> None:
    """One `--set a.b=value`; list elements by their index (`step.0.speed_m_s=0.1`)."""
    key, equals, text = override.partition("=")
    if not equals or not key:
        raise ConfigError(f"--set {override!r}: must be KEY=VALUE, e.g. slip.sigma=0.02")
    *tables, last = key.strip().split(".")
    node: Any = data
    for depth, part in enumerate(tables):
        node = _child(node, part, key, depth)
    value = _value(text.strip())
    if isinstance(node, list):
        node[_position(node, last, key)] = value
    elif isinstance(node, dict):
        node[last] = value
    else:
        raise ConfigError(f"--set {key}: {tables[-1]!r} is not a table")


def _child(node: Any, part: str, key: str, depth: int) -> Any:
    if isinstance(node, list):
        if key.startswith("fault.") and part == str(len(node)):
            node.append({})  # faults are what a scenario gets from outside: the next one begins here
        return node[_position(node, part, key)]
    if isinstance(node, dict):
        return node.setdefault(part, [] if part == "fault" and depth == 0 else {})
    raise ConfigError(f"--set {key}: {'.'.join(key.split('.')[:depth])!r} is not a table")


def _position(node: list[Any], part: str, key: str) -> int:
    if not part.isdigit() or int(part) >= len(node):
        raise ConfigError(f"--set {key}: {part!r} is not an index of the list (0 to {len(node) - 1})")
    return int(part)


def _value(text: str) -> Any:
    """A TOML value; a bare word is taken as a string."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _tuples(value: Any) -> Any:
    """TOML's lists as tuples, as the frozen models want them."""
    if isinstance(value, Mapping):
        return {key: _tuples(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_tuples(item) for item in value)
    return value


def valid_keys(model: type[BaseModel], prefix: str = "") -> dict[str, list[str]]:
    """Every table path of a model with the keys that it takes, for the nearest valid name."""
    found = {prefix: list(model.model_fields)}
    for name, field in model.model_fields.items():
        for inner in _models_in(field.annotation):
            found |= valid_keys(inner, f"{prefix}.{name}" if prefix else name)
    return found


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Union, types.UnionType, tuple, dict, list):
        return [model for part in get_args(annotation) for model in _models_in(part)]
    return []
