"""Marks and settings of tests too long for `make test`; RASTERCOV_NIGHTLY=1 runs them in full."""

import os

import pytest
from hypothesis import settings

IS_NIGHTLY = os.environ.get("RASTERCOV_NIGHTLY") == "1"

nightly = pytest.mark.skipif(not IS_NIGHTLY, reason="takes long; RASTERCOV_NIGHTLY=1 runs it")


def amount(by_day, at_night):
    """Size of a problem whose law holds for any size, by day and by night."""
    return at_night if IS_NIGHTLY else by_day


def examples(count, at_night=100):
    """Settings of a hypothesis test: its number of examples, by day and by night."""
    return settings(max_examples=at_night if IS_NIGHTLY else count)
