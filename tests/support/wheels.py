"""Packages to compare with that have no wheels for every processor."""

import importlib
import platform

import pytest


def with_wheel(name):
    """A module; where the processor has no wheel of it, what needs it is skipped.

    PyPI has none of pycolmap and embreex for aarch64. Elsewhere they must be there: a test that is
    skipped proves nothing.
    """
    if platform.machine() == "aarch64":
        return pytest.importorskip(name, reason=f"no wheel of {name.partition('.')[0]} for aarch64")
    return importlib.import_module(name)
