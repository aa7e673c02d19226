"""What a simulation says of every section mean and sd, and of the error of what it says: the rows
that closures are compared with."""

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rattle.montecarlo.diagnostics.accuracy import skewness_gains, smallest_sd
from rattle.montecarlo.diagnostics.unseen import unseen
from rattle.montecarlo.settings import is_random
from rattle.montecarlo.statistics.intervals import ABSOLUTE, FEWEST_FOR_SD
from rattle.montecarlo.statistics.section_statistics import quantities_in
from rattle.scene import Scene
from rattle.scene.table_entries import pick

if TYPE_CHECKING:
    import pandas as pd


class Simulated(Protocol):
    """Section moments of a simulation: a `rattle.montecarlo.Ensemble`, or the tables stored of
    one."""

    @property
    def scene(self) -> Scene:
        """What was modelled."""

    @property
    def section(self) -> "pd.DataFrame":
        """As `Ensemble.section`."""

    @property
    def step_bias(self) -> "pd.DataFrame":
        """As `Ensemble.step_bias`."""

    @property
    def agreement(self) -> "pd.DataFrame":
        """As `Ensemble.agreement`."""


def at_wall(quantity: Any, mesh: Any) -> Any:
    """Whether a quantity is the displacement at the struck mesh, which is the known position of the
    wall and is not judged."""
    return np.asarray(quantity, str) == np.char.add("x", np.asarray(mesh, int).astype(str))


def list_reference(run: Simulated) -> "pd.DataFrame":
    """Every section mean and sd of a simulation, with its error: a row for each impact, quantity
    and moment.

    Returns: The columns that `rattle.compare.judge.rows.compare_rows` takes; the rows are in the
    order of `Ensemble.step_bias`.
    """
    import pandas as pd

    section = run.section
    steps = run.step_bias
    impact = steps["impact"]
    quantity = steps["quantity"]
    is_mean = steps["moment"] == "mean"
    name = quantity.where(is_mean, "sd_" + quantity)
    sds = steps[~is_mean].set_index(["impact", "quantity"])
    sd = sds.loc[pd.MultiIndex.from_arrays([impact, quantity])].reset_index(drop=True)
    unit = sd["corrected"].where(sd["corrected"] > 0.0, pick(section, impact, "sd_" + quantity))
    sizes = {
        q: float(np.hypot(section[q], section["sd_" + q]).max())
        for q in quantity.unique()
        if q != "tau"
    }
    size = quantity.map(sizes | {"tau": sizes["flight"]}).astype(float).fillna(0.0)
    columns = {str(name): section[name].to_numpy() for name in section}
    paths = section["paths"].loc[impact].to_numpy()
    few = ~is_mean & is_random(run.scene) & (paths < FEWEST_FOR_SD)
    least = pd.DataFrame(smallest_sd(columns), index=section.index)
    hidden = unseen(run.scene, columns, int(section["paths"].max()))
    place = pd.Index(quantities_in(columns)).get_indexer(pd.Index(quantity))
    at = impact.to_numpy() - 1, place
    of_mean = is_mean.to_numpy()
    gains = skewness_gains(columns, 1.0)[(~of_mean).astype(int), place, at[0]]
    needed = hidden.needed[at]
    return pd.DataFrame(
        {
            "closure": "",
            "kind": "section",
            "impact": impact,
            "quantity": quantity,
            "moment": steps["moment"],
            "predicted": np.nan,
            "simulated": pick(section, impact, name),
            "se": pick(section, impact, "se_" + name),
            "bias": steps["bias"],
            "error": np.nan,
            "corrected": steps["corrected"],
            "noise": steps["se_corrected"].where(~few),
            "rest": steps["rest"],
            "unit": unit,
            "se_unit": sd["se_corrected"],
            "still": np.where(unit > pick(least, impact, quantity), 0.0, ABSOLUTE * size),
            "judged": ~at_wall(quantity, section["mesh"].loc[impact].to_numpy()),
            "agreement": section["agreement"].loc[impact].to_numpy(),
            "paths": paths,
            "lean": 2.0 * gains,  # of z = 1 a gain is lean (2 + 1) / 6
            "unseen_low": np.where(of_mean, hidden.mean_up[at], hidden.sd_up[at]),
            "unseen_high": np.where(of_mean, hidden.mean_down[at], hidden.sd_down[at]),
            "unseen_share": hidden.probability[at],
            "unseen_paths": np.where(few, np.fmax(needed, FEWEST_FOR_SD), needed),
            "remark": "",
        }
    )
