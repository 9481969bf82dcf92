"""STEP files (.step, .stp): CAD solids, triangulated by Open CASCADE through cascadio.

Open CASCADE writes a GLB scene in metres with the CAD face of each triangle, which goes through the
reader of GLB files. The STEP file itself is not checked here: what Open CASCADE cannot read it may
leave out. It runs in a process of its own, because damaged files may end it, and it writes to the
terminal.
"""

import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from rastercov.base.errors import MeshError
from rastercov.base.threads import child_environment
from rastercov.mesh.formats.gltf import broken_files_refused, scene_polygons
from rastercov.mesh.formats.gltf_file import chunks
from rastercov.mesh.formats.polygons import Polygons

DEFLECTION = 1e-4
"""Largest distance between a curved surface and its triangles, metres."""
ANGULAR_DEFLECTION = 0.25
"""Largest angle between neighbouring segments along a curve, radians."""
CONVERT = """
import sys
import cascadio
glb = cascadio.load(
    sys.stdin.buffer.read(), tol_linear=float(sys.argv[2]), tol_angular=float(sys.argv[3]),
    use_parallel=False, include_brep=True,
)
with open(sys.argv[1], "wb") as file:
    file.write(glb)
"""
"""Program of the other process. One thread: the numbering of several depends on their timing."""


def read(data: bytes, budget: int, deflection: float = DEFLECTION) -> Polygons:
    """Triangles of a STEP file in metres, one group a CAD face, named "part/face 1" and so on.

    Parameters
    ----------
    data : bytes
        The file.
    budget : int
        Bytes that reading the triangles may need; that of Open CASCADE is not limited.
    deflection : float
        Largest distance between a curved surface and its triangles, metres.
    """
    glb = _converted(data, deflection)
    with broken_files_refused():
        header, binary, notes = chunks(glb)
        polygons = scene_polygons(header, [binary], budget, notes, by_cad_face=True)
    note = (
        f"triangulated by Open CASCADE to within {deflection * 1e3:.3g} mm; what it left out of "
        "the STEP file is not known here"
    )
    return replace(polygons, notes=[*polygons.notes, note], is_in_metres=True)


def _converted(data: bytes, deflection: float) -> bytes:
    """GLB file of a STEP file."""
    if find_spec("cascadio") is None:
        raise MeshError("reading STEP files needs cascadio: pip install 'rastercov[formats]'")
    with tempfile.TemporaryDirectory(prefix="rastercov-step-") as folder:
        path = Path(folder) / "scene.glb"
        # cascadio takes the deflection in millimetres, whatever the unit of the file.
        numbers = [str(deflection * 1e3), str(ANGULAR_DEFLECTION)]
        command = [sys.executable, "-c", CONVERT, str(path), *numbers]
        ended = subprocess.run(
            command, input=data, capture_output=True, check=False, env=child_environment()
        )
        glb = path.read_bytes() if path.exists() else b""
    if ended.returncode or not glb:
        raise MeshError(
            f"Open CASCADE cannot read the STEP file ({_reason(ended)}); export it again, as AP214 "
            "or AP242"
        )
    return glb


def _reason(ended: "subprocess.CompletedProcess[bytes]") -> str:
    """Words of Open CASCADE about its failure, in one line."""
    if ended.returncode < 0:
        return f"it was ended by signal {-ended.returncode}"
    text = (ended.stdout + b"\n" + ended.stderr).decode("utf-8", "replace")
    text = re.sub(r"\x1b\[[0-9;]*m", "", text)
    lines = [" ".join(line.replace("*", " ").split()) for line in text.splitlines()]
    errors = [line for line in lines if "ERR" in line] or [line for line in lines if line]
    return errors[-1][:160] if errors else "it gives no reason"
