"""The claims as a page."""

from collections import Counter
from pathlib import Path
from typing import Any

from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.page import FIGURES, source_of
from rattle.compare.claims.claim import HOLDS_ONLY, NOT_REPRODUCED, REPRODUCED, Claim, table
from rattle.compare.report import Cell, Figure, Page, Row, Section, Table, Text, pages, write_page
from rattle.compare.report.csv_text import write_csv
from rattle.compare.report.folder import whole_folder
from rattle.compare.report.json_text import json_text
from rattle.compare.report.style import save

__all__ = ["CONTENTS", "answer", "write_claims"]

SHOWN = {
    "fuzzy": "section", "narrow_bands": "spectra", "chaotic_range": "sweep", "controlled": "bifurcation",
    "both_models": "sqrt_law",
}  # fmt: skip
"""Figure of the study of chaos that shows a claim's evidence."""
CONTENTS = frozenset({"claims.csv", "manifest.json", *pages("claims"), *(f"{name}.svg" for name in SHOWN.values())})
"""What such a folder holds; anything else in it is not ours."""


def _kind(verdict: str) -> str:
    return "hold in part" if verdict.startswith(HOLDS_ONLY.split("{", 1)[0]) else verdict


def _mark(verdict: str) -> str:
    return {REPRODUCED: "good", NOT_REPRODUCED: "bad"}.get(verdict, "open")


def answer(claims: list[Claim]) -> list[str]:
    """How many of the claims stand."""
    counts = Counter(_kind(c.verdict) for c in claims)
    said = ", ".join(f"{number} {verdict}" for verdict, number in counts.most_common())
    return [f"Of {len(claims)} testable claims of the paper: {said}."]


def write_claims(
    out: Path, claims: list[Claim], names: list[str], chaos: ChaosStudy, record: dict[str, Any], overwrite: bool
) -> list[str]:
    """Write the folder and return the answer.

    Parameters
    ----------
    out : Path
    claims : list of Claim
    names : list of str
        Of the functions that judged them.
    chaos : ChaosStudy
        Whose figures show some of the evidence.
    record : dict
        Of the manifest.
    overwrite : bool

    Raises
    ------
    OutputError
        If the folder holds other things, or earlier ones that may not be replaced.
    """
    said = answer(claims)
    with whole_folder(out, CONTENTS, overwrite) as folder:
        drawn = {name: figure for name, figure in chaos.figures().items() if name in SHOWN.values()}
        for name, figure in drawn.items():
            save(figure, folder / f"{name}.svg")
        write_csv(table(claims), folder / "claims.csv")
        rows: list[Row] = [
            [str(i), c.says, Cell(c.verdict, _mark(c.verdict)), c.where] for i, c in enumerate(claims, start=1)
        ]
        overview = Table.of(["claim", "the paper says", "verdict", "where"], rows)
        sections = []
        for i, (name, claim) in enumerate(zip(names, claims, strict=True), start=1):
            shown = SHOWN.get(name, "")
            pictures = [Figure(f"{shown}.svg", FIGURES[shown], FIGURES[shown])] if shown in drawn else []
            sections.append(Section(f"{i}. {claim.name}", (
                Text(f"The paper, {claim.where}: “{claim.says}”"),
                Text(f"Verdict: {claim.verdict}."), Text(f"Test: {claim.test}"),
                Text(f"Evidence: {claim.evidence}"), *pictures,
            )))  # fmt: skip
        page = Page("The paper's claims, judged", tuple(said), source_of(record), (overview,), tuple(sections))
        write_page(page, folder, "claims")
        text = json_text({**record, "answer": said}) + "\n"
        (folder / "manifest.json").write_text(text, encoding="utf-8")
    return said
