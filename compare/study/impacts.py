"""Studies of the impacts: closures against ensembles, at each point of a grid; the kind ``impacts``."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from rattle.closure import CLOSURES
from rattle.closure.mean_map import ORDERS
from rattle.compare.study.axes import SETTINGS
from rattle.compare.study.cells import Prediction, Sample
from rattle.compare.study.design import Kind, Study
from rattle.compare.study.results import combine
from rattle.compare.study.tables import TABLES, Tables
from rattle.compare.validation.verdict import Tolerances
from rattle.montecarlo import SCHEMES, check_settings, default_step
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import check_keys, choice, count, positive


def read(given: Mapping[str, Any], varying: set[str]) -> dict[str, Any]:
    """Read the fields of `Study` that ``[study]`` gives."""
    settings = {name: given[name] for name in SETTINGS if name in given}
    _check_settings(settings, varying)
    return {
        "closures": _closures(given.get("closures", tuple(CLOSURES))),
        "impacts": count("study.impacts", given.get("impacts", 12)),
        "order": count("study.order", given.get("order", 4), *ORDERS),
        "settings": settings,
        "common_noise": _flag("study.common_noise", given.get("common_noise", True)),
        "within": _within(given.get("within", {})),
    }


def cells(
    study: Study, scene: Scene, settings: dict[str, Any]
) -> tuple[Sample | None, tuple[Prediction, ...], dict[str, str]]:
    """The ensemble of a point, the predictions of the closures that cover its scene, and what cannot be computed.

    Without common noise the seed is a digest of the point.
    """
    seed = settings.pop("seed", 0)
    reasons: dict[str, str] = {}
    sample, predictions = None, []
    try:
        sample = _check_sample(Sample(scene, study.impacts, seed, **settings))
        if not study.common_noise:
            own = hashlib.sha256(f"{sample.key} {seed}".encode()).digest()
            sample = replace(sample, seed=int.from_bytes(own[:8], "little"))
    except InputError as error:
        reasons["sample"] = str(error)
    for closure in study.closures:
        try:
            CLOSURES[closure].check(scene)
            predictions.append(Prediction(scene, study.impacts, closure, study.order))
        except InputError as error:
            reasons[closure] = str(error)
    return sample, tuple(predictions), reasons


def _check_sample(sample: Sample) -> Sample:
    scheme = choice("scheme", sample.scheme, SCHEMES)
    kind = SCHEMES[scheme]
    if sample.accuracy is not None:
        positive("accuracy", sample.accuracy)
    biased = kind.has_step_bias
    dt = default_step(sample.scene, scheme, biased) if sample.dt is None else sample.dt
    check_settings(
        sample.scene,
        paths=1 if sample.paths is None else sample.paths,
        impacts=sample.impacts,
        dt=dt,
        scheme=scheme,
        rng=sample.seed,
        workers=1,
        step_bias=biased,
    )
    return sample


def _check_settings(settings: Mapping[str, Any], varying: set[str]) -> None:
    for name in settings:
        if name in varying:
            raise InputError(f"study.{name}", settings[name], "varies along an axis too; keep one")
    known = set(settings) | varying
    if ("paths" in known) == ("accuracy" in known):
        raise InputError("study.paths", settings.get("paths"), "give either paths or accuracy")
    if "accuracy" in known and "dt" in known:
        raise InputError("study.dt", settings.get("dt"), "accuracy chooses the step itself; leave it out")


def _closures(given: Any) -> tuple[str, ...]:
    if isinstance(given, str) or not isinstance(given, Sequence) or not given:
        raise InputError("study.closures", given, "give a list of " + ", ".join(CLOSURES))
    return tuple(dict.fromkeys(choice("study.closures", r, CLOSURES) for r in given))


def _flag(field: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError(field, value, "give true or false")
    return value


def _within(given: Any) -> Tolerances:
    if not isinstance(given, Mapping):
        raise InputError("study.within", given, "write it as a table: within = { mean = 0.05, sd = 0.10 }")
    check_keys("study.within", given, Tolerances._fields)
    return Tolerances(**{name: positive(f"study.within.{name}", value) for name, value in given.items()})


KIND = Kind(
    title="study",
    keys=("impacts", "closures", "order", *SETTINGS, "common_noise", "within"),
    tables=TABLES,
    small=("correlation", "validity", "cost", "reasons"),
    read=read,
    cells=cells,
    make=Tables,
    combine=combine,
    page="rattle.compare.study.impacts_page",
)
