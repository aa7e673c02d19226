"""Invariants of every simulation: shares, spreads, times, walls, and no number missing without a
reason.

Without noise every exact flight is that of Eq. 3.  Each is judged by itself, from where the path
was at the impact before: what one flight leaves, the next makes worse by as much as the orbit is
unstable, and that is no error of the scheme.
"""

import warnings

import numpy as np
from fuzz_must import FAINTEST, SLACK, must, own, semidefinite
from settings import recorded

from rattle import Tolerance, simulate, simulate_to
from rattle.scene.flight import flow, wheel_speeds
from rattle.scene.impact import strike

OVERSHOOTS = ("euler-maruyama",)
"""Schemes that detect walls at the end of a step only, so that a stage may be left beyond its wall
there."""
CORRELATION = 1.0 + 1e-12
FEWEST_PATHS = {"": (2, 0, 0), "sd_": (3, 0, 2), "skew_": (3, 3, 6), "kurt_": (4, 4, 8)}
"""Fewest paths for the standard error of a moment; powers of the sd that divide the moment, and its
error."""


def scheme(name):
    """The statistics of a simulation belong to distributions, its paths to the scene."""

    def ensemble(scene, settings):
        run = simulate(scene, **recorded({"scheme": name, "raw": True} | settings))
        must(run.paths == settings["paths"], "paths")
        of_an_ensemble(run)
        if settings.get("step_bias"):
            must(~np.isinf(run.step_bias["bias"].to_numpy()), "bias")
        of_its_paths(scene, np.asarray(run.raw), name)
        follows_the_flow(run)
        return ("stopped", "unfinished paths") if run.unfinished else ("complete", "")

    return ensemble


def accuracy(scene, settings):
    """An accuracy is reached, or what was reached and what is missing is said."""
    with warnings.catch_warnings(record=True, action="always") as said:
        run = simulate_to(scene, **recorded(settings))
    of_an_ensemble(run)
    reach = run.reach
    assert reach is not None
    for warning in said:  # that it is not reached is worth a warning, and nothing else is
        must(not reach.reached and "ccuracy" in str(warning.message), "warns", warning)
    # infinitely many seconds, where no time suffices
    seconds = [reach.more_seconds, *(c.core_seconds for c in reach.candidates)]
    must(np.array([reach.sampling, reach.step, *seconds]) >= 0.0, "reach")
    must(np.isfinite([reach.sampling, reach.step]), "reach")
    must(("NOT" in reach.sentence) != reach.reached, "sentence")
    must(is_random(scene) or run.plan.paths == 1, "identical paths are computed")
    return ("complete", "") if reach.reached else ("stopped", "budget")


def is_random(scene):
    """Whether paths differ."""
    return scene != scene.noise_free


def of_an_ensemble(run):
    """All tables of an ensemble."""
    reached = run.section["paths"].to_numpy()
    _shares(run, reached)
    _moments(run, reached)
    _in_time(run, reached)
    _at_times(run)
    must(bool(run.diagnostics) or not run.unfinished, "no diagnostic of")


def _shares(run, reached):
    """Paths that have an impact, and those of them that agree, grow fewer."""
    must((reached >= 0) & (np.diff(reached, prepend=run.paths) <= 0), "paths")
    must(reached[-1] + run.unfinished == run.paths, "unfinished")
    share = np.column_stack([run.section["agreement"], run.agreement])
    most = reached[:, None] / run.paths * (1.0 + 1e-12)
    must((share >= 0.0) & (share <= most), "more agree than are there")
    must(np.diff(share, axis=0) <= 0.0, "agreement rises")


def _moments(run, reached):
    table = run.section
    names = own(run.scene)
    must(~np.isinf(table.to_numpy(float)), "infinite")
    for prefix in ("sd_", "se_", "se_sd_", "se_skew_", "se_kurt_"):
        must(~(table[[prefix + q for q in names]] < 0.0), "a negative spread")
    rho = table[[f"rho{i}" for i in range(1, run.scene.stages + 1)]].to_numpy()
    must(np.isnan(rho) | (abs(rho) <= CORRELATION), "rho")
    for name, silent in unexplained(run).items():
        must(~silent, "a number is missing without a reason:", name, "\n", table[name])
    semidefinite(run.covariance[reached > 1])
    if "energy" in table:
        must(~(table["energy"] < 0.0), "energy")


def _at_times(run):
    fixed = run.at_times()
    must(~np.isinf(fixed.to_numpy(float)), "an infinite number at a time")
    for s in range(1, run.scene.stages + 1) if len(fixed) else ():
        variances = fixed[[f"cov_x{s}_x{s}", f"cov_y{s}_y{s}"]]
        needed = fixed[[f"x{s}", f"y{s}", f"cov_x{s}_y{s}"]].join(variances)
        must(needed.notna(), "no moment at a time")
        varies = variances.prod(axis=1) > FAINTEST
        must(fixed.loc[varies, f"rho{s}"].abs() <= CORRELATION, "no correlation")


def unexplained(run):
    """Entries of the section that are NaN, and may not be; by column, shape (impacts,).

    A number may be missing where nothing has it (a second stage of a single one; an impact that no
    path had, which ``paths`` tells), a standard error where so few paths of a random scene have the
    impact that they tell none (`FEWEST_PATHS`), a skewness, kurtosis, their errors and a
    correlation where a quantity does not vary (its sd is 0), or so little that the power of the sd
    that divides them is no float.
    """
    table = run.section
    paths = table["paths"].to_numpy()
    few = [is_random(run.scene) & (paths < least) for least in range(5)]
    sd = np.sqrt(np.nan_to_num(run.result.sums["section"].moment(2, 0)))
    may = dict.fromkeys(("mesh", "side", "agreement", "paths"), few[0])
    for i, q in enumerate(own(run.scene)):
        for prefix, (least, power, se_power) in FEWEST_PATHS.items():
            may[prefix + q] = sd[:, i] ** power <= FAINTEST
            may["se_" + prefix + q] = few[least] | (sd[:, i] ** se_power <= FAINTEST)
    for stage in range(1, run.scene.stages + 1):
        may[f"rho{stage}"] = (sd[:, [2 * stage, 2 * stage + 1]] == 0.0).any(axis=1)
    if "energy" in table:
        may |= {"energy": few[0], "se_energy": few[2]}
    return {
        name: table[name].isna().to_numpy() & (paths > 0) & ~allowed
        for name, allowed in may.items()
    }


def _in_time(run, reached):
    """The mean time of impacts that the same paths have increases, by the mean flight."""
    columns = run.phase_reduced.columns  # with all their digits
    tau = columns["tau"]
    flight = columns["flight"]
    same = (reached[1:] == reached[:-1]) & (reached[1:] > 0)
    must(~(same & (np.diff(tau) < -1e-12 * abs(tau[1:]))), "impacts run backwards")
    must(~(flight < 0.0), "a mean flight below 0")
    if "control" in run.result.sums:
        return
    apart = abs(np.diff(tau) - flight[1:]) > 1e-9 * flight[1:] + 1e-12 * abs(tau[1:])
    must(~(same & apart), "times and flights")


def of_its_paths(scene, raw, name):
    """Every path is causal and inside the widest its walls may be, on a wall where it strikes
    one."""
    there = ~np.isnan(raw[..., 0])
    must(there[:, 1:] <= there[:, :-1], "a path comes back")
    tau, flight, *state, code = raw[there].T
    must(np.isfinite(raw[there]), "a path is not finite")
    must(flight >= 0.0, "a flight runs backwards")
    must(tau >= scene.phase, "before the start")
    must(np.isin(abs(code), range(1, scene.stages + 1)), "itinerary")
    tolerance = scene.tolerance or Tolerance()
    for i, wheel in enumerate(scene.tree):
        most = wheel.gap + wheel.tolerance
        least = most if tolerance.distribution == "fixed" else most - 2.0 * wheel.tolerance
        hit = abs(code) == i + 1
        away = abs(state[2 * i])
        must(away[hit | (name not in OVERSHOOTS)] <= most * (1.0 + SLACK), "beyond its wall")
        must(away[hit] >= least * (1.0 - SLACK) - 1e-15 * most, "not on a wall")
        must((state[2 * i + 1] * code)[hit] >= 0.0, "not outward")


# paths, flights of each, and times in a flight that are checked
CHECKED_PATHS = 3
FLIGHTS = 8
INSTANTS = 16
CLOSE = 1e-7  # admissible error, relative to gap and speed


def follows_the_flow(run):
    """Compare the first exact flights of the first paths of a run without noise with the flow."""
    scene = run.scene
    if run.scheme != "exact-flight" or scene.sigma > 0.0 or run.sticking_steps:
        return
    known = scene.tolerance is None or scene.tolerance.distribution == "fixed"
    for rows in np.asarray(run.raw)[:CHECKED_PATHS]:
        before = (scene.phase, scene.start_state, scene.start.mesh) if known else None
        for tau, flight, *end, code in rows[~np.isnan(rows[:, 0])][:FLIGHTS]:
            state = np.array(end)
            if before is not None:
                _one_flight(scene, before, flight, state)
            before = (tau, state, int(abs(code)))


def _one_flight(scene, before, flight, end):
    c = scene.constants
    tau, state, mesh = before
    # what came later in the same step had begun at these speeds
    met = abs(state[1::2]).sum()
    if mesh:
        state = state.copy()
        strike(c, mesh, state)
    pull = c.wheels["beta"] * abs(wheel_speeds(c, tau, state)) + c.wheels["gamma"]
    # largest acceleration
    driven = c.wheels[c.wheels["parent"] < 0]
    drawn = c.alpha * np.hypot(driven["second"], driven["first"]).max()
    drawn += (1.0 + c.wheels["ratio"].max()) * pull.max()
    speed = max(abs(state[1::2]).sum(), met) + drawn * flight
    blurred = 4.0 * np.spacing(abs(tau) + flight)  # of a flight that is the difference of two times
    wrong_x = (CLOSE * flight + blurred) * speed
    walls = np.array(scene.windows)
    off = abs(flow(c, tau, state, flight) - end)
    must(off[::2] <= wrong_x + CLOSE * walls, "a displacement leaves the flow")
    must(off[1::2] <= CLOSE * speed + blurred * drawn, "a speed leaves the flow")
    for t in np.linspace(0.0, flight, INSTANTS + 1)[:-1]:
        place = abs(flow(c, tau, state, t))[::2]
        must(place <= walls * (1.0 + CLOSE) + wrong_x, "flew through a wall")
