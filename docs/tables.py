"""What the pages show of the committed reports, read when the site is built: tables, answers and
figures.

.. code-block:: none

    ```{reported} speed        a table: of tables.toml, of a function in `COMPUTED`, or of the CSV
                               of a measuring script, whose Markdown is beside it
    ```{answer} chaos          the sentences that open a report
    ```{reported-figure} chaos/sweep.svg
    :alt: what it shows
    the caption
"""

import json
import os
import tomllib
from collections.abc import Callable, Iterable
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import source_tree
from docutils import nodes
from docutils.parsers.rst import directives
from jinja2 import Environment, StrictUndefined, UndefinedError
from kept_tables import Table, place_of, read, short
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from rattle.montecarlo.statistics.intervals import widest

__all__ = ["make_table", "setup"]

HERE = Path(__file__).parent
LAYOUTS = tomllib.loads((HERE / "tables.toml").read_text(encoding="utf-8"))
COMPUTED: dict[str, Callable[[Path], Table]] = {}
CLOSURES = ("published", "corrected", "saltation", "branching")
MOMENTS = {
    "tau": "the time of an impact",
    "flight": "a flight",
    "y1": "the speed y1",
    "y2": "the speed y2",
}
AVERAGES = {
    "rate": "impacts per unit of time",
    "rate_above": "those faster than 0.1",
    "energy_per_period": "energy lost per period",
}


def table(make: Callable[[Path], Table]) -> Callable[[Path], Table]:
    """Register a table by the name of the function that makes it from the folder of reports."""
    COMPUTED[make.__name__.replace("_", "-")] = make
    return make


def seconds(value: float) -> str:
    """A time in the unit that suits it."""
    for unit, size in (("h", 3600.0), ("min", 60.0), ("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{float(f'{value / size:.3g}'):,g} {unit}"
    return f"{value / 1e-6:.3g} µs"


def within(value: float, low: float, high: float, digits: int = 3) -> str:
    """A value and the half width of its interval."""
    return "–" if pd.isna(value) else f"{value:.{digits}f} ± {0.5 * (high - low):.{digits}f}"


CELLS = Environment(undefined=StrictUndefined, autoescape=False)
CELLS.filters |= {"short": short, "seconds": seconds, "within": within}


def load(layout: dict[str, Any], reports: Path) -> tuple[pd.DataFrame, Any]:
    """The rows of a file, and all of it where it is JSON."""
    file = reports / layout["file"]
    if not file.exists():
        file = HERE / layout["file"]
    if file.suffix == ".csv":
        return pd.read_csv(file), None
    whole = rows = json.loads(file.read_text(encoding="utf-8"))
    for key in layout["rows"]:
        rows = rows[key]
    return pd.DataFrame(rows), whole


def lay_out(layout: dict[str, Any], reports: Path) -> Table:
    """A table of tables.toml from its file."""
    rows, whole = load(layout, reports)
    rows = rows.query(layout.get("where", "index == index"))
    heads = []
    cells = []
    for head, text in layout["columns"]:
        heads.append(head)
        cells.append(CELLS.from_string(text if "{" in text else f"{{{{ {text} | short }}}}"))
    records = rows.to_dict("records")
    return heads, [[cell.render(row, whole=whole) for cell in cells] for row in records]


def make_table(name: str, reports: Path) -> Table:
    """A table by its name; raises KeyError where there is none."""
    if name in LAYOUTS:
        return lay_out(LAYOUTS[name], reports)
    if name in COMPUTED:
        return COMPUTED[name](reports)
    return read(place_of(HERE / "results" / f"{name.replace('-', '_')}.csv"))


def stretch(sigmas: Iterable[float]) -> str:
    """One noise intensity, or the first and the last of several."""
    found = [f"{s:.3g}" for s in sigmas]
    return found[0] if len(found) == 1 else f"{found[0]} – {found[-1]}"


@table
def source(_: Path) -> Table:
    """Lines of the source, counted when the site is built."""
    header = ["folder", "modules", "lines", "of code", "of docstrings"]
    return header, [[row[0], *(f"{n:,}" for n in row[1:])] for row in source_tree.rows()]


@table
def validity(reports: Path) -> Table:
    """How far each closure is accurate, for the noise intensities of the report on DAT21."""
    rows = []
    found = pd.read_csv(reports / "dat21" / "validity.csv")
    for closure in CLOSURES:
        of = found[found["closure"] == closure].sort_values("sigma").to_dict("records")
        for (accurate, not_wrong, _), same in groupby(
            of, lambda r: (r["accurate"], r["not_inaccurate"], r["cause"])
        ):
            group = list(same)
            why = group[0]["why"] if len(group) == 1 else group[0]["why"].split(":")[0]
            rows.append(
                [
                    closure,
                    stretch(r["sigma"] for r in group),
                    short(accurate),
                    short(not_wrong),
                    why,
                ]
            )
    return ["closure", "σ", "accurate up to impact", "not shown wrong up to", "why it ends"], rows


@table
def itinerary(reports: Path) -> Table:
    """Moments of the paths on each closure's itinerary, and of all paths, at the noise of the
    report on DAT21."""
    found = pd.read_csv(reports / "dat21" / "table.csv")
    rows = []
    for sigma, of in found.groupby("sigma"):
        for closure in CLOSURES:
            cells = []
            for kind in ("itinerary", "section"):
                own = of[(of["closure"] == closure) & (of["kind"] == kind)]
                judged = own["verdict"][
                    own["verdict"].isin(["accurate", "inaccurate", "undecided"])
                ]
                right = (judged == "accurate").sum()
                wrong = (judged == "inaccurate").sum()
                cells.append(f"{right} ({len(judged) - wrong}) of {len(judged)}")
            rows.append([f"{sigma:.4g}", closure, *cells])
    return ["σ", "closure", "on its itinerary", "all paths"], rows


@table
def long_restitution(reports: Path) -> Table:
    """The long run over the restitution."""
    found = pd.read_parquet(reports / "studies" / "long-restitution" / "quantities.parquet")
    names = ["rate", "energy_per_period", "slow_share"]
    rows = []
    for epsilon, of in list(found.groupby("epsilon"))[::2]:
        by = of.set_index("quantity")
        main = (f"{by['value'][n]:.3g} ± {0.5 * (by['high'][n] - by['low'][n]):.1g}" for n in names)
        rows.append([short(epsilon), *main, short(by["autocorrelation"]["slow_share"])])
    heads = ["ε", "impacts per unit of time", "energy lost per period", "share of slow impacts"]
    return [*heads, "their autocorrelation (impacts)"], rows


@table
def shares(reports: Path) -> Table:
    """Share of the predicted means and sds that are accurate, over the noise intensities of the
    default study."""
    errors = pd.read_parquet(reports / "studies" / "noise" / "errors.parquet")
    errors = errors[
        (errors["kind"] == "section")
        & errors["verdict"].isin(["accurate", "inaccurate", "undecided"])
    ]
    errors = errors[errors["judged"]]
    agreement = (
        errors[errors["impact"] == errors["impact"].max()].groupby("sigma")["agreement"].max()
    )
    rows = []
    for sigma in sorted(errors["sigma"].unique())[::2]:
        row = [short(sigma), f"{agreement[sigma]:.2f}"]
        for closure in CLOSURES:
            verdicts = errors.loc[
                (errors["sigma"] == sigma) & (errors["closure"] == closure), "verdict"
            ]
            row.append(
                f"{(verdicts == 'accurate').mean():.2f} ({(verdicts != 'inaccurate').mean():.2f})"
            )
        rows.append(row)
    return ["σ", "paths on one itinerary", *CLOSURES], rows


@table
def memory(reports: Path) -> Table:
    """Between which correlation times white noise begins to mislead about each quantity of
    DAT21."""
    sections = pd.read_parquet(reports / "studies" / "memory" / "sections.parquet")
    long = pd.read_parquet(reports / "studies" / "long-memory" / "quantities.parquet")
    sections = sections[
        sections["quantity"].isin(MOMENTS) & sections["moment"].isin(("mean", "sd"))
    ]
    found = pd.concat(
        [sections, long[long["quantity"].isin(AVERAGES)].assign(moment="", impact=0)],
        ignore_index=True,
    )
    at = ["sigma", "quantity", "impact"]
    white = found[found["correlation_time"] == 0.0]
    sds = white[white["moment"] == "sd"].set_index(at)["value"].rename("sd")
    found = (
        found[found["correlation_time"] > 0.0]
        .merge(white, on=[*at, "moment"], suffixes=("", "_white"))
        .join(sds, on=at)
    )
    off = (found["value"] - found["value_white"]).abs()
    half = widest(len(found)) * np.hypot(found["se"], found["se_white"])
    allowed = found["sd"].fillna(found["value_white"]) * np.where(
        found["moment"] == "sd", 0.1, 0.05
    )
    found = found.assign(right=off + half <= allowed, wrong=off - half > allowed)
    rows = []
    for (moment, quantity), of in found.groupby(["moment", "quantity"], sort=False):
        row = [f"{moment} of {MOMENTS[quantity]}" if moment else AVERAGES[quantity]]
        for _, own in of.groupby("sigma"):
            by = own.groupby("correlation_time")
            right = by["right"].all().cummin()
            wrong = by["wrong"].any()
            first = (
                f"{wrong.index[wrong][0]:g}" if wrong.any() else f"(none up to {wrong.index[-1]:g})"
            )
            row.append(f"{right.index[right][-1] if right.any() else 0.0:g} – {first}")
        rows.append(row)
    return ["", *(f"σ = {s:g}" for s in sorted(found["sigma"].unique()))], rows


@table
def exponents(reports: Path) -> Table:
    """Lyapunov exponents of the orbit, and of the linearisation along a noisy path."""
    found = pd.read_csv(reports / "chaos" / "exponents.csv")
    rows = [
        [str(name), *(within(r["value"], r["low"], r["high"]) for _, r in of.iterrows())]
        for name, of in found.groupby("of", sort=False)
    ]
    return ["exponents per unit of τ", "largest", "second", "third", "fourth"], rows


@table
def stability(reports: Path) -> Table:
    """Verdicts on the cells of the stability map whose step is admissible."""
    found = pd.read_csv(reports / "stability" / "stability.csv")
    found = found[found["share"] <= 1.0]
    verdicts = ("unbiased", "undecided", "biased", "unstable", "no limit")
    rows = []
    for scheme, of in found.groupby("scheme", sort=False):
        wrong = of[of["verdict"].isin(("biased", "unstable"))]
        counts = [short(int((of["verdict"] == v).sum())) for v in verdicts]
        rows.append([str(scheme), *counts, f"{int(wrong['diagnosed'].sum())} of {len(wrong)}"])
    return ["scheme", *verdicts, "biased or unstable, with a diagnostic"], rows


def _outcomes(folder: Path) -> Table:
    """How the scenes of a campaign ended, by entry point."""
    found = json.loads((folder / "summary.json").read_text())
    kinds = ("complete", "stopped", "refused", "defect")
    rows = [[n, *(short(ends.get(k, 0)) for k in kinds)] for n, ends in found["entries"].items()]
    return ["entry", *kinds], [*rows, ["all", *(short(found["ended"].get(k, 0)) for k in kinds)]]


@table
def fuzz(reports: Path) -> Table:
    """Random scenes near the paper's example and beyond it."""
    return _outcomes(reports / "fuzz")


@table
def fuzz_wide(reports: Path) -> Table:
    """Random scenes of any magnitude."""
    return _outcomes(reports / "fuzz-wide")


def cell(text: str) -> nodes.entry:
    """A cell; between two backticks stands code."""
    paragraph = nodes.paragraph()
    for i, part in enumerate(text.split("`")):
        if part:
            paragraph += nodes.literal("", part) if i % 2 else nodes.Text(part)
    return nodes.entry("", paragraph)


class FromReports(SphinxDirective):
    """What all of these directives share."""

    @property
    def reports(self) -> Path:
        """The folder of the reports."""
        return Path(self.config.rattle_reports)

    def noted(self, path: Path) -> Path:
        """A file, noted so that the page is read again when it changes."""
        if not path.exists():
            raise self.error(f"{path} is missing: make the reports first")
        self.env.note_dependency(str(path))
        return path


class Reported(FromReports):
    """A table of `TABLES`, or of a measuring script."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Make it."""
        name = self.arguments[0]
        try:
            heads, rows = make_table(name, self.reports)
        except (OSError, KeyError, UndefinedError) as error:
            raise self.error(
                f"the table {name} cannot be made of {self.reports}: {error!r}"
            ) from None
        whole = nodes.table(classes=["reported", f"reported-{name}"])
        group = nodes.tgroup(cols=len(heads))
        group += [nodes.colspec(colwidth=1) for _ in heads]
        group += nodes.thead("", nodes.row("", *map(cell, heads)))
        group += nodes.tbody("", *(nodes.row("", *map(cell, row)) for row in rows))
        whole += group
        return [nodes.container("", whole, classes=["wide-table"])]


class Answer(FromReports):
    """The sentences that open a report."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Make them."""
        file = self.noted(self.reports / self.arguments[0] / "manifest.json")
        items = nodes.bullet_list(classes=["answer"])
        for sentence in json.loads(file.read_text())["answer"]:
            items += nodes.list_item("", *cell(sentence).children)
        return [items]


class ReportedFigure(FromReports):
    """A figure of a report."""

    required_arguments = 1
    has_content = True
    option_spec = {"alt": directives.unchanged_required}  # noqa: RUF012  (as Sphinx wants it)

    def run(self) -> list[nodes.Node]:
        """Make it."""
        file = self.noted(self.reports / self.arguments[0])
        place = os.path.relpath(file, Path(self.env.doc2path(self.env.docname)).parent)
        image = nodes.image(uri=place, alt=self.options["alt"])
        caption = nodes.caption("", "", *self.parse_inline(" ".join(self.content))[0])
        return [nodes.figure("", image, caption)]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives, and the folder that they read."""
    app.add_config_value("rattle_reports", "", "env", [str])
    app.add_directive("reported", Reported)
    app.add_directive("answer", Answer)
    app.add_directive("reported-figure", ReportedFigure)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
