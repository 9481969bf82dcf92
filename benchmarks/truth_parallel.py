"""Visible shares of faces along parallel rays: libphoebe's against ours, and a judge for both.

`libphoebe.mesh_visibility`, part of PHOEBE (GPL, run from its own wheel), clips the image of each
face by those in front of it with Clipper. Ours is `certified` through `rc.Camera.orthographic`.
Where the two differ by more than our bound and 1e-6, exact fractions judge.
"""

import time

import numpy as np
from attack_exact import assembly, crossing_solids, fine_solids, solid
from compared import Compared, Comparison, amount

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.reference import rational

MESHES, DIRECTIONS = 50, 40
THEIR_BOUND = 1e-6
"""libphoebe states no accuracy."""
GRAZING = 1e-3
"""Least cosine of a front face and the rays."""
KINDS = (solid, crossing_solids, fine_solids, assembly, lambda rng: shapes.torus(30, 16))


def shares(effort: float) -> list[Compared]:
    """Shares of the front faces of closed and crossing meshes."""
    import libphoebe

    compared = Compared("shares of faces, parallel rays", "")
    seconds = {"ours": 0.0, "theirs": 0.0}
    for seed in range(amount(MESHES, effort, len(KINDS))):
        rng = np.random.default_rng(seed)
        mesh = KINDS[seed % len(KINDS)](rng)
        directions = rng.normal(size=(DIRECTIONS, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        reach = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        camera = rc.Camera.orthographic(1000, 1000, px_per_m=1000 / (1.1 * reach))
        middle = mesh.bounds.mean(axis=0)
        poses = rc.look_at(middle + directions * reach, middle)
        with rc.open_observer(mesh, camera, threads=1) as observer:
            observer.observe(poses[:1])
            started = time.process_time()
            seen = observer.observe(poses)
            seconds["ours"] += time.process_time() - started
        triangles = np.ascontiguousarray(mesh.faces, np.int32)
        normals = mesh.normals
        for row, direction in enumerate(directions):
            started = time.process_time()
            mesh_visibility = libphoebe.mesh_visibility(
                direction, mesh.vertices, triangles, normals, b"boolean",
                tvisibilities=True, taweights=False, horizon=False,
            )  # fmt: skip
            seconds["theirs"] += time.process_time() - started
            faces = np.flatnonzero((normals @ direction > GRAZING) & (seen.drawn_pixels[row] > 0))
            area, bound = seen.drawn_pixels[row, faces], seen.area_error[row, faces]
            ours, theirs = (
                seen.visible_pixels[row, faces] / area,
                mesh_visibility["tvisibilities"][faces],
            )
            beyond = compared.add(ours, theirs, 2 * bound / area + THEIR_BOUND)
            if not beyond.any():
                continue
            true = rational.visible_area(mesh, camera, poses[row], faces[beyond])
            off = np.abs(seen.visible_pixels[row, faces[beyond]] - true)
            is_ours = off > bound[beyond] + 1e-9
            compared.explain("ours (exact fractions)", int((~is_ours).sum()))
            for face in faces[beyond][is_ours]:
                compared.faults.append(f"mesh {seed}, direction {row}, face {face}")
    compared.note = f"libphoebe takes {seconds['theirs'] / seconds['ours']:.0f} times as long"
    return [compared]


COMPARISONS = [Comparison("libphoebe", "phoebe", shares)]
