"""Studies of the long run, at each point of a grid; the kind ``stationary``."""

from collections.abc import Mapping
from typing import Any

from rattle.compare.stationary.cell import LongCell
from rattle.compare.stationary.study_tables import TABLES, LongTables, combine
from rattle.compare.stationary.verdicts import CLOSURES_JUDGED
from rattle.compare.study.design import Kind, Study
from rattle.compare.study.tables import load_study as load
from rattle.compare.validation.verdict import Tolerances
from rattle.montecarlo import check_settings
from rattle.montecarlo.long_run.run import PATHS
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import choice, count, positive

__all__ = ["KIND", "load"]  # earlier pages say that `load` loads a study of the long run

SETTINGS = ("accuracy", "periods", "paths", "burn_in", "slow", "seed")


def read(given: Mapping[str, Any], varying: set[str]) -> dict[str, Any]:
    """Read the fields of `Study` that ``[study]`` gives."""
    settings = {name: given[name] for name in SETTINGS if name in given}
    for name in varying & {"scheme", "dt", *settings}:
        raise InputError(f"study.{name}", name, "cannot vary in a study of the long run, or varies twice")
    return {
        "closures": _closures(given.get("closures", tuple(CLOSURES_JUDGED))),
        "impacts": 1,
        "order": 2,
        "settings": settings,
        "common_noise": True,
        "within": Tolerances(),
    }


def cells(study: Study, scene: Scene, settings: dict[str, Any]) -> tuple[LongCell | None, tuple[()], dict[str, str]]:
    """The long run of a point, or why it cannot be computed."""
    try:
        cell = LongCell(scene, settings.pop("seed", 0), study.closures, **settings)
        _check(cell)
    except InputError as error:
        return None, (), {"sample": str(error)}
    return cell, (), {}


def _closures(given: Any) -> tuple[str, ...]:
    if isinstance(given, str | Mapping) or not hasattr(given, "__iter__"):
        raise InputError("study.closures", given, "give a list of " + ", ".join(CLOSURES_JUDGED))
    return tuple(dict.fromkeys(choice("study.closures", name, CLOSURES_JUDGED) for name in given))


def _check(cell: LongCell) -> None:
    """Refuse settings that could not be run."""
    if cell.accuracy is not None:
        positive("accuracy", cell.accuracy)
        if cell.periods is not None:
            raise InputError("periods", cell.periods, "is chosen by accuracy; leave out one of them")
    if cell.periods is not None:
        count("periods", cell.periods, least=64)
    count("paths", cell.paths, least=16)
    positive("slow", cell.slow)
    check_settings(
        cell.scene, paths=PATHS, impacts=1, dt=None, scheme="exact-flight", rng=cell.seed, workers=1, step_bias=False
    )


KIND = Kind(
    title="study of the long run",
    keys=("closures", *SETTINGS),
    tables=TABLES,
    small=("cost", "reasons"),
    read=read,
    cells=cells,
    make=LongTables,
    combine=combine,
    page="rattle.compare.stationary.study_page",
)
