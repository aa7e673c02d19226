"""What every result with moments by impact has in common: physical units, a figure, a dataset, a
view in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rattle.scene.errors import choice
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.text import as_html
from rattle.scene.types import section_names
from rattle.scene.units import as_dataset, in_units, unit_of_column

if (
    TYPE_CHECKING
):  # tables are made when they are asked for: loading pandas takes as long as all the rest
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from rattle.scene.scene import Scene


@numpy_defaults
class SectionResult:
    """Moments of the state just before each impact of a scene; a closure and a simulation give the
    same columns."""

    if TYPE_CHECKING:  # what each result brings

        @property
        def scene(self) -> Scene:
            """What was modelled."""

        @property
        def section(self) -> pd.DataFrame:
            """Moments just before impact 1, 2, ... (dimensionless), index ``impact``."""

        @property
        def _title(self) -> str:
            """What the title of a figure says besides sigma."""

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.section.to_html(max_rows=12, max_cols=12))

    def section_in(self, units: str) -> pd.DataFrame:
        """`section` in physical units, for a scene that was made from gears.

        Parameters
        ----------
        units : {"physical", "dimensionless"}
            The units; the second gives `section` itself.

        Returns
        -------
        DataFrame
            Columns with a dimension end with their unit: ``tau_ms, flight_ms, x1_mm, y1_mm_per_s,
            energy_mJ``, with their ``sd_`` and, of a simulation, ``se_`` and ``se_sd_``; besides
            ``impacts_per_s``, the inverse of the mean time of flight.

        Raises
        ------
        InputError
            For unknown units, or a scene without gears.

        Examples
        --------
        >>> from rattle import DAT21, Scene, mean_map
        >>> m = mean_map(Scene.from_gears(DAT21), impacts=1)
        >>> m.section_in("physical")[["tau_ms", "y1_mm_per_s"]].round(1).loc[1].tolist()
        [1.9, -110.9]
        """
        import pandas as pd

        columns = {str(name): values for name, values in self.section.items()}
        return pd.DataFrame(in_units(columns, self.scene.gears, units))

    def plot(self, quantity: str = "y1", units: str = "dimensionless") -> Figure:
        """Draw mean and standard deviation of a quantity just before each impact.

        Parameters
        ----------
        quantity : {"y1", "tau", "flight", "x1", "x2", "y2"}
            What is drawn.
        units : {"dimensionless", "physical"}
            Units of the axis; the second for a scene that was made from gears.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.

        Raises
        ------
        InputError
            For an unknown quantity or units, or physical units of a scene without gears.

        Examples
        --------
        >>> from rattle import DAT21, Scene, simulate
        >>> run = simulate(Scene.from_gears(DAT21, sigma=0.1), paths=64, impacts=3)
        >>> run.plot("y1", units="physical").axes[0].get_ylabel()
        'y1 before the impact in mm/s'
        """
        from rattle.scene.plot import plot_section

        scene = self.scene
        choice("quantity", quantity, section_names(scene.stages))
        known = unit_of_column(quantity, units, scene.gears)
        assert known is not None
        return plot_section(
            self.section, quantity, *known, f"{self._title}, sigma = {scene.sigma:.4g}"
        )

    def to_xarray(self, units: str = "dimensionless") -> xr.Dataset:
        """Convert `section` to a dataset; needs the optional dependency ``xarray``.

        Parameters
        ----------
        units : {"dimensionless", "physical"}
            Units of the variables; the second for a scene that was made from gears.

        Returns
        -------
        xarray.Dataset
            Dimension ``impact``, a variable for each column, with its unit in ``attrs["units"]``.

        Raises
        ------
        InputError
            For unknown units, or physical ones of a scene without gears.

        Examples
        --------
        >>> from rattle import DAT21, Scene, mean_map
        >>> mean_map(Scene.from_gears(DAT21), impacts=1).to_xarray("physical")["y1"].attrs["units"]
        'mm/s'
        """
        return as_dataset(self.section, units, self.scene.gears)
