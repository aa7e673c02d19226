"""The result of judging predictions by samples: verdicts in a table, in sentences, as a figure and
as a report."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from rattle.compare.judge.reference import UNSEEN_PATHS
from rattle.compare.judge.verdict import JUDGED, Verdict, unbroken
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.scene import as_html
from rattle.scene.numpy_errors import numpy_defaults

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


class Verdicts:
    """A table of moments with a verdict on each: what every comparison says of it."""

    if TYPE_CHECKING:  # what each comparison brings

        @property
        def of_all_paths(self) -> pd.DataFrame:
            """The rows that are about all paths."""

        @property
        def closure_names(self) -> list[str]:
            """The closures in their order."""

    @property
    def accurate(self) -> bool:
        """Whether all moments of all paths that are predicted and judged are accurate; see
        ``errors.RULE``."""
        return not self.of_all_paths["verdict"].isin((Verdict.INACCURATE, Verdict.UNDECIDED)).any()

    @property
    def counts(self) -> pd.DataFrame:
        """Number of predicted and judged moments of all paths with each verdict, by closure."""
        verdicts = pd.crosstab(self.of_all_paths["closure"], self.of_all_paths["verdict"])
        return verdicts.reindex(index=self.closure_names, columns=JUDGED, fill_value=0)

    def list_counts(self) -> list[str]:
        """The counts in words, a line for each closure."""
        return [
            f"{closure}: {good} of {good + bad + undecided} moments accurate, {bad}"
            f" inaccurate, {undecided} undecided"
            for closure, good, bad, undecided in self.counts.itertuples()
        ]


MOST_PATHS_TOLD = 1e8
"""Largest number of paths that is given as a remedy."""


@numpy_defaults
@dataclass(frozen=True, repr=False)
class Judgement(Verdicts):
    """Predictions judged by samples.

    Attributes
    ----------
    table : DataFrame
        A row for each closure, row, quantity and moment, in the columns of
        ``Validation.table``; besides ``paths``, and ``enough_paths``: whether an error
        of twice the tolerance would be found with a probability of 95 %.
    label : str
        What numbers the rows: the column of the table in place of ``impact``.
    closures : tuple of str
        Names of the predictions.
    z : float
        Standard errors of the intervals, corrected for the number of rows.
    level : float
        Probability with which all intervals hold together.
    tolerances : Tolerances
        What counts as accurate.
    units : dict of str to str
        Unit of each quantity; empty where none was given.
    searched : bool
        Whether the samples come with a search for rare branches.
    exact : bool
        Whether the reference has no sampling error.
    bias_measured : bool
        Whether samples at twice the step were given.
    not_compared : tuple of str
        Predicted columns that are no moments of the quantities.
    unpredicted : tuple of str
        Quantities of the samples of which nothing is predicted.

    Examples
    --------
    >>> import numpy as np
    >>> from rattle import judge
    >>> samples = {"x": np.random.default_rng(7).normal(size=(20_000, 2))}
    >>> found = judge({"x": [0.0, 0.0], "sd_x": [1.0, 1.0]}, samples)
    >>> found.accurate, found.counts.loc["prediction", "accurate"].item()
    (True, 4)
    """

    table: pd.DataFrame
    label: str
    closures: tuple[str, ...]
    z: float
    level: float
    tolerances: "tuple[float, ...]"
    units: dict[str, str]
    searched: bool
    exact: bool
    bias_measured: bool
    not_compared: tuple[str, ...]
    unpredicted: tuple[str, ...]

    @property
    def of_all_paths(self) -> pd.DataFrame:
        """The whole table."""
        return self.table

    @property
    def closure_names(self) -> list[str]:
        """The closures in their order."""
        return list(self.closures)

    @property
    def quantities(self) -> list[str]:
        """The quantities whose means and sds are judged."""
        rows = self.table[self.table["moment"] != "rho"]
        return list(dict.fromkeys(rows["quantity"]))

    @property
    def answer(self) -> list[str]:
        """The verdicts in sentences: how far each closure holds, and what the samples cannot
        tell."""
        paths = self.table["paths"]
        first = self.table[self.table["closure"] == self.closures[0]]
        bias = first["bias"].abs()
        return render_sentences(
            "judge/answer.j2",
            found=self,
            paths=paths,
            most_paths=MOST_PATHS_TOLD,
            closures={name: self._summarise(name) for name in self.closures},
            bias=(bias / first["unit"]).max(),
            biased=(1.5 * bias > first["tolerance"]).sum(),
            rows=len(first),
            unseen=min(UNSEEN_PATHS / max(paths.min(), 1.0), 1.0),
            reached=self.table.groupby(self.label, sort=False)["paths"].min(),
        )

    def _summarise(self, name: str) -> Facts:
        """Up to which row a closure is accurate, and its worst error, for the sentence on it."""
        judged = self.table.query("closure == @name and verdict in @JUDGED")
        accurate = judged["verdict"].eq(Verdict.ACCURATE)
        by_row = accurate.groupby(judged[self.label], sort=False).all()
        undecided = judged[judged["verdict"] == Verdict.UNDECIDED]
        wrong = judged[judged["verdict"] == Verdict.INACCURATE]
        share = (wrong["error"] / wrong["tolerance"]).abs()
        return {
            "moments": len(judged),
            "good": accurate.sum(),
            "bad": len(wrong),
            "undecided": len(undecided),
            "needed": undecided["paths_needed"].max(),
            "labels": list(by_row.index),
            "reach": unbroken(by_row.index, by_row),
            "worst": wrong.iloc[share.argmax()].to_dict() if len(wrong) else None,
        }

    def __repr__(self) -> str:
        """What was compared, and the verdicts, on a few lines."""
        rows = self.table[self.label].nunique()
        named = ", ".join(self.quantities)
        title = f"Judgement of {named} at {rows} row{'s' * (rows > 1)}"
        return "\n".join([title, *(f"  {sentence}" for sentence in self.answer)])

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.table.to_html(max_rows=40))

    def to_dict(self) -> Facts:
        """Answer and table as plain data."""
        return {
            "answer": self.answer,
            "accurate": self.accurate,
            "table": self.table.to_dict("records"),
        }

    def plot(self) -> "Figure":
        """Draw the errors of all moments with their intervals.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.

        Examples
        --------
        >>> import numpy as np
        >>> from rattle import judge
        >>> samples = {"x": np.random.default_rng(7).normal(size=(1000, 3))}
        >>> len(judge({"x": np.zeros(3), "sd_x": np.ones(3)}, samples).plot().axes)
        2
        """
        from rattle.compare.judge.figures import draw_errors

        return draw_errors(self)

    def to_xarray(self) -> "xr.Dataset":
        """Convert the table to a dataset; needs the optional dependency ``xarray``.

        Returns
        -------
        xarray.Dataset
            Dimensions ``closure``, the label of the rows, ``quantity, moment``;
            ``["quantity"].attrs`` holds the unit of each quantity.
        """
        keys = ["closure", self.label, "quantity", "moment"]
        dataset = self.table.drop(columns="kind").set_index(keys).to_xarray()
        dataset["quantity"].attrs.update(self.units)
        return dataset

    def report(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write a page with the verdicts, their figure and their table.

        Parameters
        ----------
        folder : str or Path
            Where to; made if it is missing.
        overwrite : bool
            Whether an earlier page there may be replaced.

        Returns
        -------
        Path
            The page, ``judge.html``.

        Raises
        ------
        OutputError
            If the folder holds other files, or an earlier page that may not be replaced.
        """
        from rattle.compare.judge.page import write_judgement

        return write_judgement(self, Path(folder), overwrite)
