"""The report's page: numbers in the unit of their column, claims that can fail, nothing that is not in the page itself."""

import pytest

from logs.report_page import Claim, Column, Section, write_page
from stack.kinematics import ArmModel

ROWS = [
    ("a", {"error_m": 0.0012, "cycle_us": {"p50": 310.0}}),
    ("b", {"error_m": 0.0123, "cycle_us": {"p50": 290.0}}),
    ("c", {}),
]


@pytest.mark.parametrize(
    ("claim", "holds"),
    [
        (Claim("", "error_m", "a", "<", "b"), True),
        (Claim("", "error_m", "a", "<", "b", 0.05), False),
        (Claim("", "error_m", "b", "<", "a"), False),
        (Claim("", "cycle_us.p50", "a", "~", "b", 0.1), True),
        (Claim("", "cycle_us.p50", "a", "~", "b", 0.01), False),
        (Claim("", "error_m", "a", "<", "c"), None),
    ],
)
def test_a_claim_is_judged_by_the_numbers(claim: Claim, holds: bool | None) -> None:
    assert claim.holds(ROWS) is holds


def test_the_page_shows_numbers_claims_and_what_was_not_measured(tmp_path) -> None:
    columns = (Column("error_m", "error", 1e3, "mm"), Column("cycle_us.p50", "cycle", 1.0, "µs"))
    claims = (Claim("a beats b", "error_m", "a", "<", "b"), Claim("b beats a", "error_m", "b", "<", "a"))
    section = Section("Doors & hands", "It <says> so.", ROWS, columns, claims, (), [])
    text = write_page(tmp_path / "report.html", [section], ArmModel.load("moma8")).read_text()
    assert "Doors &amp; hands" in text
    assert "It &lt;says&gt; so." in text
    assert "<tr><th>a</th><td>1.2</td><td>310</td></tr>" in text
    assert "<tr><th>c</th><td>–</td><td>–</td></tr>" in text
    assert "<b>holds:</b> a beats b" in text
    assert "<b>does not hold:</b> b beats a" in text
    assert "http" not in text
