"""`canipulator report`: runs its set in other processes and leaves one page, the numbers, and the runs themselves."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from canipulator.cli import cli
from canipulator.report import SETS, write_report
from config.errors import ConfigError
from config.load import load_scenario


@pytest.mark.slow
def test_a_set_becomes_a_page_with_its_figures(tmp_path: Path) -> None:
    answer = CliRunner().invoke(
        cli, ["report", "coordination", "--out", str(tmp_path), "--jobs", "2", "--duration", "3"]
    )
    assert answer.exit_code == 0, answer.output
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64,") == len(SETS["coordination"].figures)
    numbers = json.loads((tmp_path / "report.json").read_text())
    assert {key.split(": ")[-1] for key in numbers} == {"abc", "unified", "arm-only"}
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["00", "01", "02"]


@pytest.mark.parametrize("name", SETS)
def test_every_run_of_every_set_is_a_scenario_and_every_claim_is_about_its_runs(name: str) -> None:
    for variant in SETS[name].variants:
        load_scenario("sliding-door", variant.sets)
    names = {variant.name for variant in SETS[name].variants}
    for claim in SETS[name].claims:
        assert {claim.first, claim.second} <= names


def test_a_set_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"unknown set 'case'.*cases"):
        write_report(["case"], tmp_path, jobs=1, duration_s=None, quiet=True)
