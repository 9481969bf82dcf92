"""Reasons of skipped tests, for the end of a run."""

from collections import Counter


def reasons_of(skipped):
    """Number of tests skipped for each reason, the most frequent first."""
    reasons = Counter()
    for report in skipped:
        _, _, reason = report.longrepr
        reasons[" ".join(reason.removeprefix("Skipped: ").split())] += 1
    return reasons.most_common()
