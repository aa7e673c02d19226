"""What an assessment knows: the threshold of rattle, the long run, the levers and the closures."""

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import pandas as pd

from rattle.compare.assess.requirement import Fulfilment, Requirement
from rattle.compare.judge.verdict import DECIDED
from rattle.compare.parameters.boundary import Boundary
from rattle.compare.parameters.sensitivity import Sensitivity
from rattle.compare.report.finding import Finding
from rattle.compare.report.render import render_sentences, render_text
from rattle.compare.stationary.page import share_energy, show_quantity
from rattle.compare.stationary.result import Stationary, speed_text, usual_units
from rattle.compare.study.parameters import PERCENT, find_parameters
from rattle.scene import Scene, line
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.text import number_text
from rattle.scene.threshold import RattleThreshold

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOUDNESS = "power"  # the quantity whose levers are named
LEVERS_NAMED = 3
ASSESSED_IMPACTS = 4  # after the start, for which a closure must be accurate


@numpy_defaults
@dataclass(frozen=True, repr=False)
class Assessment(Finding):
    """An engineer's answer on a scene, from `assess`.

    Attributes
    ----------
    scene : Scene
    thresholds : tuple of RattleThreshold
        Does it rattle: the drag of each wheel, and that from which on its closed teeth stay closed.
    motion : Stationary or None
        How hard: the long run; None where it is not known.
    levers : Sensitivity or None
        What helps: the effect of 1 % more of each parameter on the energy that impacts lose and on
        the impacts a second.
    closures : tuple of Boundary
        Can a closure be used: up to which noise intensity each closure is accurate for the first
        impacts after the start.
    missing : dict of str
        Why a part is not known, by its name.
    budget, spent : float
        Processor seconds that were allowed, and that were used.
    requirement : Requirement or None
        What was required of a quantity.

    Examples
    --------
    >>> from rattle import DAT21, Scene, assess
    >>> found = assess(Scene.from_gears(DAT21, sigma=0.5), budget=5.0)
    >>> found.rattles, round(found.table.loc["rate_above", "value"]) > 100
    (True, True)
    """

    title = "Assessment"
    shown = "table"

    scene: Scene
    thresholds: tuple[RattleThreshold, ...]
    motion: Stationary | None = None
    levers: Sensitivity | None = None
    closures: tuple[Boundary, ...] = ()
    missing: dict[str, str] = field(default_factory=dict)
    budget: float = 0.0
    spent: float = 0.0
    requirement: Requirement | None = None

    @property
    def units(self) -> str:
        """The units of `table`: ``physical`` where the scene has gears, else ``dimensionless``."""
        return usual_units(self.scene)

    @property
    def rattles(self) -> bool | None:
        """Whether impacts were seen in the long run; None where it is not known."""
        if self.motion is None:
            return None
        return self.motion.kind != "rest" and bool(self.motion.table["value"]["rate"] > 0.0)

    @property
    def reached(self) -> bool:
        """Whether long run and levers are as well known as they are asked for by default: a larger
        budget changes neither."""
        run = self.motion.run if self.motion else None
        known = run is None or run.reach is None or run.reach.reached
        return known and (self.levers is None or self.levers.reached)

    @property
    def table(self) -> pd.DataFrame:
        """The long run, index ``quantity``, with ``value, low, high, unit``; empty if not known."""
        columns = ["value", "low", "high", "unit"]
        if self.motion is None:
            return pd.DataFrame(columns=columns).rename_axis("quantity")
        return self.motion.table_in(self.units)[columns]

    @property
    def fulfilment(self) -> Fulfilment | None:
        """Whether the requirement is met; None where there was none."""
        return self.requirement and self.requirement.decide(self.table)

    @property
    def answer(self) -> list[str]:
        """The four answers and what they cost, a few sentences each."""
        table = self.table
        return render_sentences(
            "assess/answer.j2",
            self.scene.words,
            found=self,
            opened=[t for t in self.thresholds if t.opens],
            table=table.to_dict("index"),
            meshes=range(1, self.scene.stages + 1),
            show=partial(show_quantity, table),
            shares=share_energy(self.scene, table),
            slow=speed_text(self.motion.slow, self.scene.gears, self.units) if self.motion else "",
            levers=self._name_levers(),
            closures=[
                {"closure": b.closure, "sentence": describe_use(b, self.scene.sigma)}
                for b in self.closures
            ],
            unknown=[part for part in self.missing if part.startswith("`")],
            impacts=ASSESSED_IMPACTS,
            change=PERCENT,
        )

    def _name_levers(self) -> list[dict[str, str]]:
        """The strongest levers on the energy lost, each with the way that makes it less."""
        if self.levers is None:
            return []
        known = find_parameters(self.scene)
        rows = self.levers.of(LOUDNESS).dropna(subset="effect")
        sure = rows[(rows["low"] > 0.0) | (rows["high"] < 0.0)].head(LEVERS_NAMED)
        levers = []
        for name, row in sure.iterrows():
            least, most = sorted((abs(100.0 * row["low"]), abs(100.0 * row["high"])))
            levers.append(
                {
                    "words": known[str(name)].words,
                    "way": "less" if row["effect"] > 0.0 else "more",
                    "amount": f"{number_text(least, 3)} to {number_text(most, 3)}",
                }
            )
        return levers

    def figures(self) -> "dict[str, Figure]":
        """Draw the figures of the page by name, as far as there is something to draw."""
        from rattle.compare.assess.figures import threshold_figure
        from rattle.compare.parameters.figures import tornado

        figures = {"threshold": threshold_figure(self.scene, self.thresholds)}
        if self.motion is not None and self.motion.run is not None:
            figures["speeds"] = self.motion.plot("distribution")
        if self.levers is not None:
            figures["levers"] = tornado(self.levers, [LOUDNESS, "rate_above"])
        for boundary in self.closures:
            figures[boundary.closure] = boundary.plot()
        return figures

    def to_dict(self) -> dict[str, object]:
        """Everything as plain data."""
        parts = {
            "thresholds": [t._asdict() | {"opens": t.opens} for t in self.thresholds],
            "rattles": self.rattles,
            "motion": self.table.reset_index().to_dict("records"),
            "levers": self.levers and self.levers.table.to_dict("records"),
            "closures": [boundary.to_dict() for boundary in self.closures],
        }
        facts = {"missing": self.missing, "budget": self.budget, "spent": round(self.spent, 1)}
        required = self.requirement and {
            "text": str(self.requirement),
            "fulfilment": str(self.fulfilment),
        }
        return {"answer": self.answer} | parts | facts | {"requirement": required}


def describe_use(found: Boundary, sigma: float) -> str:
    """Whether a closure can be used at a noise intensity, from where it stops holding, in words."""
    points = found.points
    accurate, wrong = (points.loc[points["verdict"] == verdict, "value"] for verdict in DECIDED)
    # beyond an edge that lies lower nothing counts
    until = accurate[accurate < wrong.min()].max() if len(wrong) else accurate.max()
    values = {"accurate": accurate, "wrong": wrong, "until": until, "sigma": sigma}
    return line(render_text("assess/use.j2", **values))
