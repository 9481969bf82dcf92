"""Pictures of docs/concepts.md, from the library's own figures.

    python docs/pictures.py

One floor, one crate that hides, one camera; all lengths are metres.
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch, Polygon
from PIL import Image

import rastercov as rc
from rastercov import shapes

FOLDER = Path(__file__).parent / "pictures"
SIZE = (8.0, 6.0)
EYE, TARGET = (0.8, 0.9, 2.9), (4.6, 3.3, 0.0)
CRATE = ((1.2, 1.0, 1.1), (4.3, 2.6, 0.55))
CAMERA = rc.Camera.from_fov(1280, 960, hfov_deg=68)
POSE = rc.look_at(eyes=[EYE], targets=TARGET)
TASK = rc.Task(max_incidence_deg=65, min_pixels_per_m2=26_000)
SEEN, GOOD, DIM, BAD, INK = "#9ecae1", "#2b8a5b", "#e4e7eb", "#d1495b", "#1b2129"
plt.rcParams.update({"font.size": 11, "savefig.dpi": 110, "savefig.bbox": "tight"})


def scene(points: np.ndarray, faces: np.ndarray) -> rc.Mesh:
    """Floor of these triangles, which is scored, and the crate, which hides."""
    crate = shapes.box(CRATE[0], centre=CRATE[1])
    vertices = np.concatenate([np.column_stack([points, np.zeros(len(points))]), crate.vertices])
    every = np.concatenate([faces, crate.faces + len(points)])
    of_crate = np.arange(len(every)) >= len(faces)
    groups = [rc.Group("floor"), rc.Group("crate", is_occluder=True)]
    return rc.Mesh(vertices, every, groups, face_group=of_crate.astype(np.int64))


def grid(columns: int, rows: int) -> rc.Mesh:
    """Floor of columns x rows quads, two triangles each."""
    x, y = np.meshgrid(np.linspace(0, SIZE[0], columns + 1), np.linspace(0, SIZE[1], rows + 1))
    corner = np.arange(rows * (columns + 1)).reshape(rows, -1)[:, :-1].ravel()
    quads = np.stack([corner, corner + 1, corner + columns + 2, corner + columns + 1], 1)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return scene(np.column_stack([x.ravel(), y.ravel()]), faces)


def scattered(count: int) -> rc.Mesh:
    """Floor of triangles between random points."""
    from matplotlib.tri import Triangulation

    points = np.random.default_rng(4).uniform((0, 0), SIZE, (count, 2))
    corners = np.array([(0, 0), (SIZE[0], 0), SIZE, (0, SIZE[1])], float)
    points = np.concatenate([corners, points])
    found = Triangulation(*points.T)
    return scene(points, found.triangles.astype(np.int64))


def floor_pieces(mesh: rc.Mesh, task: rc.Task) -> tuple[list[np.ndarray], float]:
    """Parts that the camera covers of the floor, as polygons of the plan, and its share."""
    found = rc.regions(mesh, CAMERA, POSE, task)
    points = found.points()[:, :2]
    return np.split(points, found.starts[1:-1]), 100 * rc.unite(found).share()


def plan_of(ax: Axes, title: str) -> None:
    """Floor, crate and camera from above."""
    (dx, dy, _), (cx, cy, _) = CRATE
    crate = [(cx - dx / 2, cy - dy / 2), (cx + dx / 2, cy - dy / 2), (cx + dx / 2, cy + dy / 2)]
    crate.append((cx - dx / 2, cy + dy / 2))
    ax.add_patch(Polygon(crate, fc="#c9b38c", ec=INK, zorder=4))
    ax.text(cx, cy, "crate", ha="center", va="center", zorder=5, fontsize=9)
    ax.plot(*EYE[:2], "o", color=INK, zorder=6)
    aim = np.subtract(TARGET, EYE)[:2]
    ax.annotate(
        "", EYE[:2] + 0.28 * aim, EYE[:2], arrowprops={"arrowstyle": "->", "lw": 1.6}, zorder=6
    )
    ax.set(xlim=(-0.05, SIZE[0] + 0.05), ylim=(-0.05, SIZE[1] + 0.05), aspect="equal", title=title)
    ax.set_xticks([])
    ax.set_yticks([])
    for side in ax.spines.values():
        side.set_visible(False)


def outlines(pieces: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Borders of the union of polygons, and those of its holes."""
    whole = shapely.union_all([shapely.Polygon(piece).buffer(1e-6) for piece in pieces])
    parts = getattr(whole, "geoms", [whole])
    holes = [np.array(hole.coords) for part in parts for hole in part.interiors]
    return [np.array(part.exterior.coords) for part in parts], holes


def fill(ax: Axes, pieces: list[np.ndarray], colour: str) -> None:
    """Polygons without lines between them."""
    borders, holes = outlines(pieces)
    ax.add_collection(PolyCollection(borders, fc=colour, ec="none"))
    ax.add_collection(PolyCollection(holes, fc=DIM, ec="none"))


def save(figure: plt.Figure, name: str) -> None:
    """Write a picture of 64 colours, and say so."""
    path = FOLDER / f"{name}.png"
    FOLDER.mkdir(exist_ok=True)
    figure.savefig(path, facecolor="white")
    plt.close(figure)
    Image.open(path).convert("RGB").quantize(64).save(path, optimize=True)
    print(path)


def visible_and_covered() -> None:
    """Parts of the floor that the camera sees, and those that it covers."""
    mesh = grid(1, 1)
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    floor = [np.array([(0, 0), (SIZE[0], 0), SIZE, (0, SIZE[1])])]
    seen, seen_share = floor_pieces(mesh, rc.Task())
    covered, covered_share = floor_pieces(mesh, TASK)
    for ax in axes:
        fill(ax, floor, DIM)
        fill(ax, seen, SEEN)
    fill(axes[1], covered, GOOD)
    plan_of(axes[0], f"visible: {seen_share:.1f} % of the floor")
    plan_of(axes[1], f"covered: {covered_share:.1f} %")
    keys = [Patch(fc=GOOD, label="covered"), Patch(fc=SEEN, label="visible, too few pixels per m²")]
    keys[:0] = [Patch(fc=DIM, label="outside the image, or behind the crate")]
    figure.legend(handles=keys, loc="outside lower center", ncols=3, frameon=False)
    save(figure, "visible_covered")


def by_face_and_by_area() -> None:
    """The same floor in other triangles: whole faces that are covered, and the covered area."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.9), layout="constrained")
    for ax, mesh in zip(axes, (grid(4, 3), scattered(150), grid(32, 24)), strict=True):
        found = rc.evaluate(mesh, CAMERA, POSE, TASK, by="face")
        floor = mesh.task_mask
        triangles = mesh.vertices[mesh.faces[floor]][:, :, :2]
        whole = found.coverage[0][floor] >= TASK.min_coverage
        area = np.abs(np.linalg.det(triangles[:, 1:] - triangles[:, :1]))
        ax.add_collection(
            PolyCollection(triangles, fc=np.where(whole, "#8fcaa9", DIM), ec="white", lw=0.5)
        )
        pieces, share = floor_pieces(mesh, TASK)
        for border in outlines(pieces)[0]:
            ax.plot(*border.T, color=GOOD, lw=2, zorder=3)
        faces = 100 * area[whole].sum() / area.sum()
        plan_of(ax, f"{len(triangles)} faces\nwhole faces {faces:.1f} %, area {share:.3f} %")
    keys = [Patch(fc="#8fcaa9", label="faces that are covered as a whole")]
    keys.append(plt.Line2D([], [], color=GOOD, lw=2, label="covered area, exact"))
    figure.legend(handles=keys, loc="outside lower center", ncols=2, frameon=False)
    save(figure, "by_area")


def bound() -> None:
    """Visible fraction of one face by samples, with its bound, beside the exact one."""
    mesh = grid(4, 3)
    exact = rc.visibility(mesh, CAMERA, POSE)
    partly = (exact.value[0] > 0.1) & (exact.value[0] < 0.9) & mesh.task_mask
    face = int(np.flatnonzero(partly)[0])
    truth = float(exact.value[0, face])
    widths = [20, 40, 80, 160, 320, 640, 1280, 2560]
    values, bounds = [], []
    for width in widths:
        camera = rc.Camera.from_fov(width, width * 3 // 4, hfov_deg=68)
        found = rc.visibility(mesh, camera, POSE, method="sampled:cpu")
        values.append(found.value[0, face])
        bounds.append(found.bound[0, face])
    figure, ax = plt.subplots(figsize=(7.5, 3.8), layout="constrained")
    ax.axhline(
        truth, color=GOOD, lw=2, label=f"certified, {truth:.6f} within {exact.bound[0, face]:.0e}"
    )
    ax.errorbar(
        widths, values, yerr=bounds, fmt="o", color=INK, capsize=4, label="sampled, with its bound"
    )
    ax.set(
        xscale="log",
        xlabel="width of the image, px",
        ylabel="visible fraction of one face",
        ylim=(0.55, 1.05),
    )
    ax.set_xticks(widths, map(str, widths))
    ax.minorticks_off()
    ax.legend(frameon=False, loc="lower right")
    ax.spines[["top", "right"]].set_visible(False)
    save(figure, "bound")


def certificate() -> None:
    """Faces that are proved wholly visible or hidden, and those that are computed."""
    mesh = shapes.teapot(8)
    camera = rc.Camera.from_fov(1280, 860, hfov_deg=30)
    middle = mesh.bounds.mean(axis=0)
    pose = rc.look_at(eyes=[np.add(middle, (0.42, 0.30, 0.30))], targets=middle)
    found = rc.visibility(mesh, camera, pose)
    computed = found.kind[0] == rc.BoundKind.EXACT
    with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        face = rasterizer.render(pose[0]).face
    palette = np.where(computed[:, None], (209, 73, 91), (158, 202, 225))
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = pose[0][:3, 3] - corners.mean(axis=1)
    is_front = (normal * towards).sum(1) > 0
    light = np.abs((normal * towards).sum(1)) / np.linalg.norm(normal, axis=1).clip(1e-12)
    light = 0.62 + 0.38 * light / np.linalg.norm(towards, axis=1)
    picture = np.where((face >= 0)[..., None], (palette * light[:, None])[face], 255)
    edge = np.zeros(face.shape, bool)
    edge[:, 1:] |= face[:, 1:] != face[:, :-1]
    edge[1:] |= face[1:] != face[:-1]
    picture[edge & (face >= 0)] *= 0.82
    n_proved, n_computed = (~computed & is_front).sum(), (computed & is_front).sum()
    largest = found.bound[0][computed & is_front].max()
    figure, ax = plt.subplots(figsize=(8, 5.2), layout="constrained")
    ax.imshow(picture.astype(np.uint8))
    ax.axis("off")
    proved = f"{n_proved:,} faces proved wholly visible or wholly hidden: bound 0"
    keys = [Patch(fc=SEEN, label=proved)]
    keys.append(Patch(fc=BAD, label=f"{n_computed:,} faces computed: bound {largest:.0e} at most"))
    figure.legend(handles=keys, loc="outside lower center", ncols=1, frameon=False)
    save(figure, "certificate")


def sure_and_possible() -> None:
    """Parts of the floor that are covered under any errors, as planned, and with some errors."""
    from rastercov.tolerances.passes import Errors, TolerancePass

    mesh, task = grid(1, 1), rc.Task(max_incidence_deg=65)
    poses = rc.Poses.of(POSE)
    sizes = Errors(position_mm=120, angle_deg=2).sizes(CAMERA, poses, np.zeros(3))
    finder = TolerancePass(mesh, CAMERA, task)
    planned = finder.nominal.find(poses)
    sure = finder.sure(poses, sizes, planned)
    possible = finder.possible(poses, sizes, sure.nearest)
    figure, ax = plt.subplots(figsize=(7.5, 5.6), layout="constrained")
    fill(ax, [np.array([(0, 0), (SIZE[0], 0), SIZE, (0, SIZE[1])])], DIM)
    for found, colour in ((possible.regions, "#fde2b3"), (planned, SEEN), (sure.regions, GOOD)):
        fill(ax, np.split(found.points()[:, :2], found.starts[1:-1]), colour)
    plan_of(ax, "one camera, errors of 120 mm and 2 degrees")
    words = (
        "covered under any errors",
        "covered as planned",
        "covered only with some errors",
    )
    colours = (GOOD, SEEN, "#fde2b3")
    keys = [Patch(fc=fc, label=label) for fc, label in zip(colours, words, strict=True)]
    figure.legend(handles=keys, loc="outside lower center", ncols=3, frameon=False)
    save(figure, "tolerance")


if __name__ == "__main__":
    visible_and_covered()
    by_face_and_by_area()
    bound()
    certificate()
    sure_and_possible()
