"""Spectra by Welch's method with a chi-square band, and their lines and floor, measured.

References
----------
Welch, "The use of fast Fourier transform for the estimation of power spectra" (1967).
Percival and Walden, "Spectral analysis for physical applications" (1993), section 6.17: the degrees of freedom of
overlapping segments.
"""

import math
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import ndimage, signal, stats

from rattle.closure.long_orbit import velocities
from rattle.compare.chaos.record import Regime, check_finite, noisy_record, orbit_record
from rattle.compare.chaos.section import NOISY, ORBIT
from rattle.montecarlo.coupling.dyadic import clockwork
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import count

__all__ = ["FALSE_ALARM", "SEQUENCE", "TIME", "Spectrum", "spectra", "spectra_tables", "welch"]

Floats = NDArray[np.float64]

SEQUENCE, TIME = "velocity before impact, by impact", "velocity in time"
CONFIDENCE = 0.95
FALSE_ALARM = 0.01
"""Probability that a spectrum without lines shows one."""
AROUND = 32  # bins on either side from which the floor of a bin is taken
ALONE = 1.5  # times the threshold for a bin that stands alone: a frequency lifts its neighbours too, chance does not
NARROW = 2.0  # bins: what a single frequency takes up under this window is 1.5
SEGMENT = {SEQUENCE: 2048, TIME: 8192}  # samples: 64 periods of the excitation in time
PARTS = 4  # noisy paths


@dataclass(frozen=True)
class Spectrum:
    """Power spectral density with its band, lines and floor.

    Attributes
    ----------
    frequency : ndarray
        Without zero and its neighbour, which the mean has left.
    power : ndarray
        Two-sided power added up: integrates over frequency to the variance.
    dof : float
        Degrees of freedom: the density is the true one times chi-square of these over these.
    segments : int
        Averaged, half overlapping.
    """

    frequency: Floats
    power: Floats
    dof: float
    segments: int

    @property
    def band(self) -> tuple[Floats, Floats]:
        """95 % band of the true density, bin by bin."""
        low, high = (float(stats.chi2.ppf(0.5 + s * CONFIDENCE, self.dof)) for s in (-0.5, 0.5))
        return self.power * self.dof / high, self.power * self.dof / low

    @cached_property
    def floor(self) -> Floats:
        """Continuous floor: the median of the 65 bins around each, put right for the median of chi-square.

        It is taken to be smooth over as many; what bends within fewer counts as a band.
        """
        around = ndimage.median_filter(self.power, size=2 * AROUND + 1, mode="reflect")
        return np.asarray(around * (self.dof / float(stats.chi2.ppf(0.5, self.dof))))

    @property
    def threshold(self) -> float:
        """Power over the floor from which a bin is a line, at `FALSE_ALARM` for the whole spectrum.

        The floor's own error, that of a median of as many bins (1.25 standard errors of a mean; neighbours under this
        window count 2/3), is allowed for thrice.
        """
        chance = stats.chi2.ppf(1.0 - FALSE_ALARM / self.power.size, self.dof) / self.dof
        unsure = 1.25 * math.sqrt(2.0 / self.dof) / math.sqrt((2 * AROUND + 1) / 1.5)
        return float(chance * (1.0 + 3.0 * unsure))

    @cached_property
    def lines(self) -> pd.DataFrame:
        """Narrow bands above the floor, the strongest first.

        Columns: ``frequency`` (centre of its power), ``width`` (bins of its peak's height that hold its power),
        ``share`` (of all power), ``over`` (peak over floor) and ``narrow`` (no wider than a single frequency appears).
        """
        above = self.power > self.threshold * self.floor
        label, n = ndimage.label(above)
        extra = np.maximum(self.power - self.floor, 0.0)
        rows = []
        for place in ndimage.find_objects(label, n):
            p = extra[place]
            if p.size == 1 and not (self.power[place] > ALONE * self.threshold * self.floor[place]).any():
                continue
            width = float(p.sum() / p.max())
            rows.append({
                "frequency": float((self.frequency[place] * p).sum() / p.sum()), "width": width,
                "share": float(p.sum() / self.power.sum()),
                "over": float((self.power[place] / np.maximum(self.floor[place], 1e-300)).max()),
                "narrow": width <= NARROW,
            })  # fmt: skip
        table = pd.DataFrame(rows, columns=["frequency", "width", "share", "over", "narrow"])
        return table.sort_values("share", ascending=False, ignore_index=True)

    @property
    def floor_share(self) -> float:
        """Share of the power that is in no line: the continuous part."""
        return 1.0 - float(self.lines["share"].sum())


def welch(pieces: Iterable[Floats], segment: int, rate: float) -> Spectrum:
    """Spectrum of a record in pieces by Welch's method: Hann windows, half overlapping, averaged over all pieces.

    Parameters
    ----------
    pieces : iterable of ndarray
        Pieces shorter than a segment are left out.
    segment : int
        Samples of a segment.
    rate : float
        Samples per unit of time.

    Raises
    ------
    InputError
        If no piece is as long as a segment (says how long it must be), or a value is not finite (says where).

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=100_000)
    >>> s = welch([x], 256, 1.0)
    >>> bool(abs(s.power.mean() - 2.0) < 0.05), len(s.lines)
    (True, 0)
    """
    total, dof, segments, longest = np.zeros(segment // 2 + 1), 0.0, 0, 0
    frequency = np.zeros(0)
    window = np.asarray(signal.get_window("hann", segment), dtype=float)
    beside = float((window[segment // 2 :] * window[: segment // 2]).sum() / (window**2).sum()) ** 2
    for n, piece in enumerate(pieces):
        check_finite(f"piece {n} of the record", piece)
        longest = max(longest, piece.size)
        if piece.size < segment:
            continue
        k = 2 * (piece.size // (segment // 2)) // 2 - 1
        frequency, power = signal.welch(piece, fs=rate, window="hann", nperseg=segment, noverlap=segment // 2)
        total += k * power
        segments += k
        dof += 2.0 * k / (1.0 + 2.0 * (1.0 - 1.0 / k) * beside)
    if segments == 0:
        raise InputError("record", longest, f"is too short for a spectrum: pieces need {segment} samples or more")
    return Spectrum(frequency[2:-1], total[2:-1] / segments, dof, segments)


def _collect(scene: Scene, parts: Iterable[tuple[list[Floats], list[Floats]]]) -> dict[tuple[str, str], Spectrum]:
    sequence, time = [], []
    for a, b in parts:
        sequence += a
        time += b
    h = clockwork(scene, 1).h
    found = {}
    for stage in range(scene.stages):
        name = f"y{stage + 1}"
        found[SEQUENCE, name] = welch((p[:, stage] for p in sequence), SEGMENT[SEQUENCE], 1.0)
        found[TIME, name] = welch((p[:, stage] for p in time), SEGMENT[TIME], 2.0 * math.pi / h)
    return found


def spectra(
    scene: Scene, *, impacts: int = 200_000, seed: int = 0, workers: int = 2
) -> dict[tuple[str, str, str], Spectrum]:
    """Spectra of the velocities of the orbit and of the noisy system.

    Parameters
    ----------
    scene : Scene
    impacts : int
        Of the orbit, and at least of the noisy paths together.
    seed : int
    workers : int
        Threads; the result does not depend on it.

    Returns
    -------
    dict
        By side, kind (`SEQUENCE`: frequencies in cycles per impact; `TIME`: in units of the excitation's) and velocity.
        Without the orbit where it rests.
    """
    count("impacts", impacts, least=20_000)
    h = clockwork(scene, 1).h

    def noisy(path: int) -> tuple[list[Floats], list[Floats]]:
        sequence, time, regime = [], [], Regime()
        for s, velocity in noisy_record(scene, 2**30, seed, regime, path=path, tangent=False):
            sequence.append(s.before[:, 1::2].copy())
            time.append(velocity)
            if regime.impacts * PARTS >= impacts:
                break
        return [np.concatenate(sequence)], [np.concatenate(time)]

    found: dict[tuple[str, str, str], Spectrum] = {}
    regime = Regime()
    pieces = [(s.before[:, 1::2], velocities(scene, s, h)) for s in orbit_record(scene, impacts, regime, tangent=False)]
    if regime.kind not in ("rests", "silent"):
        orbit = _collect(scene, ([[a], [b]] for a, b in pieces))  # type: ignore[misc]
        found |= {(ORBIT, *key): value for key, value in orbit.items()}
    with ThreadPoolExecutor(workers) as pool:
        noisy_found = _collect(scene, pool.map(noisy, range(PARTS)))
    found |= {(NOISY, *key): value for key, value in noisy_found.items()}
    return found


def spectra_tables(found: dict[tuple[str, str, str], Spectrum]) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """The spectra as tables: densities with their bands, lines, and one summary row each.

    Returns
    -------
    density, lines, summary : DataFrame
        The summary has ``side, kind, velocity, variance, lines, narrow`` (how many are narrow bands), ``line_share,
        floor_share, threshold, dof, segments``.
    """
    density, lines, summary = [], [], []
    for (side, kind, velocity), s in found.items():
        key = {"side": side, "kind": kind, "velocity": velocity}
        low, high = s.band
        density.append(
            pd.DataFrame({
                **key, "frequency": s.frequency, "power": s.power, "low": low, "high": high, "floor": s.floor,
            })
        )  # fmt: skip
        lines.append(s.lines.assign(**key))
        summary.append({
            **key, "variance": float(s.power.sum() * (s.frequency[1] - s.frequency[0])), "lines": len(s.lines),
            "narrow": int(s.lines["narrow"].sum()), "line_share": 1.0 - s.floor_share, "floor_share": s.floor_share,
            "threshold": s.threshold, "dof": s.dof, "segments": s.segments,
        })  # fmt: skip
    return pd.concat(density, ignore_index=True), pd.concat(lines, ignore_index=True), pd.DataFrame(summary)
