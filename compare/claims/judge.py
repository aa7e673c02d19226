"""All claims, in the order of the paper."""

from collections.abc import Callable

from rattle.compare.claims.claim import PaperClaim
from rattle.compare.claims.evidence import Evidence
from rattle.compare.claims.of_moments import beyond_one, describes, not_gaussian, solvable, stages_apart
from rattle.compare.claims.of_motion import (
    both_models,
    chaotic_range,
    control,
    counter_meshes,
    fuzzy,
)
from rattle.compare.claims.of_spectra import continuous, narrow_bands

CLAIMS: tuple[Callable[[Evidence], PaperClaim], ...] = (
    solvable,
    beyond_one,
    not_gaussian,
    stages_apart,
    counter_meshes,
    fuzzy,
    narrow_bands,
    continuous,
    chaotic_range,
    describes,
    both_models,
    control,
)


def judge(evidence: Evidence) -> list[PaperClaim]:
    """Judge all claims."""
    return [claim(evidence) for claim in CLAIMS]
