"""Coverage of a part by 24 cameras: covered share, reasons, partly visible faces."""

import numpy as np

import rastercov as rc

mesh = rc.Mesh.load("teapot-12")  # or a file: rc.Mesh.load("part.stl", unit="mm")
camera = rc.Camera.from_lens(
    width=1280,
    height=1024,
    focal_length=8e-3,
    pixel_size=5.3e-6,
    f_number=4.0,
    focus_distance=0.5,
    max_blur=2.0,
)
z_n, z_f = camera.depth_of_field()
print(f"in focus from {z_n:.3f} m to {z_f:.3f} m")

poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), distance=0.5, count=24)
task = rc.Task(min_pixels=10, min_visibility=0.5, max_incidence_deg=75)
coverage = rc.evaluate(mesh, camera, poses, task=task)

summary = coverage.summary()
print(f"covered: {summary['covered']['percent']:.1f} % of faces, ", end="")
print(f"{summary['covered']['area_percent']:.1f} % of area")
for reason, share in summary["not_covered_because"].items():
    print(f"  not covered, {reason}: {share['faces']} faces")

# All figures are (P, F) arrays: one value per pose and face.
best = int(coverage.coverage.sum(axis=1).argmax())
seen = coverage.visibility[best] > 0
partly = seen & (coverage.visibility[best] < 1)
print(f"pose {best} sees {seen.sum()} faces, {partly.sum()} of them only in part")
print(f"their bounds go up to {np.max(coverage.visibility_bound[best][partly]):.1e}")
