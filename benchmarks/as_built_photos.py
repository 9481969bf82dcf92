"""Photographs of the scenes of `installed_scenes`, rendered by Mitsuba (PyPI: mitsuba).

Lamps that throw shadows, materials and textures that the meshes do not have, about 10 % of the
scene changed (a part gone or moved, one to four things added), defocus, noise, JPEG 80.

    python benchmarks/as_built_photos.py build/photos --seeds 0 30    # five a seed, 3 CPU-s each

It needs `mitsuba` and a libLLVM, found by itself or by the variable DRJIT_LIBLLVM_PATH.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rows
from installed_scenes import CAMERA, SCENES, pose_in
from PIL import Image, ImageFilter

import rastercov as rc

SAMPLES = 32
"""Rays of a pixel."""
MATERIALS = 8
"""Most materials of a mesh."""


def main() -> None:
    parser = rows.arguments(__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 30), metavar=("FIRST", "END"))
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    args = parser.parse_args()
    render(args.out, range(*args.seeds), args.scenes)
    report = rows.Report()
    report.add("photographs", len(list(args.out.glob("*.jpg"))), "")
    report.finish(args.json)


def render(out: Path, seeds: Sequence[int], scenes: Sequence[str]) -> None:
    """Photographs NAME_SEED.jpg and true poses NAME_SEED.npy in a folder; those there are kept."""
    out.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        for name in scenes:
            path = out / f"{name}_{seed}.jpg"
            if not path.exists():
                pose, picture = photograph(name, seed)
                np.save(path.with_suffix(".npy"), pose)
                picture.save(path, quality=80)
                print(path, flush=True)


def photograph(name: str, seed: int) -> tuple[np.ndarray, Image.Image]:
    """True pose and photograph of a scene."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    rng = np.random.default_rng((seed, list(SCENES).index(name)))
    mesh = SCENES[name]()
    pose = pose_in(name, mesh, rng)
    scene = {"type": "scene", "integrator": {"type": "path", "max_depth": 3}}
    scene |= _changed(mi, mesh, rng) | _added(mi, mesh, rng) | _lamps(name, mesh, rng)
    if name in {"part", "aeroplane"} and rng.random() < 0.7:
        scene["table"] = _table(mi, mesh, rng)
    scene["sensor"] = {
        "type": "perspective",
        "fov": 2 * np.degrees(np.arctan(CAMERA.width / 2 / CAMERA.fx)),
        "near_clip": 1e-4 * mesh.diagonal,
        "far_clip": 100 * mesh.diagonal,
        "to_world": mi.ScalarTransform4f(pose @ np.diag((-1.0, -1, 1, 1))),
        "film": {
            "type": "hdrfilm", "width": CAMERA.width, "height": CAMERA.height,
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": SAMPLES, "seed": seed},
    }  # fmt: skip
    return pose, _developed(np.array(mi.render(mi.load_dict(scene)))[..., :3], rng)


def _developed(light: np.ndarray, rng: np.random.Generator) -> Image.Image:
    """Picture of radiances: exposure, gamma, defocus, noise."""
    shown = np.clip(light / np.percentile(light, 95) * 0.8, 0, 1) ** (1 / 2.2)
    picture = Image.fromarray((255 * shown).astype(np.uint8))
    blurred = picture.filter(ImageFilter.GaussianBlur(rng.uniform(0, 1.2)))
    noisy = np.asarray(blurred) + rng.normal(size=shown.shape) * rng.uniform(1, 6)
    return Image.fromarray(np.clip(noisy, 0, 255).astype(np.uint8))


def _changed(mi: Any, mesh: rc.Mesh, rng: np.random.Generator) -> dict[str, Any]:
    """Shapes of a mesh, with a material for each; in half of the scenes a part is gone or moved."""
    parts = mesh.topology.components()
    labels = np.unique(parts)
    areas = np.array([mesh.areas[parts == label].sum() for label in labels])
    small = labels[areas < 0.1 * areas.sum()]
    vertices = np.array(mesh.vertices)
    kept = np.ones(mesh.n_faces, dtype=bool)
    if len(labels) > 6 and len(small) and rng.random() < 0.5:
        changed = parts == rng.choice(small)
        if rng.random() < 0.5:
            kept = ~changed
        else:
            vertices[np.unique(mesh.faces[changed])] += rng.normal(size=3) * 0.02 * mesh.diagonal
    group = rng.integers(0, MATERIALS, labels.max() + 1)[parts]
    shapes = {}
    for number in range(MATERIALS):
        own = np.flatnonzero((group == number) & kept)
        if len(own):
            shapes[f"mesh{number}"] = _shape(mi, vertices[mesh.faces[own]], mesh.diagonal, rng)
    return shapes


def _shape(mi: Any, corners: np.ndarray, size: float, rng: np.random.Generator) -> Any:
    """Shape of triangles (F, 3, 3), whose texture lies along the axes."""
    properties = mi.Properties()
    properties["face_normals"] = True
    properties["material"] = mi.load_dict(_material(mi, rng))
    n = len(corners)
    shape = mi.Mesh("mesh", 3 * n, n, has_vertex_texcoords=True, props=properties)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normals).argmax(axis=1)
    flat = np.stack([corners[range(n), :, (axis + step) % 3] for step in (1, 2)], axis=-1)
    values = mi.traverse(shape)
    values["vertex_positions"] = corners.astype(np.float32).ravel()
    values["vertex_texcoords"] = (flat / size).astype(np.float32).ravel()
    values["faces"] = np.arange(3 * n, dtype=np.uint32)
    values.update()
    return shape


def _material(mi: Any, rng: np.random.Generator) -> dict[str, Any]:
    """Metal, plastic, or something matt, plain or with a texture."""
    base = rng.uniform(0.15, 0.85)
    tint = np.clip(base + rng.normal(size=3) * 0.06, 0.03, 0.95)
    plain = {"type": "rgb", "value": tint.tolist()}
    kind = rng.integers(5)
    if kind == 0:
        inner = {"type": "roughconductor", "alpha": rng.uniform(0.2, 0.5)}
    elif kind == 1:
        inner = {
            "type": "roughplastic", "alpha": rng.uniform(0.1, 0.4), "diffuse_reflectance": plain,
        }  # fmt: skip
    else:
        textured = kind == 2
        inner = {"type": "diffuse", "reflectance": _texture(mi, tint, rng) if textured else plain}
    return {"type": "twosided", "inner": inner}


def _texture(mi: Any, tint: np.ndarray, rng: np.random.Generator) -> dict[str, Any]:
    """Tiles, stripes or blotches, up to a third darker."""
    n = 64
    row, column = np.indices((n, n))
    width = n // rng.integers(2, 9)
    marks = [
        (row // width + column // width) % 2,
        row // width % 2,
        np.kron(rng.random((n // 8, n // 8)), np.ones((8, 8))),
    ]
    image = tint * (1 - rng.uniform(0.1, 0.35) * marks[rng.integers(3)][..., None])
    scale = rng.uniform(2, 8)
    return {
        "type": "bitmap", "bitmap": mi.Bitmap(image.astype(np.float32)), "raw": True,
        "to_uv": mi.ScalarTransform4f().scale((scale, scale, 1)),
    }  # fmt: skip


def _added(mi: Any, mesh: rc.Mesh, rng: np.random.Generator) -> dict[str, Any]:
    """One to four things on the surface that the mesh does not have."""
    added = {}
    for number in range(rng.integers(1, 5)):
        face = rng.choice(mesh.n_faces, p=mesh.areas / mesh.areas.sum())
        size = mesh.diagonal * rng.uniform(0.02, 0.07)
        place = mi.ScalarTransform4f().translate(mesh.vertices[mesh.faces[face]].mean(axis=0))
        turned = place.rotate(rng.normal(size=3), rng.uniform(0, 360))
        is_box = rng.random() < 0.7
        sides = size * (rng.uniform(0.4, 1.2, 3) if is_box else np.array((0.3, 0.3, 1)))
        added[f"added{number}"] = {
            "type": "cube" if is_box else "cylinder",
            "to_world": turned.scale(sides),
            "material": _material(mi, rng),
        }
    return added


def _table(mi: Any, mesh: rc.Mesh, rng: np.random.Generator) -> dict[str, Any]:
    """Table under a part, or below it."""
    (low, high), size = mesh.bounds, mesh.diagonal
    drop = (0.3 if rng.random() < 0.5 else 0.002) * size
    place = (*((low + high) / 2)[:2], low[2] - drop)
    texture = _texture(mi, rng.uniform(0.2, 0.8, 3), rng)
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate(place).scale(3 * size),
        "material": {"type": "diffuse", "reflectance": texture},
    }


def _lamps(name: str, mesh: rc.Mesh, rng: np.random.Generator) -> dict[str, Any]:
    """One to three lamps, and light from all sides."""
    (low, high), size = mesh.bounds, mesh.diagonal
    bright = {"type": "rgb", "value": rng.uniform(0.05, 0.35)}
    lamps = {"sky": {"type": "constant", "radiance": bright}}
    for number in range(rng.integers(1, 4)):
        power = rng.uniform(0.5, 1)
        if name == "room":
            place = low + (high - low) * rng.uniform((0.2, 0.2, 0.85), (0.8, 0.8, 0.93))
            light = {"type": "rgb", "value": power * size**2 * 0.3}
            lamps[f"lamp{number}"] = {"type": "point", "position": place, "intensity": light}
            continue
        away = rng.normal(size=3)
        away[2] = abs(away[2]) + 0.4
        place = (low + high) / 2 + 1.5 * size * away / np.linalg.norm(away)
        if name == "house":
            place = rng.uniform((-12, -20, 8), (12, -8, 20))
        share = rng.uniform(0.03, 0.12)
        light = {"type": "rgb", "value": power * (0.12 / share) ** 2 * 8}
        lamps[f"lamp{number}"] = {
            "type": "sphere", "center": place, "radius": share * size,
            "emitter": {"type": "area", "radiance": light},
        }  # fmt: skip
    return lamps


if __name__ == "__main__":
    main()
