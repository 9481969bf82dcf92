"""The device of the rasteriser tests."""

import os

DEVICE = os.environ.get("RASTERCOV_TEST_DEVICE", "surfaceless")
"""Mesa in software; "egl:0" tests a GPU."""
IN_SOFTWARE = DEVICE == "surfaceless"
