"""Invariants of every answer, by entry point; each check returns how the entry point has ended, and
why."""

from collections.abc import Callable
from typing import Any

import fuzz_sampled
import numpy as np
from fuzz_files import command
from fuzz_must import FAINTEST, SLACK, Ended, finite, has_verdicts, must, own, refused, semidefinite

from rattle import validate
from rattle.closure import CLOSURES, MeanMap, follow, mean_map
from rattle.montecarlo import SCHEMES
from rattle.scene import RattleError, Scene, state_names
from rattle.scene.flight import field
from rattle.scene.long_orbit import LongOrbit

APART = 1e6
MAY_REFUSE = frozenset({"dt", "record.times", "start.mesh"})
"""Settings that do not suit a scene, where they are given; `published` takes no start in flight."""


def check(entry: str, data: dict[str, Any], settings: dict[str, Any]) -> Ended:
    """How an entry point ends: complete, stopped (and why), or refused (and which field)."""
    try:
        scene = Scene.from_dict(data)
    except RattleError as error:
        return refused(error, "")
    try:
        return ENTRIES[entry](scene, settings)
    except RattleError as error:
        ended, field = refused(error, "")
        asked = field not in ("dt", "record.times") or field.removeprefix("record.") in settings
        must(
            field in MAY_REFUSE and asked,
            f"refused for its {field}, although the scene is valid: {error}",
        )
        return ended, field


def round_trip(scene: Scene, settings: dict[str, Any]) -> Ended:
    """A scene is written to TOML and read back the same to the last bit."""
    again = Scene.from_toml(scene.to_toml())
    must(again == scene and repr(again) == repr(scene), "TOML changed the scene", scene)
    must(again.to_toml() == scene.to_toml(), "the text is not the same")
    must(finite(scene), "constants", scene.constants)
    must(scene.noise_free.sigma == 0.0 and scene.with_sigma(scene.sigma) == scene)
    return "complete", ""


def orbit(scene: Scene, settings: dict[str, Any]) -> Ended:
    """The deterministic orbit is causal, inside its walls, and says why it ends."""
    found = follow(scene, settings["impacts"])
    n = found.found
    walls = np.array(scene.noise_free.windows)  # a random tolerance leaves the orbit alone
    must((found.stopped == "") == (n == settings["impacts"]), "stopped", found.stopped, n)
    for numbers in (found.tau, found.before, found.after):
        must(np.isfinite(numbers[: n + 1]), "not finite", found)
    must(np.isnan(found.tau[n + 1 :]), "beyond the end", found)
    must(np.diff(found.tau[: n + 1]) >= 0.0, "time runs backwards", found.tau)
    impacts = np.arange(1, n + 1)
    struck = found.mesh[impacts] - 1
    side = found.side[impacts]
    must(found.before[impacts, 2 * struck] == side * walls[struck], "not on its wall", found)
    must(found.before[impacts, 2 * struck + 1] * side > 0.0, "not outward", found)
    places = abs(found.before[impacts, ::2])
    must(places <= walls * (1.0 + 1e-9) + 1e-14, "outside", found)
    return ("stopped", _reason(found.stopped)) if found.stopped else ("complete", "")


def long_orbit(scene: Scene, settings: dict[str, Any]) -> Ended:
    """The long orbit goes on from stretch to stretch, with finite growth."""
    orbit = LongOrbit(scene, settings.get("start", 0))
    for impacts in (settings["impacts"], 2):
        s = orbit.stretch(impacts)
        must(len(s.flight) == impacts or orbit.ended <= 0, "ended", orbit.ended)
        must(np.isfinite(s.flight) & (s.flight >= 0.0), "flight", s.flight)
        must(np.isfinite(s.before), "state", s.before)
        # minus infinity without restitution
        must(~np.isnan(s.growth) & (s.growth < np.inf), "growth", s.growth)
    return ("stopped", "orbit") if orbit.ended <= 0 else ("complete", "")


def closure(name: str) -> Callable[[Scene, dict[str, Any]], Ended]:
    """A closure gives finite numbers as far as it says that it goes, and none beyond."""

    def prediction(scene: Scene, settings: dict[str, Any]) -> Ended:
        m = mean_map(
            scene, impacts=settings["impacts"], closure=name, order=settings.get("order", 4)
        )
        n = m.trace.found
        table = m.section
        must((m.stopped == "") == (n == settings["impacts"]), "stopped", m.stopped, n)
        names = own(scene)
        found = table.iloc[:n]
        must(np.isfinite(found[names].to_numpy()), "means are not finite\n", found[names])
        must(table.iloc[n:][names].isna().to_numpy(), "numbers beyond the end\n", table[names])
        must(
            (found["flight"] >= 0.0) | ~found["realizable"], "time runs backwards", found["flight"]
        )
        meshes = set(range(-scene.stages, scene.stages + 1)) - {0}
        must(set(m.itinerary[:n]) <= meshes and set(m.itinerary[n:]) <= {0}, m.itinerary)
        sds = found[[f"sd_{q}" for q in names]]
        must(~(sds < 0.0).to_numpy() & ~np.isinf(sds.to_numpy()), "sd\n", sds)
        must(~np.isinf(found.to_numpy(float)), "infinite\n", found)
        for column, silent in _unexplained(m, n).items():
            must(~silent, "a number is missing without a reason:", column, "\n", found)
        if name in ("saltation", "corrected"):
            covariance = m.trace.covariance[1 : n + 1]
            scales = _scales(m, n)
            well = found["realizable"].to_numpy()
            semidefinite(covariance[well], scales[well])
            for k in np.flatnonzero(
                ~well & (found["flight"] >= 0.0)
            ):  # sizes too different for the digits of a float
                must(
                    scales[k].max() > APART * scales[k][scales[k] > 0.0].min(),
                    "not realizable",
                    k,
                    covariance[k],
                )
        if name != "published":
            rho = found[[f"rho{i}" for i in range(1, scene.stages + 1)]].to_numpy()
            must(
                np.isnan(rho) | (abs(rho) <= 1.0 + SLACK) | ~found[["realizable"]].to_numpy(),
                "rho",
                rho,
            )
        if name == "branching":
            share = found[["agreement", "discarded"]].to_numpy()
            must((share >= 0.0) & (share <= 1.0 + SLACK), "shares", share)
        else:
            low, high = m.trace.span
            times = scene.to_absolute_time(low + np.linspace(0.25, 0.75, 2) * (high - low))
            # a float cannot tell the times apart
            late = 0.1 * (high - low) < np.spacing(abs(times)).max()
            fixed = m.at_times(times[:0] if late else times)
            must(
                np.isfinite(fixed[[*state_names(scene.stages)]].to_numpy()),
                "moments at fixed times\n",
                fixed,
            )
        for q in names if n else ():
            density = m.density(n, q, np.array([table.loc[n, q]]))
            must(density is None or not np.isnan(density).any(), "density of", q, density)
        if m.stopped:
            return "stopped", _reason(m.stopped)
        return ("complete", "") if m.breakdown is None else ("complete", "not realizable")

    return prediction


def validation(scene: Scene, settings: dict[str, Any]) -> Ended:
    """Every row of a validation has a verdict; where there is one, numbers are behind it."""
    has_verdicts(validate(scene, **settings).table)
    return "complete", ""


def _unexplained(m: MeanMap, n: int) -> dict[str, Any]:
    """Entries of the section that are NaN, and may not be, as far as the closure goes; by column,
    shape (n,).

    ``published`` and ``corrected`` have no sds of times and no skewness, and no sd or correlation
    of a stage where its moments are not realizable; ``saltation`` has a skewness from order 3 on;
    what does not vary has none, nor has what varies so little that the cube of its sd is no float,
    and no correlation with anything; ``branching`` has no correlations.
    """
    table = m.section.iloc[:n]
    fixed = m.closure in ("published", "corrected")
    broken = ~table["realizable"].to_numpy(bool)
    skewed = m.closure == "branching" or (m.closure == "saltation" and m.order >= 3)
    missing = {}
    for q in own(m.scene):
        still = (table[f"sd_{q}"] ** 3 < FAINTEST).to_numpy()
        free = fixed and q in ("tau", "flight")
        missing[f"sd_{q}"] = table[f"sd_{q}"].isna().to_numpy() & ~(fixed & broken) & (not free)
        missing[f"skew_{q}"] = table[f"skew_{q}"].isna().to_numpy() & ~still & skewed
    for stage in range(1, m.scene.stages + 1) if m.closure != "branching" else ():
        spread = np.array(
            [np.diagonal(m.stage_covariance(k, stage)) for k in range(1, n + 1)]
        ).reshape(n, 2)
        missing[f"rho{stage}"] = table[f"rho{stage}"].isna().to_numpy() & (spread > 0.0).all(axis=1)
    return missing


def _scales(m: MeanMap, n: int) -> Any:
    """Sds of what a covariance at one time is the difference of: those at the paths' own impacts
    and of their times."""
    c = m.scene.constants
    sd = np.nan_to_num(m.trace.sd[1 : n + 1])
    rate = [
        abs(field(c, t, s))
        for t, s in zip(m.trace.tau[1 : n + 1], m.trace.mean[1 : n + 1], strict=True)
    ]
    return sd[:, 2:] + np.reshape(rate, (n, 2 * m.scene.stages)) * sd[:, :1]


def _reason(stopped: str) -> str:
    return stopped.partition(" after impact")[0]


ENTRIES: dict[str, Callable[[Scene, dict[str, Any]], Ended]] = {
    "scene": round_trip,
    "orbit": orbit,
    "long orbit": long_orbit,
    **{name: closure(name) for name in CLOSURES},
    **{name: fuzz_sampled.scheme(name) for name in SCHEMES},
    "accuracy": fuzz_sampled.accuracy,
    "validate": validation,
    "simulate a file": command("simulate"),
    "validate a file": command("validate"),
    "study a file": command("study"),
}
