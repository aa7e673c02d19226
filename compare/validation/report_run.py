"""A report of a validation in the making: judged at its own noise intensities and written, then
over the range of validity and beside other schemes, and written again."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rattle.closure import closures_for
from rattle.closure.mean_map import find_closures, predict
from rattle.compare.report.folder import check_free, report_files
from rattle.compare.report.interrupt import stored
from rattle.compare.report.json_text import Facts
from rattle.compare.report.manifest import ReportSettings
from rattle.compare.report.provenance import Stopwatch, command_line, provenance
from rattle.compare.validation.answer import UNFINISHED, answer, describe_left_out
from rattle.compare.validation.page import draw_sections, write_report
from rattle.compare.validation.validate import (
    check_sweep,
    compare_schemes,
    count_work,
    sweep,
    validate,
)
from rattle.montecarlo import SCHEMES, check_settings, default_step
from rattle.scene import Scene, choice

HAVE_BIAS = tuple(name for name, scheme in SCHEMES.items() if scheme.has_step_bias)


def settle(
    name: str,
    scenes: Sequence[Scene],
    *,
    scheme: str,
    dt: float | None,
    closures: Sequence[str],
    **asked: Any,
) -> ReportSettings:
    """The settings of a report with the defaults filled in: the step, and the closures."""
    if dt is None:
        dt = min(default_step(scene, scheme, scheme in HAVE_BIAS) for scene in scenes)
    return ReportSettings(
        name=name,
        scenes=tuple(scenes),
        scheme=scheme,
        dt=dt,
        closures=tuple(closures) or closures_for(scenes[0]),
        **asked,
    )


class ReportRun:
    """A report in the making.

    `out`: Its folder. `overwrite`: Whether an earlier report there is replaced.
    """

    def __init__(self, settings: ReportSettings, out: Path, overwrite: bool, workers: int) -> None:
        self.settings = settings
        self.out = out
        self.overwrite = overwrite
        self.workers = workers
        self.page = out / "report.html"
        self.predictions: Facts = {"closures": settings.closures, "order": settings.order}
        self.swept: Any = None  # the range of validity, once it has been measured
        self.schemes: Any = None  # the table of the other schemes
        self._check()
        self.watch = Stopwatch()

    def _check(self) -> None:
        """Refuse what cannot be computed or written, before anything is simulated."""
        settings = self.settings
        methods = find_closures("closures", settings.closures)
        check_free(self.out, report_files("report"), self.overwrite)
        biased = SCHEMES[choice("scheme", settings.scheme, SCHEMES)].has_step_bias
        for scene in settings.scenes:
            check_settings(scene, **settings.simulation, workers=self.workers, step_bias=biased)
        first = settings.scenes[0]
        swept = [first.with_sigma(sigma) for sigma in settings.validity]
        for scene in (*settings.scenes[1:], *swept):
            for method in methods:
                if method.own:  # what it returns is checked
                    predict(scene, method, settings.impacts, settings.order)
        check_sweep(first, settings.validity, **settings.sweep, workers=self.workers)

    def judge(self) -> list[str]:
        """Compare the closures with a simulation at each of the scenes' own noise intensities;
        returns the answer."""
        self.validations = [
            validate(
                scene,
                **self.settings.simulation,
                **self.predictions,
                workers=self.workers,
                progress=f"sigma {scene.sigma:.4g}",
            )
            for scene in self.settings.scenes
        ]
        self.sentences = answer(self.validations)
        return self.sentences

    def draw(self) -> None:
        """Draw the figures of the scenes' own noise intensities."""
        self.drawn = draw_sections(self.validations)

    @property
    def goes_on(self) -> bool:
        """Whether more is measured than the answer at the scenes' own noise intensities."""
        return bool(self.settings.validity or self.settings.beside)

    def write_first(self) -> None:
        """Write the page without what is still to be measured, so that an interrupt loses
        nothing."""
        unfinished = [UNFINISHED] if self.settings.validity else []
        at_once = self.settings._replace(validity=(), validity_paths=0, beside=())
        self._write(at_once, self.sentences + unfinished)
        self.overwrite = True
        stored.append(lambda: f"the page is written, without the range of validity: {self.page}")

    def sweep(self, budget: float) -> None:
        """Measure the range of validity over the noise intensity, within what the noise intensities
        of the scenes have left of a budget."""
        judged = sum(count_work(v) for v in self.validations)
        swept = sweep(
            self.settings.scenes[0],
            self.settings.validity,
            **self.settings.sweep,
            **self.predictions,
            workers=self.workers,
            budget=budget - judged,
        )
        self.swept = swept._replace(all_work=swept.all_work + judged)
        measured = tuple(sorted(self.swept.validity["sigma"].unique()))
        self.settings = self.settings._replace(validity=measured)
        left_out = describe_left_out(self.swept, budget)
        self.sentences = answer(self.validations, self.swept) + left_out

    def write(self) -> Facts:
        """Measure the other schemes that are shown beside, and write the page; returns its
        manifest."""
        beside = self.settings.beside
        if beside:
            self.schemes = compare_schemes(self.validations, beside, self.workers)
        return self._write(self.settings, self.sentences)

    def _write(self, settings: ReportSettings, sentences: list[str]) -> Facts:
        repeat = ["validate", "--repeat", str(self.out / "manifest.json")]
        return write_report(
            self.out,
            settings,
            self.validations,
            self.swept,
            sentences,
            self.drawn,
            {"repeat": command_line(repeat)} | provenance(self.watch),
            self.overwrite,
            self.schemes,
        )
