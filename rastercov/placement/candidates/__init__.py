"""Candidate poses: where a camera could be."""

from rastercov.placement.candidates.pool import *  # noqa: F403
