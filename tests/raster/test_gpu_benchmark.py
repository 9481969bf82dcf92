"""The benchmark of GPUs, in software: each part runs, and what it leaves is what it printed."""

import json

import pytest
from gl_device import DEVICE, IN_SOFTWARE
from nightly import nightly
from processes import TESTS, run_python

PROGRAM = TESTS.parent / "benchmarks" / "gpu.py"
pytestmark = [
    pytest.mark.matter("opengl"),
    pytest.mark.skipif(not IN_SOFTWARE, reason="a device is measured by the program itself"),
]


@pytest.mark.parametrize(
    "parts",
    [
        pytest.param(["border"], marks=pytest.mark.every_day),
        pytest.param(["counts", "bits", "scenes", "place", "border", "cpu"], marks=nightly),
    ],
)
def test_every_part_runs_in_software_and_its_rows_are_written(tmp_path, parts):
    file = tmp_path / "gpu.json"
    words = "--device", DEVICE, "--quick", "--output", file, "--json", "--only", *parts
    printed = json.loads(run_python(PROGRAM, *words).stdout)
    made = json.loads(file.read_text())
    assert made["rows"] == printed
    assert made["device"].startswith("llvmpipe")
    assert made["atomics"] == 32
    assert all(row["value"] == 1 for row in printed if row["unit"] == "passed")
    said = " ".join(row["what"] for row in printed)
    for part in parts:
        assert NAMED[part] in said


NAMED = {
    "counts": "count(), visible",
    "bits": "poses to bits, areas and views",
    "scenes": "random and hostile scenes: pairs",
    "place": "from file to certified plan",
    "border": "the device is faster, with opening, from",
    "cpu": "evaluate, default fields, over count with drawn",
}
"""Words of a row of each part."""
