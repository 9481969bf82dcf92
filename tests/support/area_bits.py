"""Print digests of figures by area on the level of RASTERCOV_LEVEL, a line each."""

import hashlib

import numpy as np
from surface_cases import room, whole

import rastercov as rc
from rastercov.core.area.cut import values_of
from rastercov.engine import LEVEL

mesh, camera, poses = room()
rng = np.random.default_rng(4)
lens = rc.Camera(
    width=320, height=240, fx=170, fy=170, model="opencv", distortion=(-0.2, 0.05, 0, 0)
)
task = rc.Task(max_incidence_deg=60, min_pixel_density=40)
table = {f"regions {n}": rc.regions(mesh, one, poses, task) for n, one in enumerate((camera, lens))}
for n, along in ((2, "worst"), (3, "normal"), (6, "worst"), (9, "normal")):
    eyes = np.array((4, 2.5, 1.5)) + rng.uniform(-1, 1, (n, 3)) * (3, 2, 1)
    noise, axes = rng.uniform(1e-4, 3e-4, n), rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.5)
    criterion = rc.Uncertainty(eyes, 4e-4, noise, axes, along=along)
    table[f"uncertainty {n} {along}"] = whole(mesh).where(criterion)
    face = rng.integers(0, mesh.n_faces, 4000)
    xy, radius = rng.uniform(-3, 3, (4000, 2)), rng.uniform(0, 0.1, 4000)
    values = values_of(mesh, criterion._cuts(1)[0], face, xy, radius=radius)
    print(along, n, hashlib.sha256(values.tobytes()).hexdigest())
for name, regions in table.items():
    parts = regions.area, regions.bound, regions.face, regions.xy
    print(name, hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest())
print(LEVEL)
