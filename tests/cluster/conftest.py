"""Pictures of this folder's tests are coarse."""

from coarse_pictures import coarse_pictures  # noqa: F401 # a fixture for every test
