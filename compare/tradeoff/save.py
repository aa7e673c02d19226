"""Writes the folder of a trade-off: its page, its figures, its tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.report.save import contents, save
from rattle.compare.tradeoff.answer import EXACT, answer
from rattle.compare.tradeoff.figures import order_figure, tradeoff_figure
from rattle.compare.tradeoff.measure import Measured, bound_of_means, means_seconds, slope
from rattle.compare.tradeoff.page import tradeoff_page
from rattle.compare.tradeoff.weak_order import Orders

CONTENTS = contents(
    "tradeoff", figures=["tradeoff", "orders"], tables=["tradeoff", "levels", "control", "orders", "changes"]
)
"""Names of all files in a trade-off folder; a folder with any other file is not overwritten."""


def write_tradeoff(
    out: Path,
    m: Measured,
    control: pd.DataFrame,
    orders: Orders | None,
    accuracies: Sequence[float],
    record: dict[str, Any],
    overwrite: bool,
) -> list[str]:
    """Write the folder of a trade-off, whole or not at all."""
    sentences = answer(m, accuracies)
    means = pd.DataFrame(
        {
            "error": [bound_of_means(a, m.reference.scene, m.reference.impacts) for a in accuracies],
            "core_seconds": [means_seconds(m.models[EXACT], a, control=True) for a in accuracies],
        }
    )
    slopes = {name: slope(m.points, name, False)[0] for name in m.models}
    figures = {"tradeoff": tradeoff_figure(m.points, slopes, means)}
    levels = pd.concat([levels.table for levels in m.levels.values()])
    tables = {"tradeoff": m.points, "levels": levels, "control": control}
    if orders:
        figures["orders"] = order_figure(orders.changes)
        tables |= {"orders": orders.table, "changes": orders.changes}
    page = tradeoff_page(m, control, orders, accuracies, sentences, record)
    save(out, "tradeoff", page, record, allowed=CONTENTS, figures=figures, tables=tables, overwrite=overwrite)
    return sentences
