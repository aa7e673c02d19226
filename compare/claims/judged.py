"""All claims, in the order of the paper."""

from collections.abc import Callable

from rattle.compare.claims.claim import Claim
from rattle.compare.claims.evidence import Evidence
from rattle.compare.claims.of_moments import beyond_one, describes, not_gaussian, solvable, stages_apart
from rattle.compare.claims.of_motion import (
    both_models,
    chaotic_range,
    controlled,
    counter_meshes,
    fuzzy,
)
from rattle.compare.claims.of_spectra import continuous, narrow_bands

CLAIMS: tuple[Callable[[Evidence], Claim], ...] = (
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
    controlled,
)


def judge(evidence: Evidence) -> list[Claim]:
    """Judge all claims."""
    return [claim(evidence) for claim in CLAIMS]
