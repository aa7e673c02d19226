"""The page and the folder of ``rattle claims``."""

from collections import Counter
from pathlib import Path
from typing import Any

from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.page import FIGURES, source_of
from rattle.compare.claims.claim import HOLDS_ONLY, NOT_REPRODUCED, REPRODUCED, Claim, table
from rattle.compare.report import Cell, Figure, Page, Row, Section, Table, Text
from rattle.compare.report.save import contents, save

__all__ = ["CONTENTS", "answer", "write_claims"]

SHOWN = {
    "fuzzy": "section", "narrow_bands": "spectra", "chaotic_range": "sweep", "controlled": "bifurcation",
    "both_models": "sqrt_law",
}  # fmt: skip
"""Figure of the study of chaos that shows the evidence of a claim, by the claim's function."""
CONTENTS = contents("claims", figures=tuple(SHOWN.values()), tables=["claims"])
"""Files of such a folder; a folder with any other file is not overwritten."""


def _kind(verdict: str) -> str:
    return "hold in part" if verdict.startswith(HOLDS_ONLY.split("{", 1)[0]) else verdict


def _mark(verdict: str) -> str:
    if verdict.startswith(HOLDS_ONLY.split("{", 1)[0]):
        return "part"
    return {REPRODUCED: "good", NOT_REPRODUCED: "bad"}.get(verdict, "open")


def answer(claims: list[Claim]) -> list[str]:
    """Summarise how many claims have which verdict.

    Parameters
    ----------
    claims : list of Claim
        The claims, in order.

    Returns
    -------
    list of str
        One sentence.
    """
    counts = Counter(_kind(c.verdict) for c in claims)
    said = ", ".join(f"{number} {verdict}" for verdict, number in counts.most_common())
    return [f"Of {len(claims)} testable claims of the paper: {said}."]


def write_claims(
    out: Path, claims: list[Claim], names: list[str], chaos: ChaosStudy, record: dict[str, Any], overwrite: bool
) -> list[str]:
    """Write the folder of the claims atomically.

    Parameters
    ----------
    out : Path
        The folder.
    claims : list of Claim
        The claims, in order.
    names : list of str
        Names of the functions that judged them.
    chaos : ChaosStudy
        Source of the figures that show some of the evidence.
    record : dict
        Entries of the manifest.
    overwrite : bool
        Whether earlier results may be replaced.

    Returns
    -------
    list of str
        The answer, in sentences.

    Raises
    ------
    OutputError
        If the folder contains other files, or earlier results and `overwrite` is false.
    """
    said = answer(claims)
    drawn = {name: figure for name, figure in chaos.figures().items() if name in SHOWN.values()}
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
    tables = {"claims": table(claims).reset_index()}
    save(out, "claims", page, record, allowed=CONTENTS, figures=drawn, tables=tables, overwrite=overwrite)
    return said
