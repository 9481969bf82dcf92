"""Report of an audit: tables of elements and cameras, arrays, a coloured mesh, a summary."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rastercov._interrupts import interrupts_held
from rastercov._output import write_json, write_npz, writing
from rastercov.audit import Audit, audit
from rastercov.mesh import Mesh
from rastercov.provenance import Provenance
from rastercov.report.coloured_mesh import write_coloured_mesh
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.task import Task
from rastercov.views import Views

AUDIT = ReportKind(
    "audit",
    re.compile(r"elements\.parquet|cameras\.parquet|elements\.npz|audit\.(glb|json)"),
    last="audit.json",
)


def run(
    mesh: Mesh,
    views: Views,
    task: Task,
    out: Path,
    progress: Callable[[int, int], None] = lambda done, total: None,
    **options: Any,
) -> dict[str, Any]:
    """Audit the cameras of a file and write the report.

    Parameters
    ----------
    mesh, task
        As for `rastercov.audit.audit`.
    views : Views
        Cameras and poses.
    out : Path
        Folder for the report.
    progress : callable
        Called with the poses done and the total.
    **options
        `by`, `resolution_of_result` and `method` of `rastercov.audit.audit`.

    Returns
    -------
    dict
        Content of `audit.json`.
    """
    assert views.rig is not None
    with ReportFolder(out, AUDIT) as folder:
        found = audit(
            mesh, views.rig, views.poses, task, names=views.images or None, progress=progress,
            **options,
        )  # fmt: skip
        header = Provenance(mesh, views.rig, views.poses.given, task, options).as_dict()
        summary = found.summary() | {"notes": list(views.notes), "run": header}
        with interrupts_held():
            _write_elements(folder.file("elements.parquet"), found)
            _write_cameras(folder.file("cameras.parquet"), found, views.rig.names)
            write_npz(folder.file("elements.npz"), **_arrays(found))
            write_coloured_mesh(
                folder.file("audit.glb"),
                mesh if found.cells is None else found.cells.elements,
                found.views / max(1, int(found.views.max(initial=0))),
            )
            write_json(folder.file("audit.json"), summary)
            folder.publish()
    return summary


def _arrays(found: Audit) -> dict[str, np.ndarray[Any, Any]]:
    """Figures of the elements; `best_pose` is the row in the input, -1 for none."""
    on = found.mesh if found.cells is None else found.cells.elements
    source = np.arange(on.n_faces) if found.cells is None else found.cells.source_face
    ids = np.append(found.poses.ids, -1)
    return {
        "face": source.astype(np.int32),
        "area_m2": found.problem.weights,
        "views": found.views.astype(np.int32),
        "covered": found.covered,
        "best_density_px_per_m": found.best_density,
        "best_pose": ids[found.best_camera].astype(np.int64),
        "widest_angle_deg": np.degrees(found.widest_angle),
    }


def _write_elements(path: Path, found: Audit) -> None:
    """Write a row for each element, in the order of the numbers of their faces."""
    with writing(path) as part:
        pq.write_table(pa.table(_arrays(found)), part)


def _write_cameras(path: Path, found: Audit, names: tuple[str, ...]) -> None:
    """Write a row for each pose: `in_subset` is true for those of the smallest subset found."""
    chosen = np.zeros(len(found.poses), np.bool_)
    chosen[found.subset.chosen] = True
    table = pa.table(
        {
            "pose": found.poses.ids,
            "name": list(found.names),
            "camera": [names[index] for index in found.poses.camera],
            "seen_m2": found.seen_m2,
            "lost_m2": found.lost_m2,
            "alone_m2": found.alone_m2,
            "in_subset": chosen,
        }
    )
    with writing(path) as part:
        pq.write_table(table, part)
