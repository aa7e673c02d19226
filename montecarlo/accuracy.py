"""How accurate an answer is: the standard error and the step bias of all section means and sds.

Errors are in units of each quantity's sd; the worst of all section means and sds counts.  The step bias is measured
from dt, 2 dt and 4 dt on the same Brownian paths.  Errors are absolute where the sd is no scale: where nothing varies,
and for the displacement at the mesh that most paths strike, whose spread comes from off-itinerary paths only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.result import Ensemble
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["LEAST", "STILL", "sampling_error", "small_noise", "step_error", "units"]

LEAST = 32 * BLOCK  # fewest paths of an answer: events of probability 1e-4 can dominate an sd, so they must be sampled
SMALL_NOISE = 0.2  # sigma / alpha up to which the control variate is tried; on DAT21 it pays up to 0.07
STILL = 1e-9  # sd below which a quantity does not vary

Floats = NDArray[np.float64]


class HasColumns(Protocol):
    """An ensemble, or a stored result with the same columns."""

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """As `Ensemble.columns`."""
        ...

    @property
    def section(self) -> pd.DataFrame:
        """As `Ensemble.section`."""
        ...


def _units(run: HasColumns) -> dict[str, Floats]:
    columns = run.columns
    unit = {q: np.where(columns["sd_" + q] > STILL, columns["sd_" + q], 1.0) for q in SECTION}
    for mesh in (1, 2):
        unit[f"x{mesh}"] = np.where(columns["mesh"] == mesh, 1.0, unit[f"x{mesh}"])
    return unit


def units(run: HasColumns) -> pd.DataFrame:
    """Unit of each quantity's errors: its sd, or 1 where the sd is no scale.

    Parameters
    ----------
    run : Ensemble or stored result
        Anything with `columns` and `section`.

    Returns
    -------
    DataFrame
        Index ``impact``, columns the section quantities.
    """
    import pandas as pd

    return pd.DataFrame(_units(run), index=run.section.index)


def sampling_error(run: HasColumns) -> tuple[float, str]:
    """Largest standard error of the section means and sds, in units of each quantity's sd.

    Parameters
    ----------
    run : Ensemble or stored result
        Anything with `columns` and `section`.

    Returns
    -------
    error : float
        0 where nothing varies.
    where : str
        Moment, quantity and impact of the largest error.
    """
    unit, columns = _units(run), run.columns
    worst, where = 0.0, "nothing varies" if np.isfinite(columns["tau"]).any() else "no impact was seen"
    for q in SECTION:
        for name, prefix in (("mean", "se_"), ("sd", "se_sd_")):
            errors = np.nan_to_num(columns[prefix + q] / unit[q])
            k = int(errors.argmax())
            if errors[k] > worst:
                worst, where = float(errors[k]), f"{name} of {q} at impact {k + 1}"
    return worst, where


def step_error(run: Ensemble) -> tuple[float, float]:
    """Largest step bias of the section means and sds, in units of each quantity's sd, over the impacts that occurred.

    Parameters
    ----------
    run : Ensemble
        Simulated with its step bias.

    Returns
    -------
    bias, se_bias : float
        Size of the largest bias, and its standard error.

    Raises
    ------
    InputError
        If the run was made without step bias.
    """
    unit, bias = units(run), run.step_bias
    scale = np.array([unit.at[k, q] for k, q in zip(bias["impact"], bias["quantity"], strict=True)])
    share = (bias["bias"].abs() / scale).fillna(0.0)
    worst = int(share.to_numpy().argmax())
    return float(share.iloc[worst]), float(np.nan_to_num(bias["se_bias"].iloc[worst] / scale[worst]))


def small_noise(scene: Scene) -> bool:
    """Whether the noise is weak enough for the linearised path to be worth its time as a control variate.

    Parameters
    ----------
    scene : Scene
        Its `sigma` is compared with `alpha`.

    Returns
    -------
    bool
    """
    return scene.sigma <= SMALL_NOISE * scene.alpha
