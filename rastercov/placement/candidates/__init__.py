"""Candidate poses: generators, the constraints on them, and proofs that there are none."""

from rastercov.placement.candidates.pool import (
    Candidates,
    from_poses,
    per_convex_region,
    per_face,
    per_segment,
)

__all__ = ["Candidates", "from_poses", "per_convex_region", "per_face", "per_segment"]
