"""Workers of this folder's tests start as copies of one process; pictures are coarse."""

import pytest
from coarse_pictures import coarse_pictures  # noqa: F401 # a fixture for every test
from copied_workers import workers_start_as_copies  # noqa: F401 # a fixture, used by its name


@pytest.fixture(autouse=True, scope="module")
def copies(request):
    """For every test."""
    request.getfixturevalue("workers_start_as_copies")
