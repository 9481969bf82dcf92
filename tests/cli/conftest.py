"""Commands draw their pictures coarsely here; what a picture shows is tested in `tests/report`."""

from coarse_pictures import coarse_pictures  # noqa: F401 # a fixture for every test
