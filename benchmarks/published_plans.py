"""Camera plans for published models and set covers: ours beside the rule of their programs.

`published_plans.toml` names repository, commit and SHA-256 of each model. `--models FOLDER` has a
folder for each repository, by its name; what is missing or differs is named, and nothing of it is
kept here.
None of the repositories has poses for its models. So the other plan is by the rule that their
programs share: a view at a fixed distance in front of each face, chosen greedily by whole faces
that are not yet seen often enough. Sandia's planner and NeOF's resets do that; it
is our implementation. Ours has more distances to choose from, and selects by area. Both plans obey
the same limits of space and clearance, and are audited by exact area with the same task.

    python benchmarks/published_plans.py --models FOLDER --page docs/plans.md
"""

import hashlib
import sys
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pages_of_tables import earlier, write
from rows import Report, arguments
from set_cover_file import read_camera_cover, read_set_cover

import rastercov as rc
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.matrix import build_matrix
from rastercov.placement.select.methods import select_greedy, select_integer
from rastercov.placement.select.problem import BestCoverage, FewestCameras, problem_of

FILE = Path(__file__).with_suffix(".toml")
PROGRAM = "benchmarks/published_plans.py"
HEADER = [
    "| set | ours not worse | cameras, rule | area, rule, % | cameras, ours | area, ours, % "
    "| our bound |",
    "|---|---|---|---|---|---|---|",
]
COVERS = "Set covers of "
READERS = {"OR-Library": read_set_cover, "GECCO": read_camera_cover}
MOST_VIEWS = 150
"""Faces that views are in front of, at random, in sets of large meshes."""
PIXELS = 1000
TOUCHED, HALF_TO_ALL = 1e-9, (0.5, 0.7, 0.9)
"""Covered part of a patch from which it counts for the bound; for the choice, in this order."""
WHOLE = 0.999
"""Visible part of a face that counts as whole."""
SECONDS = 60
"""For the integer program of a set cover that greedy does not solve."""
Poses = NDArray[np.float64]


@dataclass
class Plan:
    """Both plans for a model: cameras, exact shares of the area, and our bound."""

    name: str
    theirs: int
    their_share: float
    ours: int
    share: float
    bound: float
    """Greatest share with as many cameras, or least number of cameras, of our candidates."""

    @property
    def is_better(self) -> bool:
        """True if ours covers as much with as many cameras."""
        return self.ours <= self.theirs and self.share >= self.their_share - 1e-12


@dataclass
class Site:
    """Model, camera and limits of a plan."""

    mesh: rc.Mesh
    camera: rc.Camera
    task: rc.Task
    space: PoseSpace
    distances: list[float]

    @classmethod
    def of(cls, path: Path, entry: dict[str, Any]) -> "Site":
        """Site of a model by its entry in the file."""
        mesh = rc.Mesh.load(path, unit="m")
        if mesh.is_closed and mesh.inside_out_mask.all():  # the horse of BENBV
            mesh = rc.Mesh(mesh.vertices, mesh.faces[:, ::-1])
        diagonal = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        distances = entry.get("distance") or [d * diagonal for d in entry["distance_rel"]]
        boxes = np.clip(entry["space"], -1e6, 1e6) if "space" in entry else None
        clearance = entry.get("clearance", 0.9 * min(distances))
        return cls(
            mesh,
            rc.Camera.from_fov(PIXELS, PIXELS, hfov_deg=entry["hfov_deg"]),
            rc.Task(max_incidence_deg=entry["max_incidence_deg"], views=entry.get("views", 1)),
            PoseSpace(
                mesh=mesh, boxes=boxes, stand_off=(0.0, 2 * max(distances)), clearance=clearance
            ),
            distances,
        )

    def in_front(self, faces: NDArray[np.int64], distance: float) -> Poses:
        """Views of faces along their normals, of both sides, where cameras are allowed."""
        normals = self.mesh.normals[faces] * distance
        centres = self.mesh.centroids[faces]
        sides = [normals] if self.mesh.is_closed_outward else [normals, -normals]
        eyes = np.concatenate([centres + side for side in sides])
        allowed = self.space.allows(eyes)
        return rc.look_at(eyes[allowed], np.concatenate([centres] * len(sides))[allowed])

    def share(self, poses: Poses) -> float:
        """Exact share of the area that enough of the cameras cover."""
        regions = rc.regions(self.mesh, self.camera, poses, self.task)
        return rc.unite(regions, self.task.views).share(self.task.views)


def by_whole_faces(site: Site, poses: Poses, most: int) -> Poses:
    """Views chosen greedily by the whole faces that they add, until none adds any."""
    task = rc.Task(max_incidence_deg=site.task.max_incidence_deg, min_visibility=WHOLE)
    matrix = build_matrix((site.mesh, site.camera), poses, task)
    covers = np.zeros((len(poses), site.mesh.n_faces), np.float32)
    covers[np.repeat(np.arange(len(poses)), np.diff(matrix.indptr)), matrix.face] = 1
    missing, chosen = np.full(site.mesh.n_faces, site.task.views), []
    while len(chosen) < most:
        gains = covers @ np.maximum(2 * missing - 1, 0).astype(np.float32)
        gains[chosen] = 0
        if gains.max() <= 0:
            break
        chosen.append(int(gains.argmax()))
        missing -= covers[chosen[-1]].astype(int)
        missing = np.maximum(missing, 0)
    return poses[chosen]


def planned(name: str, path: Path, entry: dict[str, Any]) -> Plan:
    """Both plans for a model."""
    site = Site.of(path, entry)
    mesh, rng = site.mesh, np.random.default_rng(0)
    limit = entry.get("cameras")
    faces = rng.permutation(np.flatnonzero(mesh.areas > 0))[: MOST_VIEWS if limit else None]
    front = site.in_front(faces, site.distances[0])
    theirs = by_whole_faces(site, front, limit or len(front))
    their_share = site.share(theirs)
    pool = [theirs, *(site.in_front(faces[:MOST_VIEWS], d) for d in site.distances)]
    pool += [site.in_front(faces[MOST_VIEWS:], site.distances[0])]
    poses = np.concatenate(pool)
    cells = rc.cells(mesh, 0.03 * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))))
    matrix = build_matrix((mesh, site.camera), poses, site.task, cells=cells)
    goal = BestCoverage(limit) if limit else FewestCameras(their_share)
    # Patches of which a view sees anything count for the bound, so that it holds for exact areas.
    bound = select_greedy(problem_of(matrix, cells, goal, min_coverage=TOUCHED), effort=0).bound
    for least in HALF_TO_ALL:
        result = poses[select_greedy(problem_of(matrix, cells, goal, min_coverage=least)).chosen]
        share = site.share(result)
        if share >= their_share:
            break
    if not limit:  # as many, in greedy order, as reach their area
        result = result[: fewest(lambda n: site.share(result[:n]) >= their_share, len(result))]
        share = site.share(result)
    return Plan(name, len(theirs), their_share, len(result), share, bound)


def fewest(suffices: Callable[[int], bool], most: int) -> int:
    """Least number that suffices, if more suffice, too; `most` if none does."""
    low, high = 1, most
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if suffices(middle) else (middle + 1, high)
    return low


def found_in(folder: Path, name: str, files: dict[str, str], missing: list[str]) -> list[Path]:
    """Files of a repository that are as named; the others are added to `missing`."""
    items = []
    for path, digest in files.items():
        file = folder / name / path
        if not file.is_file():
            missing.append(f"{name}: {path}")
        elif hashlib.sha256(file.read_bytes()).hexdigest() != digest:
            missing.append(f"{name}: {path} differs from the named version")
        else:
            items.append(file)
    return items


def line_of_set(report: Report, entry: dict[str, Any], plans: list[Plan]) -> str:
    """A line of the table: ranges over the models of a set."""
    better = sum(plan.is_better for plan in plans)
    report.add(f"{entry['name']}: plans that are better", better, f"of {len(plans)}")

    def span(values: list[float], form: str) -> str:
        low, high = (form.format(each) for each in (min(values), max(values)))
        return low if low == high else f"{low}–{high}"

    bounds = [plan.bound for plan in plans]
    cells = [
        entry["name"],
        f"{better} of {len(plans)}",
        span([plan.theirs for plan in plans], "{}"),
        span([100 * plan.their_share for plan in plans], "{:.1f}"),
        span([plan.ours for plan in plans], "{}"),
        span([100 * plan.share for plan in plans], "{:.1f}"),
        f"≤ {span([100 * each for each in bounds], '{:.1f}')} %"
        if "cameras" in entry
        else f"≥ {span(bounds, '{:.0f}')} cameras",
    ]
    return f"| {' | '.join(cells)} |"


def covers(report: Report, folder: Path, entry: dict[str, Any], missing: list[str]) -> str:
    """Set covers beside the best-known costs: a line."""
    files = {f"{entry['folder']}/{name}": digest for name, (_, digest) in entry["files"].items()}
    name = entry["repository"].rpartition("/")[2]
    equal, above = 0, []
    for file in found_in(folder, name, files, missing):
        best = entry["files"][file.name][0]
        problem = READERS[entry["format"]](file)
        selection = select_greedy(problem)
        if selection.objective > best:
            selection = select_integer(problem, time_limit=SECONDS)
        equal += selection.objective <= best
        print(
            f"{file.name}: {selection.objective:g}, best known {best}", file=sys.stderr, flush=True
        )
        if selection.objective > best:
            above.append(f"{file.stem} {selection.objective:g} instead of {best}")
    n = equal + len(above)
    report.add(f"{entry['name']}: covers of the best-known cost", equal, f"of {n}")
    more = f"; otherwise: {', '.join(above)}" if above else ""
    return f"{COVERS}{entry['name']}: the best-known cost in {equal} of {n}{more}."


def plans_of(entry: dict[str, Any], files: list[Path]) -> list[Plan]:
    """Plans of the models of a set."""
    plans = []
    for file in files:
        started = time.monotonic()
        own = entry.get("own", {}).get(file.name, {})
        name = file.parent.name if file.stem == "visual_geometry" else file.stem
        plans.append(planned(name, file, entry | own))
        print(f"{plans[-1]}, {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
    return plans


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--models", type=Path, required=True, metavar="FOLDER")
    known = tomllib.loads(FILE.read_text(encoding="utf-8"))
    names = [entry["name"] for entry in (*known["sets"], *known["covers"])]
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    parser.add_argument("--quick", action="store_true", help="three models of each set")
    parser.add_argument("--page", type=Path, help="rewrite the rows of these sets in this page")
    args = parser.parse_args()
    report, missing = Report(), list[str]()
    lines = list(HEADER)
    for entry in known["sets"]:
        row = earlier(args.page, f"| {entry['name']} ")
        if entry["name"] in args.only:
            repository = entry["repository"].rpartition("/")[2]
            files = found_in(args.models, repository, entry["files"], missing)
            plans = plans_of(entry, files[: 3 if args.quick else None])
            row = [line_of_set(report, entry, plans)] if plans else row
        lines += row
    covered = []
    for entry in known["covers"]:
        if entry["name"] in args.only:
            covered.append(covers(report, args.models, entry, missing))
        else:
            covered += earlier(args.page, f"{COVERS}{entry['name']}:")
    print("\n".join([*lines, "", *covered, *(f"missing: {each}" for each in missing)]))
    if args.page:
        write(args.page, PROGRAM, "\n".join([*lines, "", *covered]))
    if not args.json:  # the table has them
        report.rows = []
    report.finish(args.json)


if __name__ == "__main__":
    main()
