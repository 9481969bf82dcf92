"""The option `compare --models`: coverage models compared with each other."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from rastercov._output import json_text
from rastercov.camera import Camera
from rastercov.cli.console import progress_bar, warn
from rastercov.mesh import Mesh
from rastercov.report.folder import ReportFolder
from rastercov.report.models import (
    MODEL_COMPARISON,
    bivalence_lines,
    score_table,
    write_model_comparison,
)
from rastercov.validation.models.comparison import compare_models


def run_models(
    mesh: Mesh, camera: Camera, poses: NDArray[np.float64], out: Path, as_json: bool
) -> None:
    """Compare all models, leave the page, and print a table or the JSON."""
    warn(mesh.warnings)
    with ReportFolder(out, MODEL_COMPARISON) as folder:
        with progress_bar() as progress:
            found = compare_models(mesh, camera, poses, progress=progress)
        with progress_bar() as progress:
            path = write_model_comparison(folder, found, mesh, camera, poses, progress=progress)
    if as_json:
        print(json_text(found))
        return
    Console().print(score_table(found))
    print("\n".join(bivalence_lines(found)))
    print(path)
