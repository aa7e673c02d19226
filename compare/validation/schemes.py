"""Ensembles of named schemes beside exact flights and the closures: what each is off by, and what it costs."""

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.closure.cost import closure_seconds
from rattle.compare.report import Row, Table, numbers
from rattle.compare.validation.comparison import Comparison
from rattle.compare.validation.section_errors import section_errors
from rattle.montecarlo import Ensemble, simulate

PATHS = 32_768
SHARES = ("bias_mean", "bias_sd", "error_mean", "error_sd")  # in sds of the quantity
FORMS = {"dt": ".4g", "paths": ",.0f", **dict.fromkeys(SHARES, ".3g"), "core_seconds": ".3g"}
"""Columns after noise intensity and method, and how the page shows their numbers."""

NOTE = (
    f"Each scheme with {PATHS:,} paths, and each closure, compared with the simulation of this report: the largest "
    "difference of a mean and of an sd over all impacts, in sds of the quantity, and the processor time (for closures "
    "the nominal one). For exact flights the difference is sampling error alone. The step bias is measured from dt, "
    "2 dt and 4 dt on the same noise, and the time includes that; it is not subtracted from the differences "
    "(`schemes.csv`)."
)


class _Named(NamedTuple):
    """The section moments of an ensemble, to be judged as those of a closure are."""

    closure: str
    section: pd.DataFrame


def compare_schemes(validations: Sequence[Comparison], schemes: Sequence[str], workers: int) -> pd.DataFrame:
    """Simulate each scene of some validations by each of these schemes; a row for each of them and for each closure."""
    rows = []
    for v in validations:
        for scheme in dict.fromkeys((v.run.scheme, *schemes)):
            seed = np.random.SeedSequence(v.run.seed.entropy, spawn_key=(*v.run.seed.spawn_key, 1))
            common: dict[str, Any] = {"impacts": v.run.impacts, "scheme": scheme, "rng": seed, "workers": workers}
            simulate(v.scene.phase_reduced, paths=2, **common)  # compiles
            began = time.process_time()
            run = simulate(v.scene.phase_reduced, paths=PATHS, **common)
            took = time.process_time() - began
            table = section_errors(_Named(scheme, run.section), v.run.phase_reduced, v.z, v.tolerances)
            rows.append((v.scene.sigma, scheme, run.dt, PATHS, *_biases(run, table), *_largest(table, "error"), took))
        for closure, prediction in v.predictions.items():
            table = v.section_rows(closure)
            own = table.assign(judged=table["verdict"] != "not judged")
            took = closure_seconds(prediction)
            rows.append((v.scene.sigma, closure, np.nan, 0, np.nan, np.nan, *_largest(own, "error"), took))
    return pd.DataFrame(rows, columns=["sigma", "method", *FORMS])


def _biases(run: Ensemble, table: pd.DataFrame) -> list[float]:
    """The largest measured bias of a mean and of an sd."""
    at = ["impact", "quantity", "moment"]
    return _largest(table.drop(columns="bias").merge(run.step_bias[[*at, "bias"]], on=at), "bias")


def _largest(table: pd.DataFrame, column: str) -> list[float]:
    """The largest value of a mean and of an sd, in sds of the quantity, over the rows that are judged."""
    rows = table[table["judged"] & (table["unit"] > 0.0)]
    shares = rows[column].abs() / rows["unit"]
    return [float(shares[rows["moment"] == moment].max()) for moment in ("mean", "sd")]


def scheme_table(found: pd.DataFrame, sigma: float) -> Table:
    """The rows of one noise intensity."""
    own = found[found["sigma"] == sigma].replace({"paths": {0: np.nan}})
    rows: list[Row] = [
        [r["method"], *("–" if pd.isna(r[name]) else format(r[name], form) for name, form in FORMS.items())]
        for r in own.to_dict("records")
    ]
    heads = ("dt", "paths", "bias of a mean", "bias of an sd", "off by, mean", "off by, sd", "processor time in s")
    return Table.of(["scheme or closure", *numbers(*heads)], rows)
