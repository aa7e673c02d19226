"""A study of chaos as a page."""

from typing import Any

import pandas as pd

from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.report import NUMBER, TEXT, Code, Column, Figure, Page, Section, Source, Table, Text
from rattle.scene.scene import Scene

__all__ = ["FIGURES", "chaos_page", "table_of"]

FIGURES = {
    "section": "Poincare sections in the paper's coordinates: flight time against velocity before the impact, as "
    "densities on the same axes; orbit, mean map and noisy system.",
    "spectra": "Power spectra of the velocities with their 95 % band, the continuous floor, and the bands above it.",
    "sweep": "Largest exponent over the field with its 95 % interval: of the orbit, and of the drift's linearisation "
    "along noisy paths; where the orbit rests, and the range that the paper claims to be chaotic.",
    "bifurcation": "Section points over the field as densities, and the largest exponents beneath.",
    "finite_size": "Finite-size exponent of the noisy system over the distance of two paths on one noise: it grows as "
    "the distance shrinks, for there is no infinitesimal one.",
    "sqrt_law": "Distance after an impact of two paths on one noise over their distance before it, beside the law of "
    "the square root.",
}
"""Figures by name, with what is said beneath."""


def table_of(table: pd.DataFrame, texts: tuple[str, ...] = (), summary: str = "") -> Table:
    """A DataFrame as a table of a page; columns of `texts` hold words, all others numbers."""
    heads = [Column(str(name), TEXT if name in texts else NUMBER) for name in table.columns]
    rows = [
        [str(v) if name in texts else float(v) for name, v in zip(table.columns, row, strict=True)]
        for row in table.itertuples(index=False)
    ]
    return Table.of(heads, rows, summary)


def chaos_page(found: ChaosStudy, record: dict[str, Any], drawn: list[str]) -> Page:
    """What a study of chaos says; `drawn` are the figures that lie in its folder."""
    tables = found.tables()
    figures = {name: Figure(f"{name}.svg", FIGURES[name], FIGURES[name]) for name in drawn}
    shown = ["of", "exponent", "value", "low", "high", "rate", "sum_error", "impacts", "reason"]
    exponents = table_of(tables["exponents"][shown], ("of", "reason"))
    shown = ["closure", "map", "exponents", "not_realizable", "ends", "moments"]
    maps = table_of(tables["mean_maps"][shown], ("closure", "map", "exponents", "moments"))
    parts = [
        Section(
            "Lyapunov exponents",
            (
                Text("Per unit of dimensionless time, by orthonormal frames, with 95 % intervals of batch means. "
                     "`sum_error` is what their sum misses of -(beta1 + beta2) + rate 2 ln epsilon.", True),
                exponents,
                Text("The mean maps: what each closure iterates, and whose exponents its means have.", True),
                maps,
            ),
        ),
    ]  # fmt: skip
    if found.sweep is not None:
        blocks = [figures[n] for n in ("sweep", "bifurcation") if n in figures]
        crossings = table_of(tables["crossings"], ("of",))
        rows = table_of(tables["sweep"], ("of", "regime", "reason"), summary=f"All values of {found.field}")
        said = Text(f"Where the largest exponent changes its sign over {found.field}: between `low` and `high`.", True)
        parts.append(Section(f"Over {found.field}", (*blocks, said, crossings, rows)))
    parts.append(Section("Poincare sections", (figures["section"],)))
    texts = ("side", "kind", "velocity", "narrow")
    lines = tables["lines"][["side", "kind", "velocity", "frequency", "width", "share", "over", "narrow"]]
    parts.append(
        Section(
            "Spectra",
            (
                figures["spectra"],
                Text("`floor_share` is the continuous part of the power, `narrow` how many bands are no wider than a "
                     "single frequency; a spectrum without bands shows one with a probability of 1 %.", True),
                table_of(tables["spectra_summary"], ("side", "kind", "velocity")),
                table_of(lines, texts, summary="All bands"),
            ),
        )
    )  # fmt: skip
    apart = [figures[n] for n in ("finite_size", "sqrt_law") if n in figures]
    missing = (Text(f"The square-root law was not measured: {found.law_missing}."),) if found.law is None else ()
    parts.append(
        Section("Two paths on one noise", (*apart, *missing, table_of(tables["fsle"], summary="All distances")))
    )
    return Page(f"Chaos of {record['name']}", tuple(found.answer), source_of(record), sections=tuple(parts))


def source_of(record: dict[str, Any]) -> Source:
    """Where a page comes from, out of its manifest."""
    facts = {
        "commit": record["commit"], "seed": str(record["seed"]), "time": f"{record['wall_seconds']} s wall",
        "versions": ", ".join(f"{name} {version}" for name, version in record["versions"].items()),
    }  # fmt: skip
    scene = Code(Scene.from_dict(record["scene"]).to_toml(), "toml")
    return Source(record["command"], tuple(facts.items()), (Text("The scene:"), scene))
