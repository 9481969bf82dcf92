"""Bits of pairs in a folder: faces that each of many poses covers, measured batch by batch.

packed.npy       (P, ceil(F / 8)) uint8, as of `CoverageBits`
area_units.npy   (P,) int64
views.npy        (F,) int64
bits.json        figures of all poses, and what the bits depend on; the last file
unfinished/      shards, until the others are whole

In the memory are a batch, and some bytes for a pose.
"""

import re
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from rastercov.base import ByName, ReadByName
from rastercov.base.output import write_json, writing
from rastercov.core.coverage.evaluation import Query
from rastercov.core.coverage.network import can_judge, engine_for, share_of_faces
from rastercov.core.coverage.shards import (
    EvaluationShards,
    Wanted,
    classify_parts,
    folder_of_shards,
    open_for,
    provenance_of,
    remove,
)
from rastercov.core.raster.contract import AREAS, HEADER, PACKED, VIEWS, unit_of
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.shards import Staff

BITS = ReportKind("bits", re.compile(r"(packed|area_units|views)\.npy|bits\.json"), last=HEADER)


def write_bits(query: Query, out: Path, options: ReadByName, staff: Staff) -> ByName:
    """Write the covered pairs of all poses; the content of `bits.json`.

    An interrupt leaves an earlier result as it was, and shards from which the next run continues.
    """
    mesh, camera, poses, task = query.mesh, query.camera, query.poses, query.task
    engine = engine_for(query.engine, mesh, camera, task, len(poses))
    wanted, began = Wanted(engine, False, bits=True), time.perf_counter()
    units = np.zeros(len(poses), np.int64)
    with ExitStack() as opened:
        folder = opened.enter_context(ReportFolder(out, BITS))
        observer = opened.enter_context(open_for(mesh, camera, task, wanted))
        wanted = replace(wanted, alone=can_judge(observer, poses, task))
        network = wanted.network(mesh, task)
        shards = EvaluationShards(folder_of_shards(folder.path), observer, poses, task, wanted)
        at, shape = 0, (len(poses), -(-mesh.n_faces // 8))
        with writing(folder.file(PACKED)) as part, part.open("wb") as file:
            head = {"descr": "|u1", "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(file, head)
            for batch in classify_parts(network, observer, poses, wanted, shards, staff):
                assert batch.bits is not None
                file.write(np.ascontiguousarray(batch.bits.packed).data)
                units[at : at + len(batch.poses)] = batch.bits.area_units
                network.add(batch)
                at += len(batch.poses)
        np.save(folder.file(AREAS), units)
        np.save(folder.file(VIEWS), network.views)
        best = int(units.argmax()) if len(units) else -1
        summary: ByName = {
            "poses": len(poses),
            "covered": share_of_faces(mesh, network.covered, mesh.task_mask),
            "best": {"pose": best, "area_m2": float(units.max(initial=0) * unit_of(mesh))},
            "unit_m2": unit_of(mesh),
            "seconds": time.perf_counter() - began,
            "run": provenance_of(mesh, camera, poses.given, task, options, observer.info),
        }
        write_json(folder.file(HEADER), summary)
        folder.publish()
        remove(folder.path)
    return summary
