"""Chaos from Python: what ``rattle chaos`` measures, with its answer, its tables and its page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from rattle.compare.chaos.effort import CHAOS_BUDGET, Effort
from rattle.compare.chaos.measure import ChaosStudy, study
from rattle.compare.chaos.page import answer, chaos_tables, make_report
from rattle.compare.chaos.sweep import vary
from rattle.compare.report.folder import name_of
from rattle.compare.report.provenance import provenance
from rattle.compare.report.save import save
from rattle.montecarlo.looks import begin_budget
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.scene import Scene, as_html, check_scene, compile_ahead
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import print_on_stderr


@numpy_defaults
@dataclass(frozen=True, repr=False)
class Chaos(ChaosStudy):
    """Measurements of a scene's chaos, from `chaos`.

    Attributes
    ----------
    scene : Scene
        What was modelled.
    orbit, drift : Exponents
        Lyapunov exponents of the noise-free orbit, and of the linearised drift along a noisy path:
        ``value`` and ``half``, the half width of its 95 % interval.
    maps : DataFrame
        Each closure as a map: its exponents, and where it breaks down.
    sections, spectra : dict
        Poincare sections and power spectra, by what they are of.
    law, finite_size : SqrtLaw or None, DataFrame or None
        Of two paths on the same noise: the square-root law, and the finite-size exponents.
    field, sweep, view : str, DataFrame or None, Bifurcation or None
        What was varied, with the exponents and the bifurcation diagram over it.
    missing : dict of str to str
        What the motion does not have, with the reason.
    reduced : str
        What the budget has made smaller than asked for, as a sentence.

    Examples
    --------
    >>> from rattle import DAT21, Scene, chaos
    >>> few = {"points": 1000, "impacts": 20_000, "events": 128, "width": 0.2}
    >>> found = chaos(Scene.from_gears(DAT21, sigma=0.1), **few)
    >>> sorted(found.tables)[:3]
    ['exponents', 'fsle', 'lines']
    """

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """All tables, by the names of the files that ``report`` writes."""
        return chaos_tables(self)

    @property
    def answer(self) -> list[str]:
        """In sentences."""
        return answer(self, self.tables)

    def __repr__(self) -> str:
        """The first sentences of the answer."""
        return "\n  ".join([f"Chaos at sigma = {self.scene.sigma:.4g}", *self.answer[:2]])

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.tables["exponents"].to_html())

    def report(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write page, figures and tables, as ``rattle chaos`` does.

        Parameters
        ----------
        folder : str or Path
            Where to; made if it is missing.
        overwrite : bool
            Whether an earlier report there may be replaced.

        Returns
        -------
        Path
            The page, ``chaos.html``.

        Raises
        ------
        OutputError
            If the folder holds other files, or an earlier report that may not be replaced.
        """
        out = Path(folder)
        here = "chaos(...).report(...), in Python"
        record = {
            "name": name_of(out),
            "scene": self.scene.to_dict(),
            "field": self.field,
            **provenance(),
            "wall_seconds": None,
            "cpu_seconds": None,
            "command": here,
            "repeat": here,
        }
        save(out, make_report(self, record), overwrite)
        return out / "chaos.html"


@numpy_defaults
def chaos(
    scene: Scene,
    *,
    over: Sequence[float] = (),
    field: str = "alpha",
    width: float = 0.01,
    points: int = 1_000_000,
    impacts: int = 200_000,
    events: int = 4000,
    budget: float | None = CHAOS_BUDGET,
    rng: Rng = 0,
    workers: int = 1,
    folder: str | Path | None = None,
    progress: bool = False,
) -> Chaos:
    """Measure chaos in the motion of a scene: Lyapunov exponents, Poincare sections, spectra.

    Parameters
    ----------
    scene : Scene
        What is modelled; with `Scene.sigma` 0 there is no noisy path.
    over : sequence of float
        Values of `field`, over which the exponents and a bifurcation diagram are measured too; none
        by default.
    field : str
        A field of the scene, or a value of its gears (``backlash1``).
    width : float
        Widest 95 % interval of a largest exponent; a wider one is reported as it is.
    points : int
        Points of each Poincare section, 100 or more.
    impacts : int
        Impacts of the spectra, 20,000 or more.
    events : int
        Pairs of paths behind each figure of two paths on the same noise, 128 or more.
    budget : float, optional
        Seconds of processor time, all threads together; compiling is not counted.  What does not
        fit is made smaller by counted work: fewer points, impacts, pairs and values, and wider
        intervals.  None for no limit.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed; a generator of numpy gives a child of its seed sequence, another one each time.
    workers : int
        Threads; the result does not depend on it.
    folder : path, optional
        Where results over `field` are stored: the same call continues there after an interruption.
    progress : bool
        Whether each part is named on standard error as it begins.

    Returns
    -------
    Chaos
        Its ``answer`` in sentences, its ``tables``, and ``report`` to write a page.

    Raises
    ------
    InputError
        For an unknown field, a value that no scene can have, or too few points.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> few = {"points": 1000, "impacts": 20_000, "events": 128, "width": 0.2}
    >>> found = chaos(Scene.from_gears(DAT21, sigma=0.1), **few)
    >>> bool(found.orbit.largest[0] > 0.0)
    True
    """
    check_scene(scene)
    compile_ahead.expect("chaos", len(scene.drive))
    scenes = vary(scene, field, over)
    seconds = begin_budget(budget).seconds
    seed = read_whole_seed(rng)
    effort = Effort(points, impacts, events, width, seed, workers, seconds).check()
    say = print_on_stderr if progress else str
    result = study(scene, scenes, field, effort, say, None if folder is None else Path(folder))
    return Chaos(**vars(result))
