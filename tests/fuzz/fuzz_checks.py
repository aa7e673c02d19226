"""What must hold of every answer, entry point by entry point; each check tells how the entry ended, and where."""

from collections.abc import Callable
from typing import Any

import fuzz_doors
import numpy as np

from closure import READINGS, MeanMap, follow, mean_map
from closure.long_orbit import LongOrbit
from compare import validate
from compare.moments import VERDICTS
from montecarlo import SCHEMES, simulate
from scene import Scene
from scene.errors import RattleError
from scene.flight import field
from scene.moments import SECTION, STATE

__all__ = ["ENTRIES", "check"]

APART = 1e6
MAY_REFUSE = frozenset({"dt", "clock", "start.mesh"})
"""Settings that do not suit a scene; `printed` takes no start in flight."""
SLACK = 1e-9  # of a correlation and an eigenvalue, relative: rounding
Ended = tuple[str, str]


def check(entry: str, *given: Any) -> Ended:
    """How an entry point ends: complete, stopped (and why), or refused (and which field)."""
    try:
        if entry in DOORS:
            return DOORS[entry](*given)
        scene = Scene.from_dict(given[0])
    except RattleError as error:
        return fuzz_doors.refused(error, "")
    try:
        return ENTRIES[entry](scene, given[1])
    except RattleError as error:
        ended, field = fuzz_doors.refused(error, "")
        must(field in MAY_REFUSE, f"refused for its {field}, though the door had let it in: {error}")
        return ended, field


def must(holds: Any, *what: Any) -> None:
    """An invariant; what it is about goes into the message."""
    if not np.all(holds):
        raise AssertionError(" ".join(map(str, what)))


def door(scene: Scene, settings: dict[str, Any]) -> Ended:
    """A scene goes through TOML and comes back the same to the last bit."""
    again = Scene.from_toml(scene.to_toml())
    must(again == scene and repr(again) == repr(scene), "TOML changed the scene", scene)
    must(again.to_toml() == scene.to_toml(), "the text is not the same")
    numbers = np.array(scene.constants, float)
    must(np.isfinite(numbers).all(), "constants", scene.constants)
    must(scene.noise_free.sigma == 0.0 and scene.with_sigma(scene.sigma) == scene)
    return "complete", ""


def orbit(scene: Scene, settings: dict[str, Any]) -> Ended:
    """The deterministic orbit is causal, inside its walls, and says why it ends."""
    found = follow(scene, settings["impacts"])
    n, walls = found.found, (scene.constants.wall1, scene.constants.wall2)
    must((found.stopped == "") == (n == settings["impacts"]), "stopped", found.stopped, n)
    must(np.isfinite(found.tau[: n + 1]) & np.isfinite(found.before[: n + 1]).all(axis=1), "not finite", found)
    must(np.isfinite(found.after[: n + 1]), "not finite", found)
    must(np.isnan(found.tau[n + 1 :]), "beyond the end", found)
    must(np.diff(found.tau[: n + 1]) >= 0.0, "time runs backwards", found.tau)
    for k in range(1, n + 1):
        i = found.mesh[k] - 1
        must(found.before[k, 2 * i] == found.side[k] * walls[i], "not on its wall", k, found)
        must(found.before[k, 2 * i + 1] * found.side[k] > 0.0, "not outward", k, found)
        for j in range(scene.stages):
            must(abs(found.before[k, 2 * j]) <= walls[j] * (1.0 + 1e-9) + 1e-14, "outside", j, k, found)
    return ("stopped", _reason(found.stopped)) if found.stopped else ("complete", "")


def long_orbit(scene: Scene, settings: dict[str, Any]) -> Ended:
    """The long orbit goes on from stretch to stretch, with finite growth."""
    orbit = LongOrbit(scene, settings.get("start", 0))
    for impacts in (settings["impacts"], 2):
        s = orbit.stretch(impacts)
        must(len(s.flight) == impacts or orbit.ended <= 0, "ended", orbit.ended)
        must(np.isfinite(s.flight) & (s.flight >= 0.0), "flight", s.flight)
        must(np.isfinite(s.before), "state", s.before)
        must(~np.isnan(s.growth) & (s.growth < np.inf), "growth", s.growth)  # minus infinity without restitution
    return ("stopped", "orbit") if orbit.ended <= 0 else ("complete", "")


def reading(name: str) -> Callable[[Scene, dict[str, Any]], Ended]:
    """A closure gives finite numbers as far as it says that it goes, and none beyond."""

    def closure(scene: Scene, settings: dict[str, Any]) -> Ended:
        m = mean_map(scene, impacts=settings["impacts"], reading=name, order=settings.get("order", 4))
        n, table = m.trace.found, m.section
        must((m.stopped == "") == (n == settings["impacts"]), "stopped", m.stopped, n)
        own = [q for q in SECTION if scene.stages == 2 or q not in STATE[2:]]
        told = table.iloc[:n]
        must(np.isfinite(told[own].to_numpy()), "means are not finite\n", told[own])
        must(table.iloc[n:][own].isna().to_numpy(), "numbers beyond the end\n", table[own])
        must((told["flight"] >= 0.0) | ~told["realizable"], "time runs backwards", told["flight"])
        must(set(m.itinerary[:n]) <= {-2, -1, 1, 2} and set(m.itinerary[n:]) <= {0}, m.itinerary)
        sds = told[[f"sd_{q}" for q in own]]
        must(~(sds < 0.0).to_numpy() & ~np.isinf(sds.to_numpy()), "sd\n", sds)
        must(~np.isinf(told.to_numpy(float)), "infinite\n", told)
        if name in ("saltation", "branching"):
            must(sds.notna().to_numpy(), "no sd\n", sds)
        if name in ("saltation", "mended"):
            covariance = m.trace.covariance[1 : n + 1, : 2 * scene.stages, : 2 * scene.stages]
            scales, well = _scales(m, n), told["realizable"].to_numpy()
            _semidefinite(covariance[well], scales[well])
            for k in np.flatnonzero(~well & (told["flight"] >= 0.0)):  # sizes too far apart for the digits of a float
                must(scales[k].max() > APART * scales[k][scales[k] > 0.0].min(), "not realizable", k, covariance[k])
        if name != "printed":
            rho = told[["rho1", "rho2"]].to_numpy()
            must(np.isnan(rho) | (abs(rho) <= 1.0 + SLACK) | ~told[["realizable"]].to_numpy(), "rho", rho)
        if name == "branching":
            share = told[["agreement", "lost"]].to_numpy()
            must((share >= 0.0) & (share <= 1.0 + SLACK), "shares", share)
        else:
            low, high = m.trace.span
            times = scene.stated(low + np.linspace(0.25, 0.75, 2) * (high - low))
            late = 0.1 * (high - low) < np.spacing(abs(times)).max()  # a float cannot tell the times apart
            clock = m.clock(times[:0] if late else times)
            must(np.isfinite(clock[[*STATE[: 2 * scene.stages]]].to_numpy()), "clock\n", clock)
        for q in own if n else ():
            density = m.density(n, q, np.array([table.loc[n, q]]))
            must(density is None or not np.isnan(density).any(), "density of", q, density)
        if m.stopped:
            return "stopped", _reason(m.stopped)
        return ("complete", "") if m.breakdown is None else ("complete", "not realizable")

    return closure


def scheme(name: str) -> Callable[[Scene, dict[str, Any]], Ended]:
    """A simulation is the same on any number of workers, and its statistics belong to distributions."""

    def ensemble(scene: Scene, settings: dict[str, Any]) -> Ended:
        given = {"scheme": name, "keep_paths": True} | settings
        run = simulate(scene, **given)
        if settings["paths"] > 1024:
            other = simulate(scene, **given, workers=2)
            for column, values in run.columns.items():
                must(_same(values, other.columns[column]), "workers change", column)
        table, impacts = run.section, settings["impacts"]
        own = [q for q in SECTION if scene.stages == 2 or q not in STATE[2:]]
        reached = table["paths"].to_numpy()
        must(np.diff(reached) <= 0, "paths", reached)
        must(reached[-1] + run.unfinished == settings["paths"], "unfinished", run.unfinished, reached)
        means = table[own].to_numpy()
        must(np.isfinite(means[reached > 0]), "means are not finite\n", table[own])
        must(np.isnan(means[reached == 0]), "means of nothing\n", table[own])
        sds = table[[f"sd_{q}" for q in own]].to_numpy()
        must(np.isfinite(sds[reached > 1]) & (sds[reached > 1] >= 0.0), "sds\n", sds)
        errors = table[[f"se_{q}" for q in own]].to_numpy()
        must(np.isfinite(errors[reached > 1]) & (errors[reached > 1] >= 0.0), "errors\n", errors)
        must(~np.isinf(table.to_numpy(float)), "infinite\n", table.T)
        must((table["agreement"] >= 0.0) & (table["agreement"] <= 1.0), "agreement", table["agreement"])
        must(table["agreement"].diff().dropna() <= 0.0, "agreement rises", table["agreement"])
        rho = table[["rho1", "rho2"]].to_numpy()
        must(np.isnan(rho) | (abs(rho) <= 1.0 + SLACK), "rho", rho)
        for k in range(impacts):
            if reached[k] > 1:
                _semidefinite(run.covariance[k : k + 1, : 1 + 2 * scene.stages, : 1 + 2 * scene.stages])
        raw = np.asarray(run.raw)
        _paths(scene, raw[..., [0, 1, 2, 3, 6]] if scene.stages == 1 else raw)
        if "energy" in table:
            must(table["energy"].isna() | (table["energy"] >= 0.0), "energy", table["energy"])
        if settings.get("step_bias"):
            must(~np.isinf(run.step_bias["bias"].to_numpy()), "bias")
        if len(settings.get("clock", ())):
            clock = run.clock()
            must(np.isfinite(clock[[*STATE[: 2 * scene.stages]]].to_numpy()), "clock\n", clock)
        return ("stopped", "unfinished paths") if run.unfinished else ("complete", "")

    return ensemble


def _paths(scene: Scene, raw: Any) -> None:
    """Every path is causal and inside the widest its walls may be."""
    tau, flight, code = raw[..., 0], raw[..., 1], raw[..., -1]
    there = ~np.isnan(tau)
    must(there[:, 1:] <= there[:, :-1], "a path comes back")
    must(np.isfinite(raw[there]), "a path is not finite")
    must(flight[there] >= 0.0, "a flight runs backwards")
    must(np.isin(code[there], (-2, -1, 1, 2)), "itinerary")
    c, at_rest = scene.tolerance, scene.phase
    must(tau[there] >= at_rest, "before the start")
    for i in range(scene.stages):
        most = scene.windows[i] if c else (scene.gap1, scene.gap2)[i]
        x, y = raw[..., 2 + 2 * i][there], raw[..., 3 + 2 * i][there]
        hit = abs(code[there]) == i + 1
        must(abs(x[hit]) <= most * (1.0 + SLACK), "beyond the widest wall", most, x[hit])
        must(y[hit] * code[there][hit] >= 0.0, "not outward")


def validation(scene: Scene, settings: dict[str, Any]) -> Ended:
    """Every row of a validation has a verdict; where there is one, numbers are behind it."""
    found = validate(scene, **settings)
    table = found.table
    must(table["verdict"].isin(VERDICTS), table["verdict"].unique())
    judged = table[table["verdict"].isin(["accurate", "inaccurate"])]
    must(np.isfinite(judged[["closure", "monte_carlo", "error", "low", "high"]].to_numpy()), "judged\n", judged.T)
    must(judged["low"] <= judged["high"], "interval")
    must((table["agreement"].dropna() >= 0.0) & (table["agreement"].dropna() <= 1.0), "agreement")
    return "complete", ""


def _scales(m: MeanMap, n: int) -> Any:
    """Sds of what a covariance at one time is the difference of: those at the paths' own impacts and of their times."""
    c, sd = m.scene.constants, np.nan_to_num(m.trace.sd[1 : n + 1])
    rate = [abs(field(c, t, s[1], s[3])) for t, s in zip(m.trace.tau[1 : n + 1], m.trace.mean[1 : n + 1], strict=True)]
    return (sd[:, 2:] + np.reshape(rate, (n, 4)) * sd[:, :1])[:, : 2 * m.scene.stages]


def _semidefinite(covariance: Any, scales: Any = None) -> None:
    for k, matrix in enumerate(covariance):
        must(np.isfinite(matrix), "covariance is not finite", matrix)
        scale = np.sqrt(np.abs(np.diagonal(matrix))) if scales is None else scales[k]
        scale = np.where(scale > 0.0, scale, 1.0)
        shape = matrix / scale / scale[:, None]  # as correlations: a small stage counts as much as a large one
        must(np.linalg.eigvalsh(shape)[0] >= -SLACK, "covariance is not semidefinite", matrix, shape)


def _same(a: Any, b: Any) -> bool:
    return bool(np.array_equal(np.asarray(a), np.asarray(b), equal_nan=np.asarray(a).dtype.kind == "f"))


def _reason(stopped: str) -> str:
    return stopped.partition(" after impact")[0]


DOORS: dict[str, Callable[..., Ended]] = {
    "spoilt scene": fuzz_doors.spoilt, "setting": fuzz_doors.setting, "text": fuzz_doors.text,
    "command": fuzz_doors.command, "file": fuzz_doors.file,
}  # fmt: skip
"""What takes something bad."""

ENTRIES: dict[str, Callable[[Scene, dict[str, Any]], Ended]] = {
    "door": door, "orbit": orbit, "long orbit": long_orbit,
    **{name: reading(name) for name in READINGS}, **{name: scheme(name) for name in SCHEMES}, "validate": validation,
}  # fmt: skip
