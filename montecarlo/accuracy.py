"""How accurate an answer is: the standard error, and the bias of the step, of all section means and sds.

Errors count in units of each quantity's sd, the worst of all section means and sds: the standard error, and the bias of
the step as measured on the same noise at dt, 2 dt and 4 dt.  They count absolutely where the sd is no scale: where
nothing varies, and for the displacement at the mesh that most paths strike, which varies by the strays alone.
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

LEAST = 32 * BLOCK  # paths of an answer: what fewer than 1 in 10 000 do may make an sd, and is to be seen
FAINT = 0.2  # noise intensity up to which a control variate is tried, in units of alpha; on DAT21 it wins up to 0.07
STILL = 1e-9  # sd below which a quantity does not vary

Floats = NDArray[np.float64]


class HasColumns(Protocol):
    """An ensemble, or what is kept of one."""

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
    """Unit of each quantity's errors, index ``impact``, columns the section quantities."""
    import pandas as pd

    return pd.DataFrame(_units(run), index=run.section.index)


def sampling_error(run: HasColumns) -> tuple[float, str]:
    """Largest standard error of the section means and sds in units of the sd, and where it is."""
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
    """Largest bias of the step in units of the sd, and its standard error; of the impacts that were seen."""
    unit, bias = units(run), run.step_bias
    scale = np.array([unit.at[k, q] for k, q in zip(bias["impact"], bias["quantity"], strict=True)])
    share = (bias["bias"].abs() / scale).fillna(0.0)
    worst = int(share.to_numpy().argmax())
    return float(share.iloc[worst]), float(np.nan_to_num(bias["se_bias"].iloc[worst] / scale[worst]))


def small_noise(scene: Scene) -> bool:
    """Whether noise is so weak that the linearised path may be worth its time."""
    return scene.sigma <= FAINT * scene.alpha
