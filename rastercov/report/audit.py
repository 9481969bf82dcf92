"""Report of an audit: a page, tables of elements and cameras, arrays, a coloured mesh, a summary.

audit.html         headline, pictures of the surface, what each image adds; all inline
audit_*.png        the surface by number of views, best density and widest angle
elements.parquet   figures of each cell or face, and elements.npz the same
cameras.parquet    figures of each image
audit.glb          the surface coloured by the number of views
rig.json           the cameras and poses, where there are up to 5,000
audit.json         shares, medians, the smallest subset, and its provenance
"""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import write_bytes, write_json, write_npz, write_text, writing
from rastercov.camera.rig import names_of
from rastercov.coverage.provenance import Provenance
from rastercov.coverage.shards import UNFINISHED, remove
from rastercov.placement.audit import Audit
from rastercov.report.audit_page import page, pictures_of
from rastercov.report.coloured_mesh import write_coloured_mesh
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.rig_file import write_rig

AUDIT = ReportKind(
    "audit",
    re.compile(
        r"elements\.parquet|cameras\.parquet|elements\.npz|audit\.(glb|json|html)|rig\.json|audit_[a-z]+\.png"
    ),
    last="audit.json",
)


def write(
    made: Callable[[Path | None], Audit],
    out: Path,
    options: Mapping[str, Any],
    notes: Sequence[str] = (),
    *,
    is_kept: bool = False,
) -> tuple[Audit, dict[str, Any]]:
    """Make an audit and write its report; the audit, and the content of `audit.json`.

    Parameters
    ----------
    made : callable
        Gives the audit, once the folder can be used; called with the folder of its shards, or None.
    out : Path
        Folder for the report.
    options : mapping
        Options of the audit, ready for JSON.
    notes : sequence of str
        Lines on the files that it is made from.
    is_kept : bool
        True for an audit that is kept in shards until its report is whole.
    """
    with ReportFolder(out, AUDIT) as folder:
        found = made(folder.path / UNFINISHED if is_kept else None)
        header = Provenance(
            found.mesh, found.camera, found.poses.given, found.task, options
        ).as_dict()
        summary = found.summary() | {"notes": list(notes), "run": header}
        cameras = names_of(found.camera)
        pictures = pictures_of(found)
        html = page(found, summary, cameras, pictures)
        with interrupts_held():
            for name, picture in pictures.items():
                write_bytes(folder.file(f"{name}.png"), picture.light)
            write_text(folder.file("audit.html"), html)
            _write_elements(folder.file("elements.parquet"), found)
            _write_cameras(folder.file("cameras.parquet"), found, cameras)
            write_npz(folder.file("elements.npz"), **_arrays(found))
            write_coloured_mesh(
                folder.file("audit.glb"),
                found.mesh if found.cells is None else found.cells.elements,
                found.views / max(1, int(found.views.max(initial=0))),
            )
            write_rig(folder.file("rig.json"), found.camera, found.poses, found.names)
            write_json(folder.file("audit.json"), summary)
            folder.publish()
            remove(folder.path / UNFINISHED)
    return found, summary


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


def _frames(found: Audit) -> dict[str, Any]:
    """Column with the frame of each pose, where there are frames."""
    if found.frames is None:
        return {}
    return {"frame": [found.frames.names[row] for row in found.frames.of_pose]}


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
            **_frames(found),
        }
    )
    with writing(path) as part:
        pq.write_table(table, part)
