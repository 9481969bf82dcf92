"""Candidate poses: generators, the constraints on them, and proofs that there are none."""
