"""Cases of tests with many slow ones that `make test` runs: a third of each test."""

import os
from collections import defaultdict
from hashlib import sha256

FEW = 3
"""Cases of a test that all run."""


def seed_of(environment=os.environ):
    """Another third on every run at a desk, the same one where a run decides over a change."""
    return "" if environment.get("CI") else environment.get("PYTEST_XDIST_TESTRUNUID", "")


def a_third(names, seed=""):
    """A third of some names, rounded up and at least two: those with the lowest hashes."""
    by_hash = sorted(names, key=lambda name: sha256(f"{seed} {name}".encode()).digest())
    return set(by_hash[: max(2, -(-len(by_hash) // 3))])


def split(items, seed=""):
    """Items that run by day, in their order, and the others."""
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker("slow") and hasattr(item, "callspec"):
            cases[item.nodeid.partition("[")[0]].append(item.nodeid)
    left_out = set()
    for names in cases.values():
        if len(names) > FEW:
            left_out |= set(names) - a_third(names, seed)
    kept = [item for item in items if item.nodeid not in left_out]
    return kept, [item for item in items if item.nodeid in left_out]
