"""The page of a judgement."""

import time
from pathlib import Path
from typing import Any

from rattle.compare.judge.verdict import JUDGED, MARKS, Verdict
from rattle.compare.report.folder import name_of
from rattle.compare.report.json_text import Facts
from rattle.compare.report.provenance import provenance
from rattle.compare.report.report import Report
from rattle.compare.report.save import save
from rattle.compare.report.texts import glossary

MOST_ROWS = 200
"""Rows that the page shows; the table files hold all of them."""


def make_report(found: Any, record: Facts) -> Report:
    """The report on a `rattle.compare.Judgement`."""
    table = found.table
    shown = table[table["verdict"].isin(JUDGED)]
    order = shown["verdict"].map({Verdict.INACCURATE: 0, Verdict.UNDECIDED: 1, Verdict.ACCURATE: 2})
    shown = shown.assign(
        mark=shown["verdict"].map(MARKS).fillna(""),
        what=shown["quantity"].where(
            shown["moment"] == "rho", shown["moment"] + " of " + shown["quantity"]
        ),
        width=0.5 * (shown["high"] - shown["low"]),
        label=shown[found.label].astype(str),
    ).loc[order.sort_values(kind="stable").index]
    facts = {
        "label": found.label,
        "closures": found.closures,
        "level": found.level,
        "tolerances": list(found.tolerances),
        "units": found.units,
    }
    return Report(
        "judge",
        f"Can the closure be believed? {record['name']}",
        found.answer,
        record | facts,
        {
            "found": found,
            "rows": shown.head(MOST_ROWS),
            "left_out": max(len(shown) - MOST_ROWS, 0),
            "counts": found.counts.reset_index(names="closure"),
        },
        glossary("judge"),
        figures={"judge": found.plot()},
        tables={"table": table},
        template="judge/page.j2",
    )


def write_judgement(found: Any, out: Path, overwrite: bool) -> Path:
    """Write the page of a judgement that was made in Python."""
    origin = {"wall_seconds": None, "cpu_seconds": round(time.process_time(), 1)}
    record = {"name": name_of(out)} | provenance() | origin
    record |= {"command": "judge(...).report(...), in Python"}
    save(out, make_report(found, record), overwrite)
    return out / "judge.html"
