"""Power spectra with a chi-square band, and tests for spectral lines above a continuous floor.

By Welch's method (1967); degrees of freedom of overlapping segments by Percival and Walden (1993),
section 6.17.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from scipy import ndimage, signal
from scipy.special import chdtri

from rattle.compare.chaos.record import NoRecord, in_threads, leave_out, read_orbit, read_path
from rattle.compare.chaos.section import NOISY, ORBIT_SECTION
from rattle.compare.report.json_text import Facts
from rattle.montecarlo.coupling.dyadic import step_time
from rattle.montecarlo.statistics.intervals import CONFIDENCE
from rattle.scene import Floats, Scene
from rattle.scene.long_orbit import velocities

SEQUENCE = "velocity before impact, by impact"
VELOCITY_IN_TIME = "velocity in time"
FALSE_LINE = 0.01
"""Probability that at least one line is found in a spectrum that has none."""
FLOOR_BINS = 32  # bins on either side that enter the floor of a bin
# factor on the threshold of an isolated bin: a true line also raises its neighbours (Hann window)
ALONE = 1.5
# largest width of a narrow band, in bins; a single frequency has 1.5 with this window
NARROW_BINS = 2.0
# samples of a segment; in time these are 64 periods of the excitation
SEGMENT = {SEQUENCE: 2048, VELOCITY_IN_TIME: 8192}
SPECTRUM_PATHS = 4  # noisy paths
SEGMENTS = 4  # fewest segments of each, in time


@dataclass(frozen=True)
class Spectrum:
    """Power spectral density with its band, lines and floor."""

    # without zero, its neighbour (affected by the subtracted mean) and the Nyquist frequency;
    # (bins,)
    frequency: Floats
    power: Floats  # one-sided density: its integral over frequency is the variance; (bins,)
    # degrees of freedom: ``dof power / true density`` has a chi-square distribution with these
    dof: float
    segments: int  # number of averaged segments, which overlap by half

    @property
    def band(self) -> tuple[Floats, Floats]:
        """95 % band of the true density, bin by bin."""
        low, high = (chdtri(self.dof, 0.5 + s * CONFIDENCE) for s in (0.5, -0.5))
        return self.power * self.dof / high, self.power * self.dof / low

    @cached_property
    def floor(self) -> Floats:
        """Continuous floor: the running median over 65 bins, divided by the median of chi-square
        over its mean.

        The continuous part is assumed to be smooth over 65 bins; narrower features count as bands.
        """
        around = ndimage.median_filter(self.power, size=2 * FLOOR_BINS + 1, mode="reflect")
        return around * (self.dof / chdtri(self.dof, 0.5))

    @property
    def threshold(self) -> float:
        """Ratio of power to floor above which a bin belongs to a line, at `FALSE_LINE` for the
        whole spectrum.

        It includes three standard errors of the floor: a median has 1.25 times the standard error
        of a mean, and with this window 65 neighbouring bins count as 65 / 1.5 independent ones.
        """
        chance = chdtri(self.dof, FALSE_LINE / self.power.size) / self.dof
        unsure = 1.25 * math.sqrt(2.0 / self.dof) / math.sqrt((2 * FLOOR_BINS + 1) / 1.5)
        return float(chance * (1.0 + 3.0 * unsure))

    @cached_property
    def lines(self) -> pd.DataFrame:
        """Narrow bands above the floor, the strongest first.

        Columns: ``frequency`` (centroid of the power above the floor), ``width`` (that power over
        its peak, in bins), ``share`` (of the total power), ``over`` (peak over floor) and
        ``narrow`` (no wider than a single frequency).
        """
        above = self.power > self.threshold * self.floor
        extra = np.maximum(self.power - self.floor, 0.0)
        bins = pd.DataFrame(
            {
                "extra": extra,
                "moment": self.frequency * extra,
                "over": self.power / np.maximum(self.floor, 1e-300),
            }
        )
        bands = bins[above].groupby(ndimage.label(above)[0][above])
        power = bands["extra"].sum()
        table = pd.DataFrame(
            {
                "frequency": bands["moment"].sum() / power,
                "width": power / bands["extra"].max(),
                "share": power / self.power.sum(),
                "over": bands["over"].max(),
            }
        )
        table["narrow"] = table["width"] <= NARROW_BINS
        counted = (bands.size() > 1) | (table["over"] > ALONE * self.threshold)
        return table[counted].sort_values("share", ascending=False, ignore_index=True)

    @property
    def table(self) -> pd.DataFrame:
        """Bin by bin: ``frequency, power, low, high, floor``."""
        low, high = self.band
        columns = {"frequency": self.frequency, "power": self.power, "low": low, "high": high}
        return pd.DataFrame(columns | {"floor": self.floor})

    @property
    def summary(self) -> Facts:
        """Power, lines, and how sure they are; the continuous part is what lies outside the
        lines."""
        floor_share = 1.0 - self.lines["share"].sum()
        return {
            "variance": self.power.sum() * (self.frequency[1] - self.frequency[0]),
            "lines": len(self.lines),
            "narrow": self.lines["narrow"].sum(),
            "line_share": 1.0 - floor_share,
            "floor_share": floor_share,
            "threshold": self.threshold,
            "dof": self.dof,
            "segments": self.segments,
        }


Spectra: TypeAlias = dict[tuple[str, str, str], Spectrum]
"""By side, kind and velocity."""


def welch(pieces: Sequence[Floats], segment: int, rate: float) -> Spectrum:
    """Estimate the spectrum of a record by Welch's method: Hann windows that overlap by half,
    averaged over all pieces.

    Shapes: `pieces` (samples,).
    """
    whole = [piece for piece in pieces if piece.size >= segment]
    if not whole:
        longest = max((piece.size for piece in pieces), default=0)
        raise NoRecord(
            f"its longest stretch has {longest:,} samples, and a spectrum needs {segment:,}"
        )
    total = np.zeros(segment // 2 + 1)
    dof = 0.0
    segments = 0
    window = np.asarray(signal.get_window("hann", segment), dtype=float)
    beside = float((window[segment // 2 :] * window[: segment // 2]).sum() / (window**2).sum()) ** 2
    for piece in whole:
        k = piece.size // (segment // 2) - 1
        # Hann windows that overlap by half are what it takes by itself
        frequency, power = signal.welch(piece, fs=rate, nperseg=segment)
        total += k * power
        segments += k
        dof += 2.0 * k / (1.0 + 2.0 * (1.0 - 1.0 / k) * beside)
    return Spectrum(frequency[2:-1], total[2:-1] / segments, dof, segments)


def spectra(
    scene: Scene,
    *,
    impacts: int = 200_000,
    segments: int = SEGMENTS,
    seed: int = 0,
    workers: int = 2,
    missing: dict[str, str] | None = None,
) -> Spectra:
    """Estimate the spectra of the velocities of the orbit and of the noisy system.

    `impacts`: Impacts of the orbit; the noisy paths have at least as many together, and more where
    they chatter. `segments`: fewest of each noisy path, in time.

    Returns: By side, kind and velocity (``y1, y2``).  `SEQUENCE` is the velocity
    before each impact, with frequencies in cycles per impact; `VELOCITY_IN_TIME` is the velocity in
    time, with frequencies in units of the excitation frequency. Without a side whose record is too
    short, because it sticks, or has no further impact.
    """
    h = step_time(scene)

    def orbit() -> list[tuple[Floats, Floats]]:
        return [(s.before[:, 1::2], velocities(scene, s, h)) for s in read_orbit(scene, impacts)]

    def noisy(path: int) -> Any:
        of_path = math.ceil(impacts / SPECTRUM_PATHS)
        steps = segments * SEGMENT[VELOCITY_IN_TIME]
        record = read_path(scene, seed, path, impacts=of_path, steps=steps)
        pieces = [(s.before[:, 1::2], velocity) for s, velocity in record]
        return map(np.concatenate, zip(*pieces, strict=True))

    power: Spectra = {}
    for side, pieces_of in (
        (ORBIT_SECTION, orbit),
        (NOISY, lambda: in_threads(workers, noisy, range(SPECTRUM_PATHS))),
    ):
        with leave_out(missing, f"the spectra of the {side}"):
            sequence, time = zip(*pieces_of(), strict=True)
            kinds = ((SEQUENCE, sequence, 1.0), (VELOCITY_IN_TIME, time, 2.0 * math.pi / h))
            power |= {
                (side, kind, f"y{stage + 1}"): welch(
                    [piece[:, stage] for piece in pieces], SEGMENT[kind], rate
                )
                for stage in range(scene.stages)
                for kind, pieces, rate in kinds
            }
    return power


def spectra_tables(
    power: Spectra,
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Convert spectra to tables.

    Returns: All with ``side, kind, velocity``.  Densities: ``frequency, power, low, high, floor``.
    Lines: see `Spectrum.lines`.  Summary, one row for each spectrum: ``variance, lines`` (their
    number), ``narrow`` (number of narrow ones), ``line_share, floor_share, threshold, dof,
    segments``.
    """
    names = ["side", "kind", "velocity"]
    density: pd.DataFrame = pd.concat({key: s.table for key, s in power.items()}, names=names)
    lines = []
    summary = []
    for key, s in power.items():
        which = dict(zip(names, key, strict=True))
        lines.append(s.lines.assign(**which))
        summary.append(which | s.summary)
    return (
        density.reset_index(names).reset_index(drop=True),
        pd.concat(lines, ignore_index=True),
        pd.DataFrame(summary),
    )
