"""Invariants of every answer, by entry point; each check returns how the entry point has ended, and
why."""

import fuzz_sampled
import numpy as np
from fuzz_files import command
from fuzz_must import FAINTEST, SLACK, has_verdicts, must, own, refused, semidefinite

from rattle import Scene, follow, mean_map, validate
from rattle.closure import CLOSURES
from rattle.montecarlo import SCHEMES
from rattle.scene import RattleError, state_names
from rattle.scene.flight import field
from rattle.scene.long_orbit import LongOrbit

FAR_APART = 1e6
MAY_REFUSE = frozenset({"dt", "record.times", "start.mesh"})
"""Settings that do not suit a scene, where they are given; `published` takes no start in flight."""


def check(entry, data, settings):
    """How an entry point ends: complete, stopped (and why), or refused (and which field)."""
    try:
        scene = Scene.from_dict(data)
    except RattleError as error:
        return refused(error, "")
    try:
        return ENTRIES[entry](scene, settings)
    except RattleError as error:
        ended, field = refused(error, "")
        given = field == "start.mesh" or field.removeprefix("record.") in settings
        must(field in MAY_REFUSE and given, "refused, although the scene is valid:", error)
        return ended, field


def round_trip(scene, settings):
    """A scene is written to TOML and read back the same to the last bit."""
    again = Scene.from_toml(scene.to_toml())
    must(again == scene and repr(again) == repr(scene), "TOML changed the scene")
    return "complete", ""


def orbit(scene, settings):
    """The deterministic orbit is causal, inside its walls, and says why it ends."""
    found = follow(scene, settings["impacts"])
    n = found.found
    must((found.stopped == "") == (n == settings["impacts"]), "stopped")
    for numbers in (found.tau, found.before, found.after):
        must(np.isfinite(numbers[: n + 1]), "not finite")
    must(np.diff(found.tau[: n + 1]) >= 0.0, "time runs backwards")
    walls = np.array(scene.noise_free.windows)  # a random tolerance leaves the orbit alone
    before = found.before[1 : n + 1]
    struck = np.arange(n), found.mesh[1 : n + 1] - 1
    side = found.side[1 : n + 1]
    must(before[:, ::2][struck] == side * walls[struck[1]], "not on its wall")
    must(before[:, 1::2][struck] * side > 0.0, "not outward")
    must(abs(before[:, ::2]) <= walls * (1.0 + 1e-9) + 1e-14, "outside")
    return ("stopped", _reason(found.stopped)) if found.stopped else ("complete", "")


def long_orbit(scene, settings):
    """The long orbit goes on from stretch to stretch, with finite growth; minus infinity without
    restitution."""
    orbit = LongOrbit(scene, settings.get("start", 0))
    for impacts in (settings["impacts"], 2):
        s = orbit.stretch(impacts)
        must(len(s.flight) == impacts or orbit.ended <= 0, "ended")
        must(np.isfinite(s.flight) & (s.flight >= 0.0), "flight")
        must(np.isfinite(s.before), "state")
        must(s.growth < np.inf, "growth")
    return ("stopped", "orbit") if orbit.ended <= 0 else ("complete", "")


def closure(name):
    """A closure gives finite numbers as far as it says that it goes, and none beyond."""

    def prediction(scene, settings):
        m = mean_map(scene, closure=name, **settings)
        n = m.trace.found
        names = own(scene)
        must((m.stopped == "") == (n == settings["impacts"]), "stopped")
        must(m.section.iloc[n:][names].isna(), "numbers beyond the end")
        must(0 not in m.itinerary[:n] and set(m.itinerary[n:]) <= {0}, m.itinerary)
        found = m.section.iloc[:n]
        must(np.isfinite(found[names].to_numpy()), "means are not finite")
        must(~np.isinf(found.to_numpy(float)), "infinite")
        must((found["flight"] >= 0.0) | ~found["realizable"], "time runs backwards")
        must(~(found[[f"sd_{q}" for q in names]] < 0.0), "sd")
        for column, silent in _unexplained(m, n).items():
            must(~silent, "a number is missing without a reason:", column, "\n", found)
        if name in ("saltation", "corrected"):
            _of_covariances(m, n)
        if name != "published":
            rho = found[[f"rho{i}" for i in range(1, scene.stages + 1)]].abs()
            must(~(rho[found["realizable"]] > 1.0 + SLACK), "rho")
        if name == "branching":
            share = found[["agreement", "discarded"]].to_numpy()
            must((share >= 0.0) & (share <= 1.0 + SLACK), "shares")
        else:
            _at_times(m)
        for q in names if n else ():
            density = m.density(n, q, np.array([m.section.loc[n, q]]))
            must(density is None or not np.isnan(density).any(), "density of", q, density)
        if m.stopped:
            return "stopped", _reason(m.stopped)
        return ("complete", "") if m.breakdown is None else ("complete", "not realizable")

    return prediction


def _of_covariances(m, n):
    """Covariances are semidefinite, but where sizes differ too much for the digits of a float.

    Their scales are sds of what a covariance at one time is the difference of: those at the paths'
    own impacts and of their times.
    """
    c = m.scene.constants
    found = m.section.iloc[:n]
    well = found["realizable"].to_numpy()
    sd = np.nan_to_num(m.trace.sd[1 : n + 1])
    states = zip(m.trace.tau[1 : n + 1], m.trace.mean[1 : n + 1], strict=True)
    rate = [abs(field(c, tau, state)) for tau, state in states]
    scales = sd[:, 2:] + np.reshape(rate, (n, 2 * m.scene.stages)) * sd[:, :1]
    semidefinite(m.trace.covariance[1 : n + 1][well], scales[well])
    for scale in scales[~well & (found["flight"] >= 0.0)]:
        must(scale.max() > FAR_APART * scale[scale > 0.0].min(), "not realizable")


def _at_times(m):
    """Moments at times that a float can tell apart."""
    low, high = m.trace.span
    times = m.scene.to_absolute_time(low + np.linspace(0.25, 0.75, 2) * (high - low))
    if 0.1 * (high - low) >= np.spacing(abs(times)).max():
        fixed = m.at_times(times)[[*state_names(m.scene.stages)]]
        must(np.isfinite(fixed.to_numpy()), "moments at fixed times")


def validation(scene, settings):
    """Every row of a validation has a verdict; where there is one, numbers are behind it."""
    has_verdicts(validate(scene, **settings).table)
    return "complete", ""


def _unexplained(m, n):
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
    may = {}
    for q in own(m.scene):
        may[f"sd_{q}"] = (fixed and q in ("tau", "flight")) | (fixed & broken)
        may[f"skew_{q}"] = (not skewed) | (table[f"sd_{q}"] ** 3 < FAINTEST).to_numpy()
    for stage in range(1, m.scene.stages + 1) if m.closure != "branching" else ():
        spread = [np.diagonal(m.stage_covariance(k, stage)) for k in range(1, n + 1)]
        may[f"rho{stage}"] = ~(np.reshape(spread, (n, 2)) > 0.0).all(axis=1)
    return {name: table[name].isna().to_numpy() & ~allowed for name, allowed in may.items()}


def _reason(stopped):
    return stopped.partition(" after impact")[0]


ENTRIES = {
    "scene": round_trip,
    "orbit": orbit,
    "long orbit": long_orbit,
    **{name: closure(name) for name in CLOSURES},
    **{name: fuzz_sampled.scheme(name) for name in SCHEMES},
    "accuracy": fuzz_sampled.accuracy,
    "validate": validation,
    "validate a file": command("validate"),
    "study a file": command("study"),
}
