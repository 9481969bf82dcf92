"""Calls of the package, of its shapes and of targets, with arguments that are right."""

from dataclasses import fields

import numpy as np
from misuse_calls import Call
from misuse_values import CAMERA, FOLDER, MESH, PLAN, POSES, TASK

import rastercov as rc
from rastercov.mesh import shapes
from rastercov.mesh.targets import box_grid, count_for, sheet_above, with_target


def closed(opened):
    opened.close()


def fields_of(record):
    """Arguments that make an equal record."""
    return {field.name: getattr(record, field.name) for field in fields(record) if field.init}


def triangle_file():
    """A mesh file that is right."""
    path = FOLDER / "triangle.off"
    path.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", encoding="ascii")
    return path


def calls():
    """Every call, one for each choice of arguments that exclude each other."""
    lens = {"width": 32, "height": 24, "fx": 30.0, "fy": 30.0}
    whole = {"cx": 1.0, "cy": 1.0, "near": 0.1, "focal_length": 0.01, "pixel_size": (1e-5, 1e-5)}
    whole |= {"aperture": 1e-3, "focus_distance": 1.0, "max_blur": 1.0, "skew": 0.0}
    scene = {"mesh": MESH, "camera": CAMERA}
    seen = scene | {"poses": POSES}
    thresholds = {"min_pixels": 1, "min_visibility": 0, "max_blur": 1, "max_incidence_deg": 80}
    thresholds |= {"min_pixel_density": 1, "min_facing_density": 1, "min_coverage": 0.5, "views": 1}
    thresholds |= {"focus_rule": "vertices", "cap_resolution": True, "min_pixels_per_m2": 1}
    thresholds |= {"min_angle_deg": 20}
    arrays = {"vertices": MESH.vertices, "faces": MESH.faces, "groups": None, "face_group": None}
    arrays |= {"source_face": None, "sources": (), "notes": ()}
    groups = [rc.Group("a"), rc.Group("b")]
    judged = {"task": TASK, "fields": None}
    exact = {"method": "exact", "supersample": 1, "threads": 1}
    sampled = {"method": "sampled", "backend": "cpu", "supersample": 1, "threads": 1}
    observer = rc.open_observer(MESH, CAMERA, threads=1)
    rasterizer = rc.open_rasterizer(MESH, CAMERA, "cpu", threads=1)
    counts = rasterizer.count(POSES)
    coverage = next(rc.evaluate_batches(observer, POSES))
    covered = rc.regions(MESH, CAMERA, POSES, threads=1)
    zones = rc.dead_zones(rc.unite(covered, 2), 2)
    views = rc.Views(rc.Rig([CAMERA], ["a"]), rc.Poses.of(POSES), ("a", "b"))
    cells = rc.cells(MESH, 0.5)
    return [
        Call("Camera", rc.Camera, lens | whole | {"distortion": ()}),
        Call(
            "Camera, of a lens",
            rc.Camera,
            lens
            | {"model": "opencv", "distortion": (0.1, 0, 0, 0), "skew": 1.0, "max_angle_deg": 60.0},
        ),
        Call("Camera, in focus", rc.Camera, lens | {"focus_range": (0.1, 2.0)}),
        Call(
            "Camera.from_lens",
            rc.Camera.from_lens,
            {"width": 32, "height": 24, "focal_length": 0.01, "pixel_size": 1e-5}
            | {"principal_point": (1e-4, 1e-4), "f_number": 2.0, "focus_distance": 1.0},
        ),
        Call(
            "Camera.from_lens, aperture",
            rc.Camera.from_lens,
            {"width": 32, "height": 24, "focal_length": 0.01, "pixel_size": (1e-5, 1e-5)}
            | {"aperture": 0.001, "focus_distance": 1.0},
        ),
        Call(
            "Camera.from_fov",
            rc.Camera.from_fov,
            {"width": 32, "height": 24, "hfov_deg": 60.0, "near": 0.1},
        ),
        Call(
            "Camera.from_fov, down",
            rc.Camera.from_fov,
            {"width": 32, "height": 24, "vfov_deg": 60.0},
        ),
        Call(
            "Camera.from_fov, corners",
            rc.Camera.from_fov,
            {"width": 32, "height": 24, "diagonal_deg": 60.0},
        ),
        Call(
            "Camera.from_opencv",
            rc.Camera.from_opencv,
            {"K": CAMERA.opencv_K, "width": 32, "height": 24, "distortion": (0, 0, 0, 0)}
            | {"fisheye": False},
        ),
        Call("Camera.check_pinhole", CAMERA.check_pinhole, {"what": "it", "instead": "go"}),
        Call("Camera.preset", rc.Camera.preset, {"name": "khepra"}),
        Call("Camera.with_optics", CAMERA.with_optics, {"entries": {"near": 0.01}}),
        Call("Camera.load", rc.Camera.load, {"path": FOLDER / "none.json"}),
        Call("Camera.from_dict", rc.Camera.from_dict, {"entries": lens}),
        Call("Camera.save", CAMERA.save, {"path": FOLDER / "camera.json"}),
        Call("Camera.resized", CAMERA.resized, {"scale": 0.5}),
        Call("Camera.depth_of_field", CAMERA.depth_of_field, {"max_blur": 1.0}),
        Call(
            "Conventions",
            rc.Conventions,
            {"pixel_centre": 0.5, "lens_model": "brown", "pose_unit": "mm", "image_size": (32, 24)}
            | {"pose_convention": "opencv", "original_world": False, "skip_bad_poses": False},
        ),
        Call("Task", rc.Task, thresholds),
        Call("Task.rules", TASK.rules, {"camera": CAMERA}),
        Call("Task.thesis", rc.Task.thesis, thresholds),
        Call(
            "Group",
            rc.Group,
            {"name": "a", "is_occluder": False, "is_two_sided": True, "is_target": False},
        ),
        Call("Mesh", rc.Mesh, arrays),
        Call(
            "Mesh, in groups",
            rc.Mesh,
            {"vertices": MESH.vertices, "faces": MESH.faces, "groups": groups}
            | {"face_group": np.arange(12) % 2},
        ),
        Call(
            "Mesh.load",
            rc.Mesh.load,
            {"path": FOLDER / "none.stl", "unit": "mm", "occluders": (), "two_sided": ()}
            | {"targets": (), "drop_invalid": False, "max_bytes": 1000, "memory_budget": 1 << 20}
            | {"transforms": {}},
        ),
        Call("Mesh.load, built in", rc.Mesh.load, {"path": "box", "two_sided": ()}),
        Call(
            "Mesh.load, a file",
            rc.Mesh.load,
            {"path": triangle_file(), "drop_invalid": False, "max_bytes": 1000}
            | {"memory_budget": 1 << 20},
        ),
        Call(
            "Mesh.from_trimesh",
            rc.Mesh.from_trimesh,
            {"tri": MESH.to_trimesh(), "name": "a", "unit": "mm"},
        ),
        Call(
            "Mesh.moved",
            MESH.moved,
            {"scale": 2.0, "axis": (0, 0, 1), "angle_deg": 30.0, "translation": (1, 0, 0)}
            | {"groups": None},
        ),
        Call(
            "audit",
            rc.audit,
            seen
            | {"task": TASK, "names": ["a", "b"], "by": "face", "resolution_of_result": None}
            | {"method": "certified", "skip_bad_poses": False, "workers": None}
            | {"progress": lambda done, total: None},
        ),
        Call(
            "check",
            rc.check,
            {"plan": PLAN, "poses": POSES, "camera": CAMERA, "min_coverage": 0.5}
            | {"groups": {"mesh": 0.2}, "views": 1},
        ),
        Call("place", rc.place, {"plan": PLAN, "camera": CAMERA, "workers": None}),
        Call(
            "Mesh.with_groups",
            MESH.with_groups,
            {"occluders": (), "two_sided": "all", "targets": ()},
        ),
        Call(
            "look_at",
            rc.look_at,
            {"eyes": (0, 0, 3), "targets": (0, 0, 0), "up": (0, 0, 1)},
        ),
        Call(
            "sphere_of_poses",
            rc.sphere_of_poses,
            {"centre": (0, 0, 0), "distance": 1, "count": 3},
        ),
        Call("read_poses", rc.read_poses, {"path": FOLDER / "none.npy"}),
        Call("write_poses", rc.write_poses, {"path": FOLDER / "poses.npy", "poses": POSES}),
        Call(
            "write_poses, named",
            rc.write_poses,
            {"path": FOLDER / "poses.json", "poses": POSES, "camera": ["a", "b"]},
        ),
        Call(
            "read_views",
            rc.read_views,
            {"path": FOLDER / "none.json", "format": "colmap", "conventions": rc.Conventions()},
        ),
        Call(
            "write_views",
            rc.write_views,
            {
                "path": FOLDER / "views.json",
                "views": rc.Views(rc.Rig([CAMERA]), rc.Poses.of(POSES), ("a",) * len(POSES)),
                "format": "rastercov",
                "overwrite": True,
            },
        ),
        Call("visibility", rc.visibility, seen | {"method": "certified", "threads": 1}),
        Call("visibility, sampled", rc.visibility, seen | sampled),
        Call("evaluate", rc.evaluate, seen | exact | judged | {"skip_bad_poses": False}),
        Call("evaluate, by area", rc.evaluate, seen | exact | {"by": "area", "fields": []}),
        Call("evaluate, sampled", rc.evaluate, seen | sampled | {"task": TASK}),
        Call(
            "evaluate_batches",
            lambda **named: list(rc.evaluate_batches(**named)),
            {"observer": observer, "poses": POSES, "skip_bad_poses": False} | judged,
        ),
        Call("open_observer", lambda **named: closed(rc.open_observer(**named)), scene | exact),
        Call(
            "open_observer, sampled",
            lambda **named: closed(rc.open_observer(**named)),
            scene | sampled,
        ),
        Call("Observer.visibility", observer.visibility, {"poses": POSES}),
        Call("Observer.observe", observer.observe, {"poses": POSES}),
        Call("Observer.measure", observer.measure, {"poses": POSES}),
        Call(
            "open_rasterizer",
            lambda **named: closed(rc.open_rasterizer(**named)),
            scene | {"backend": "cpu", "supersample": 1, "roll": 0.1, "threads": 1},
        ),
        Call(
            "open_rasterizer, OpenGL",
            lambda **named: closed(rc.open_rasterizer(**named)),
            scene
            | {"device": "auto", "plan": "auto", "require_hardware": False}
            | {"max_tile": 64, "max_faces_a_draw": 100, "image_budget": 1 << 20, "backend": "gl"},
        ),
        Call(
            "Engine",
            rc.Engine,
            {"method": "sampled", "device": "cpu", "supersample": 1, "threads": 1},
        ),
        Call("Engine.of", rc.Engine.of, {"method": "certified"}),
        Call("Engine.parse", rc.Engine.parse, {"text": "sampled:cpu@2"}),
        Call("Workers", rc.Workers, {"number": 1, "scheduler": None}),
        Call("Workers, elsewhere", rc.Workers, {"number": None, "scheduler": "tls://host:1"}),
        Call("Workers.of", rc.Workers.of, {"number": 1, "scheduler": None}),
        Call(
            "Rig",
            rc.Rig,
            {"cameras": [CAMERA, CAMERA], "names": ["a", "b"], "rig_from_camera": POSES},
        ),
        Call("Rig.poses", rc.Rig([CAMERA]).poses, {"world_from_rig": POSES}),
        Call(
            "Poses.of",
            rc.Poses.of,
            {"poses": POSES, "camera": [0, 1], "skip_bad": False},
        ),
        Call("Poses", rc.Poses, fields_of(rc.Poses.of(POSES))),
        Call("Poses.check_cameras", rc.Poses.of(POSES).check_cameras, {"n_cameras": 1}),
        Call("Views", rc.Views, fields_of(views)),
        Call("Views.camera", views.camera, {"name": "a"}),
        Call("Views.of_camera", views.of_camera, {"name": "a"}),
        Call("Views.with_cameras", views.with_cameras, {"rig": rc.Rig([CAMERA], ["a"])}),
        Call("Views.through", views.through, {"cameras": views, "name": "a", "by_name": True}),
        Call("Rasterizer.count", rasterizer.count, {"poses": POSES, "drawn": True}),
        Call("Rasterizer.render", rasterizer.render, {"pose": POSES[0]}),
        Call("regions", rc.regions, seen | {"task": TASK, "method": "certified", "threads": 1}),
        Call("unite", rc.unite, {"regions": covered, "views": 2, "progress": print}),
        Call("dead_zones", rc.dead_zones, {"covered": rc.unite(covered, 2), "views": 2}),
        Call("RegionUnion", rc.RegionUnion, {"mesh": MESH, "views": 2}),
        Call("RegionUnion.add", rc.RegionUnion(MESH).add, {"regions": covered, "progress": print}),
        Call("RegionUnion.of", rc.RegionUnion.of, {"covered": rc.unite(covered), "views": 1}),
        Call("Covered.share", rc.unite(covered).share, {"views": 1}),
        Call("cells", rc.cells, {"mesh": MESH, "size": 0.5}),
        Call("Cells.share", cells.share, {"regions": covered}),
        Call("Network", rc.Network, {"mesh": MESH, "task": TASK}),
        Call("Network.add", rc.Network(MESH, TASK).add, {"coverage": coverage, "camera": 0}),
        Call(
            "Network.add_poses",
            rc.Network(MESH, TASK).add_poses,
            {"observer": observer, "poses": POSES, "skip_bad_poses": False},
        ),
        Call(
            "Network.judge",
            lambda **named: list(rc.Network(MESH, TASK).judge(**named)),
            {"observer": observer, "poses": rc.Poses.of(POSES), "pairs": "none", "keep": ()}
            | {"apart": False},
        ),
        Call("Regions.of_poses", covered.of_poses, {"chosen": np.ones(2, np.bool_)}),
        Call("DeadZones.places", zones.places, {"n": 2}),
        Call("Observation.of_counts", rc.Observation.of_counts, {"counts": counts}),
        # Results, not made by hand
        Call("CellShares", rc.CellShares, fields_of(cells.share(covered))),
        Call("Cells", rc.Cells, fields_of(cells)),
        Call("Coverage", rc.Coverage, fields_of(coverage)),
        Call("Covered", rc.Covered, fields_of(rc.unite(covered))),
        Call("DeadZones", rc.DeadZones, fields_of(zones)),
        Call("FaceCounts", rc.FaceCounts, fields_of(counts)),
        Call("Observation", rc.Observation, fields_of(observer.observe(POSES))),
        Call("RasterizerInfo", rc.RasterizerInfo, fields_of(counts.info)),
        Call("Regions", rc.Regions, fields_of(covered)),
        Call("Visibility", rc.Visibility, fields_of(observer.visibility(POSES))),
        Call("VisibilityBuffer", rc.VisibilityBuffer, fields_of(rasterizer.render(POSES[0]))),
        # Shapes
        Call("teapot", shapes.teapot, {"n": 2, "keep_degenerate": False}),
        Call("aeroplane", shapes.aeroplane, {"n_faces": 1970}),
        Call(
            "torus",
            shapes.torus,
            {"n_major": 6, "n_minor": 5, "major_radius": 1.0, "minor_radius": 0.2},
        ),
        Call("sphere", shapes.sphere, {"subdivisions": 1, "radius": 1.0}),
        Call(
            "icosahedron",
            shapes.icosahedron,
            {"noise": 0.1, "subdivisions": 1, "seed": 0, "edge_length": 1.0},
        ),
        Call("box", shapes.box, {"size": (1, 1, 1), "n": 1, "centre": (0, 0, 0)}),
        Call("room", shapes.room, {"n": 2}),
        Call(
            "tessellated_plane",
            shapes.tessellated_plane,
            {"n_columns": 3, "n_rows": 2, "width": 1.0, "height": 1.0, "jitter": 0.1, "seed": 0},
        ),
        Call("by_name", shapes.by_name, {"name": "box"}),
        Call("sheet_above", sheet_above, {"mesh": MESH, "group": "mesh", "height": 1.6}),
        Call(
            "box_grid",
            box_grid,
            {"low": (0, 0, 0), "high": (1, 1, 1), "count": (1, 2, 1), "size": 0.1},
        ),
        Call("count_for", count_for, {"low": (0, 0, 0), "high": (1, 1, 1), "spacing": 0.5}),
        Call(
            "with_target",
            with_target,
            {"mesh": MESH, "target": MESH, "name": "sheet", "two_sided": True},
        ),
    ]
