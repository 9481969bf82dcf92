"""A file of a result is one of `--output`, of its help, and of what a new report replaces."""

import json

import numpy as np

import rastercov as rc


def check(command, folder):
    """The area of the file is that of the summary."""
    line = "evaluate torus -c khepra -p sphere:4 --pictures 0 -o stl"
    assert "covered (what is covered)" in " ".join(command("evaluate --help").split())
    command(line)
    assert not (folder / "stl" / "covered.stl").exists()
    command(f"{line} --output covered")
    mesh = rc.Mesh.load(folder / "stl" / "covered.stl")
    summary = json.loads((folder / "stl" / "summary.json").read_text())
    assert np.isclose(mesh.areas.sum(), summary["covered_area"]["m2"], rtol=1e-4)
    command(line)
    assert not (folder / "stl" / "covered.stl").exists()
