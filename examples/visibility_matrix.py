"""Visibility matrix of 200 candidate poses, and a greedy selection."""

import numpy as np

import rastercov as rc
from rastercov.core.mesh import shapes

mesh, camera = shapes.aeroplane(), rc.Camera.preset("icube-ns4133bu-8mm").resized(0.5)
poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), distance=50, count=200)
result = rc.evaluate(mesh, camera, poses, rc.Task(min_pixels=4), fields=["reason"])
print(result.info.renderer)
is_covered = result.reason == rc.Reason.COVERED

# Greedy selection: the pose that covers the most faces not covered so far.
missing, chosen = np.ones(mesh.n_faces, dtype=bool), []
while (gain := (is_covered & missing).sum(axis=1)).max() > 0 and len(chosen) < 8:
    chosen.append(int(gain.argmax()))
    missing &= ~is_covered[chosen[-1]]
print(f"{len(chosen)} of {len(poses)} poses see {100 * (1 - missing.mean()):.1f} % of the faces")
