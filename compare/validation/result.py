"""The result of a validation: verdicts in a table, on a few lines, as figures and as a report."""

from pathlib import Path
from typing import TYPE_CHECKING

from rattle.compare.validation.comparison import Comparison
from rattle.montecarlo.diagnostics.diagnostics import list_counted
from rattle.scene import InputError, as_html, choice
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.units import with_units

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


@numpy_defaults
class Validation(Comparison):
    """Result of comparing closures with a simulation of the same scene.

    Attributes
    ----------
    scene : Scene
        The scene as given, in absolute time.
    predictions : dict of str to MeanMap
        The moments that each closure predicts, by its name.
    run : Ensemble
        The simulation.
    table : DataFrame
        Every moment of every closure with error, interval and verdict; the columns are ``COLUMNS``.
    correlation : DataFrame
        Validity of the correlation on both sides, see
        `rattle.compare.validation.errors.judge_correlation`.
    z : float
        Standard errors of the intervals, corrected for the number of rows.
    tolerances : Tolerances
        What counts as accurate.
    second_look : Ensemble or None
        Other paths, of which a part is drawn near rare branches, where rows waited for these.

    Examples
    --------
    >>> from rattle import DAT21, Scene, validate
    >>> scene = Scene.from_gears(DAT21, sigma=0.01)
    >>> v = validate(scene, impacts=2, closures=["saltation"], paths=20_000, rng=7)
    >>> bool(v.counts.loc["saltation", "accurate"] > 0)
    True
    """

    def __repr__(self) -> str:
        """What was compared, and the verdicts, on a few lines."""
        run = self.run
        lines = [
            (
                f"Validation: {run.paths:,} paths, {run.impacts} impacts, sigma ="
                f" {self.scene.sigma:.4g}, {run.scheme}"
            ),
            *(f"  {sentence}" for sentence in self.list_counts()),
            *(f"  {closure} {why}" for closure, why in self.failed.items()),
            *(f"  {sentence}" for sentence in list_counted(run)),
            (
                "  run.diagnostics also looks for rare branches that are missing, and for the bias"
                " of the step"
            ),
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return as_html(repr(self).split("\n")[0], self.counts.to_html())

    def plot(self, kind: str = "errors") -> "Figure":
        """Draw a figure of the report.

        Parameters
        ----------
        kind : {"errors", "correlation", "section"}
            Errors of the moments per impact, correlations of displacement and velocity, or
            densities of velocities.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.

        Raises
        ------
        InputError
            For an unknown kind, or one that these closures have nothing for.

        Examples
        --------
        >>> from rattle import DAT21, Scene, validate
        >>> v = validate(
        ...     Scene.from_gears(DAT21, sigma=0.01), impacts=1, closures=["saltation"], paths=1000
        ... )
        >>> len(v.plot("errors").axes)
        6
        """
        from rattle.compare.validation.figures import VALIDATION_FIGURES

        figure = VALIDATION_FIGURES[choice("kind", kind, VALIDATION_FIGURES)](self)
        if figure is None:
            raise InputError("kind", kind, "needs a closure other than branching")
        return figure

    def to_xarray(self) -> "xr.Dataset":
        """Convert the section moments of closures and simulation to a dataset.

        Needs the optional dependency ``xarray``.

        Returns
        -------
        xarray.Dataset
            Dimensions ``closure, impact, quantity, moment``; ``["quantity"].attrs`` holds the unit
            of each quantity.

        Examples
        --------
        >>> from rattle import DAT21, Scene, validate
        >>> v = validate(
        ...     Scene.from_gears(DAT21, sigma=0.01), impacts=1, closures=["saltation"], paths=1000
        ... )
        >>> v.to_xarray()["verdict"].dims
        ('closure', 'impact', 'quantity', 'moment')
        """
        rows = self.table[self.table["kind"] == "section"].drop(columns=["kind", "time"])
        return with_units(rows.set_index(["closure", "impact", "quantity", "moment"]).to_xarray())

    def report(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write the report of this validation, as ``rattle validate`` does.

        Parameters
        ----------
        folder : str or Path
            Where to; made if it is missing.
        overwrite : bool
            Whether an earlier report there may be replaced.

        Returns
        -------
        Path
            The page, ``report.html``.

        Raises
        ------
        OutputError
            If the folder holds other files, or an earlier report that may not be replaced.
        """
        from rattle.compare.validation.page import write_one

        return write_one(self, Path(folder), overwrite)
