"""A device on cameras is registered by one line, and all ways to a figure have it then."""

import subprocess
import sys
from pathlib import Path

SUPPORT = Path(__file__).parents[1] / "support"


def test_a_flash_that_is_registered_counts_in_regions_points_plans_and_the_viewer(tmp_path):
    line = [sys.executable, str(SUPPORT / "flash.py")]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
