"""Searches that end early, for tests of whole plans that are about something else."""

import numpy as np
import pytest

from rastercov.placement.candidates.cavities import openings
from rastercov.placement.improve.refine import refine


@pytest.fixture
def short_search(monkeypatch):
    """Refinement that ends early, and views into few cavities; placement tests the whole."""

    def few(*scene, faces, **options):
        return openings(*scene, faces=faces & (np.cumsum(faces) <= 20), **options)

    def short(*task, budget, **options):
        return refine(*task, budget=min(budget, 200), **options)

    monkeypatch.setattr("rastercov.placement.plan.run.refine", short)
    monkeypatch.setattr("rastercov.placement.plan.prepare.openings", few)
