"""The result of judging predictions by samples: verdicts in a table, in sentences, as a figure and
as a report."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from rattle.compare.judge.reference import UNSEEN_PATHS
from rattle.compare.judge.verdict import JUDGED, Verdict, join_words, unbroken
from rattle.scene import as_html
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.text import percent

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
        verdicts = (
            self.of_all_paths.groupby("closure", sort=False)["verdict"]
            .value_counts()
            .unstack(fill_value=0)
        )
        return verdicts.reindex(index=self.closure_names, columns=list(JUDGED), fill_value=0)

    def list_counts(self) -> list[str]:
        """The counts in words, a line for each closure."""
        return [
            f"{closure}: {good} of {good + bad + undecided} moments accurate, {bad}"
            f" inaccurate, {undecided} undecided"
            for closure, good, bad, undecided in self.counts.itertuples()
        ]


MOST_PATHS_TOLD = 1e8
"""Largest number of paths that is given as a remedy."""


def _describe_needed(paths: float) -> str:
    """How many paths would decide, in words."""
    if not paths > 0.0:
        return ""
    if paths > MOST_PATHS_TOLD:
        return " (some so close to what is allowed that no affordable number of paths decides)"
    return f" ({float(f'{paths:.2g}'):,.0f} paths would decide)"


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
        return [
            *(self._describe_closure(name) for name in self.closures),
            self._describe_sample(),
            *self._describe_bias(),
            *self._describe_unseen(),
            *self._describe_ended(),
            *self._describe_left_out(),
        ]

    def _describe_closure(self, name: str) -> str:
        """Up to which row a closure is accurate, and its worst error."""
        rows = self.table[self.table["closure"] == name]
        judged = rows[rows["verdict"].isin(JUDGED)]
        if judged.empty:
            return f"`{name}` predicts nothing that could be judged."
        labels = list(dict.fromkeys(judged[self.label]))
        by_row = judged["verdict"].eq(Verdict.ACCURATE).groupby(judged[self.label], sort=False)
        reach = unbroken(labels, by_row.all())
        good, bad, undecided = (int((judged["verdict"] == verdict).sum()) for verdict in JUDGED)
        sentence = f"`{name}`: {good} of {len(judged)} moments are accurate"
        sentence += f", {bad} inaccurate" * bool(bad)
        if undecided:
            needed = judged.loc[judged["verdict"] == Verdict.UNDECIDED, "paths_needed"].max()
            sentence += f", {undecided} undecided{_describe_needed(needed)}"
        if len(labels) > 1 and good < len(judged):
            if reach is None:
                sentence += f"; already at {self.label} {labels[0]} some are not shown to be"
            else:
                sentence += f"; all are up to {self.label} {reach}"
        worst = judged[judged["verdict"] == Verdict.INACCURATE]
        if len(worst):
            share = (worst["error"] / worst["tolerance"]).abs()
            row = worst.iloc[int(share.argmax())].to_dict()
            sentence += f". The worst: {self._describe_error(row)}"
        return f"{sentence}."

    def _describe_error(self, row: "dict[Any, Any]") -> str:
        """A row that is wrong, in words."""
        varies = row["unit"] > 0.0
        scale = row["unit"] if varies else 1.0
        error, low, high = (row[name] / scale for name in ("error", "low", "high"))
        of = "" if row["moment"] == "rho" else f"{row['moment']} of "
        unit = " of an sd" if varies and row["moment"] in ("mean", "sd") else ""
        place = f"{of}{row['quantity']} at {self.label} {row[self.label]}"
        interval = f" ({low:+.3g} to {high:+.3g})" if low < high else ""
        return f"{place} is off by {error:+.3g}{unit}{interval}"

    def _describe_sample(self) -> str:
        """What the predictions were compared with."""
        if self.exact:
            return "The reference is exact: no sampling error stands beside these verdicts."
        paths = self.table["paths"].max()
        return (
            f"Judged by {paths:,.0f} paths: intervals of {self.z:.2f} standard errors, which hold"
            f" together with {percent(self.level)}."
        )

    def _describe_bias(self) -> list[str]:
        """What is known of the bias of the step."""
        if self.exact:
            return []
        if not self.bias_measured:
            return [
                "No bias of the step was measured: if the samples come from a scheme with a step,"
                " give samples at twice the step as `coarser`."
            ]
        rows = self.table[self.table["closure"] == self.closures[0]]
        share = (rows["bias"].abs() / rows["unit"]).max()
        beyond = rows[1.5 * rows["bias"].abs() > rows["tolerance"]]
        if share == 0.0:
            return ["The samples have no bias of the step."]
        sentence = f"The bias of the step is up to {share:.2g} sds."
        if len(beyond):
            sentence += (
                f" At {len(beyond)} of {len(rows)} moments it exceeds what counts as accurate: the"
                " samples cannot be believed there; take a smaller step."
            )
        return [sentence]

    def _describe_unseen(self) -> list[str]:
        """What so few paths cannot have seen."""
        if self.exact or self.searched:
            return []
        paths = self.table["paths"].min()
        share = percent(min(UNSEEN_PATHS / max(paths, 1.0), 1.0))
        return [
            "Rare branches were not searched for, as there is no model: anything that fewer than"
            f" {share} of all paths do may be missing from {paths:,.0f} paths."
        ]

    def _describe_ended(self) -> list[str]:
        """Where paths have ended."""
        by_row = self.table.groupby(self.label, sort=False)["paths"].min()
        if self.exact or not by_row.min() < by_row.max():
            return []
        last = by_row.idxmin()
        return [
            f"{self.label} {last} is reached by {by_row.min():,.0f} of {by_row.max():,.0f} paths."
        ]

    def _describe_left_out(self) -> list[str]:
        """What was not compared."""
        sentences = []
        if self.not_compared:
            names = join_words([f"`{name}`" for name in self.not_compared])
            sentences.append(f"Not compared, as the samples have no such quantity: {names}.")
        if self.unpredicted:
            names = join_words([f"`{name}`" for name in self.unpredicted])
            sentences.append(f"Nothing is predicted of {names}.")
        return sentences

    def __repr__(self) -> str:
        """What was compared, and the verdicts, on a few lines."""
        rows = self.table[self.label].nunique()
        named = ", ".join(self.quantities)
        title = f"Judgement of {named} at {rows} row{'s' * (rows > 1)}"
        return "\n".join([title, *(f"  {sentence}" for sentence in self.answer)])

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.table.to_html(max_rows=40))

    def to_dict(self) -> dict[str, Any]:
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
