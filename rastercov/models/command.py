"""What `rastercov compare --models` does with a scene, a camera and poses."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from rastercov.camera import Camera
from rastercov.console import progress_bar, warn
from rastercov.mesh import Mesh
from rastercov.models.comparison import compare_models
from rastercov.models.page import bivalence_lines, score_table, write_model_comparison


def run_models(
    mesh: Mesh, camera: Camera, poses: NDArray[np.float64], out: Path, as_json: bool
) -> None:
    """Compare all models, leave the page, and print a table or the JSON."""
    warn(mesh.warnings)
    with progress_bar() as progress:
        found = compare_models(mesh, camera, poses, progress=progress)
    with progress_bar() as progress:
        path = write_model_comparison(out, found, mesh, camera, poses, progress=progress)
    if as_json:
        print(json.dumps(json.loads((out / "models.json").read_bytes()), indent=2))
        return
    Console().print(score_table(found))
    print("\n".join(bivalence_lines(found)))
    print(path)
