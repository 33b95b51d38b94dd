"""One HTML page, complete in itself: a section for each set of runs, with what the source says, a table, checked claims and figures."""

from __future__ import annotations

import base64
import html
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from logs.figures import FigureRun, figure_png
from stack.kinematics import ArmModel


@dataclass(frozen=True)
class Column:
    """A metric (dotted into metrics.json) as a column: shown times `scale`, in `unit`."""

    metric: str
    title: str
    scale: float
    unit: str

    def value(self, metrics: dict[str, Any]) -> float | None:
        """The number, in SI, None where the run has none."""
        found: Any = metrics
        for part in self.metric.split("."):
            found = found.get(part) if isinstance(found, dict) else None
        return None if found is None else float(found)


@dataclass(frozen=True)
class Claim:
    """`metric` of the run `first` is below (`<`) `share` times that of `second`, or differs by at most `share` of it (`~`)."""

    text: str
    metric: str
    first: str
    relation: str
    second: str
    share: float = 1.0

    def holds(self, rows: Sequence[tuple[str, dict[str, Any]]]) -> bool | None:
        """None where one of the two has no such number."""
        found = dict(rows)
        read = Column(self.metric, "", 1.0, "").value
        a, b = read(found[self.first]), read(found[self.second])
        if a is None or b is None:
            return None
        if self.relation == "~":
            return abs(a - b) <= self.share * abs(b)
        return bool(operator.lt(a, self.share * b))


@dataclass(frozen=True, eq=False)
class Section:
    """A set of runs, ready to be shown."""

    title: str
    source: str
    rows: list[tuple[str, dict[str, Any]]]
    columns: tuple[Column, ...]
    claims: tuple[Claim, ...]
    figures: tuple[str, ...]
    runs: list[FigureRun]


def write_page(path: Path, sections: Sequence[Section], arm: ArmModel) -> Path:
    """Writes the page; `path`. Raises OSError where it cannot."""
    body = "\n".join(_section(section, arm) for section in sections)
    path.write_text(_PAGE.format(body=body), encoding="utf-8")
    return path


def _section(section: Section, arm: ArmModel) -> str:
    parts = [f"<h2>{html.escape(section.title)}</h2>", '<div class="pair"><div class="source"><h3>The thesis</h3>']
    parts.append(f"<p>{html.escape(section.source)}</p>")
    parts += [_claim(claim, section) for claim in section.claims]
    parts += ['</div><div class="ours"><h3>Here</h3>', _table(section)]
    for name in section.figures:
        png = figure_png(name, section.runs, arm)
        if png is not None:
            parts.append(_image(png, f"{section.title}: {name}"))
    parts.append("</div></div>")
    return "\n".join(parts)


def _claim(claim: Claim, section: Section) -> str:
    holds = claim.holds(section.rows)
    mark, kind = {True: ("holds", "yes"), False: ("does not hold", "no"), None: ("not measured", "open")}[holds]
    return f'<p class="claim {kind}"><b>{mark}:</b> {html.escape(claim.text)}</p>'


def _table(section: Section) -> str:
    head = "".join(f"<th>{html.escape(c.title)}{f' [{c.unit}]' if c.unit else ''}</th>" for c in section.columns)
    lines = []
    for name, metrics in section.rows:
        cells = "".join(f"<td>{_number(c.value(metrics), c.scale)}</td>" for c in section.columns)
        lines.append(f"<tr><th>{html.escape(name)}</th>{cells}</tr>")
    return f"<table><tr><th></th>{head}</tr>{''.join(lines)}</table>"


def _number(value: float | None, scale: float) -> str:
    return "–" if value is None else f"{value * scale:.3g}"


def _image(png: bytes, text: str) -> str:
    return f'<img alt="{html.escape(text)}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Canipulator: report</title><style>
body {{ font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 1200px; padding: 0 1rem; color: #222; }}
h2 {{ margin-top: 3rem; border-bottom: 1px solid #ccc; }}
.pair {{ display: grid; grid-template-columns: 1fr 2fr; gap: 2rem; }}
@media (max-width: 800px) {{ .pair {{ grid-template-columns: 1fr; }} }}
.source {{ color: #444; }} .claim {{ border-left: 4px solid; padding-left: .7rem; }}
.yes {{ border-color: #2e7d32; }} .no {{ border-color: #c62828; }} .open {{ border-color: #999; }}
table {{ border-collapse: collapse; margin: 1rem 0; }} th, td {{ padding: .25rem .7rem; text-align: right; }}
tr + tr {{ border-top: 1px solid #ddd; }} img {{ width: 100%; }}
</style></head><body><h1>Canipulator: the sliding door, measured</h1>
<p>Every number is of runs in physics over the modelled bus, made for this page; TCP errors are against the true TCP in the world.</p>
{body}
</body></html>
"""
