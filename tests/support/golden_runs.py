"""Answers of every command on six scenes, compared with those of later versions.

`python tests/support/golden_runs.py` writes the answers to tests/golden/ anew; do it only where a
figure was wrong or a key was added, and list that in CHANGELOG.md. Times, versions and
devices are replaced by the names of their types. Bits are compared by benchmarks/before_after.py,
between two checkouts on one machine: the last digits of a product of matrices depend on the CPU.
"""

import contextlib
import io
import json
import math
import os
import re
import shlex
import sys
import tempfile
import zlib
from pathlib import Path

import numpy as np
import pyarrow.parquet
import trimesh

import rastercov as rc
from rastercov import cli
from rastercov.core.mesh import shapes

GOLDEN = Path(__file__).parents[1] / "golden"
DIGITS = 10
HISTOGRAMS = ("errors", "ratios")
VOLATILE = {"poses_per_second", "versions", "rastercov", "machine", "renderer", "driver", "sha256"}
"""And every key with "seconds" in it."""
CAMERA = "width = 120\nheight = 90\nfx = 110\nfy = 110\n"
PLAN = """
meshes = [{path = "part.obj", unit = "mm"}]
camera = {width = 96, height = 72, fx = 90, fy = 90}
task = {min_pixels = 2}
candidates = [{generator = "on_sphere", count = 20, distances = [0.0035]}]
constraints = {clearance = 1e-4}
selection = {goal = "fewest_cameras", coverage = 0.9}
outputs = {page = false}
"""
BOW_TIE = ((-3, -3), (1, 1), (1, -1), (-3, 3))
_SCENES = {
    "part": "part.obj --unit mm -c camera.toml -p sphere:4",
    "teapot": "teapot-5 -c camera.toml -p sphere:3",
    "torus": "torus -c camera.toml -p sphere:2",
    "room": "room -c camera.toml -p room.json",
    "aeroplane": "aeroplane-9856 -c khepra -p sphere:2",
    "bow_tie": "bow_tie.stl -c camera.toml -p sphere:3",
}
RUNS = {
    f"{scene}_{name}": line.format(arguments)
    for scene, arguments in _SCENES.items()
    for name, line in {
        "evaluate": "evaluate {} --pictures 1 --min-pixels 2 --table seen --json -o out",
        "sampled": "evaluate {} --pictures 0 --method sampled --device cpu --supersample 2 "
        "--max-incidence-deg 70 --views 2 --table seen --json -o out",
        "render": "render {} --device cpu --pose 1 --json -o out",
    }.items()
} | {
    "part_thesis": "evaluate part.obj --unit mm -c lens.toml -p sphere:4 --thesis --two-sided lid "
    "--occluder rest --pictures 0 --table seen --json -o out",
    "teapot_compare": "compare teapot-5 -c camera.toml -p sphere:2 --faces 2 --method certified "
    "--method sampled:cpu@2 --json -o out",
    "part_polygons": "compare part.obj -c camera.toml -p sphere:2 --unit mm --against polygons "
    "--method exact --method sampled:cpu --no-convergence --json -o out",
    "part_models": "compare part.obj -c lens.toml -p sphere:3 --unit mm --models --json -o out",
    "bow_tie_models": "compare bow_tie.stl -c lens.toml -p sphere:3 --models --json -o out",
    "place": "place plan.toml --json -o out",
    "check": "check plan.toml -p rig.json --json",
    "check_falls_short": "check plan.toml -p poor.json --views 2 --group lid=1.0 --json "
    "--junit out/junit.xml",
    "demo": "demo --shape teapot-5 --poses 2 --device cpu --json -o out",
    "markers": "validate markers --json -o out",
    "no_such_camera": "evaluate torus -c nothing.toml -p sphere:2 -o out",
    "bad_pose": "evaluate torus -c camera.toml -p bad.npy -o out",
    "skip_bad_pose": "evaluate box -c camera.toml -p bad.npy --skip-bad-poses --pictures 0 --json "
    "--table seen -o out",
    "no_such_option": "evaluate torus --colour red",
}
NEEDS_CV2 = ("markers",)


def answer(name: str) -> dict:
    """Exit code, JSON of standard output, and what lies in the folder, of one run."""
    out, errors = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        write_inputs()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
            code = cli.command(shlex.split(RUNS[name]))
        files = {
            # Hashes of versions, too, name some folders.
            re.sub("/[0-9a-f]{16}/", "/hash/", path.relative_to("out").as_posix()): of_file(path)
            for path in sorted(Path("out").rglob("*"))
            if path.is_file() and not path.name.startswith(".")
        }
    text = out.getvalue()
    printed = json.loads(text) if text.startswith(("{", "[")) else text
    return {"code": code, "printed": settled(printed), "files": files}


def write_inputs() -> None:
    """Meshes, cameras, poses and a plan, in the current folder."""
    Path("out").mkdir()
    box = shapes.box((1, 1, 1))
    lines = [f"v {x} {y} {z}" for x, y, z in box.vertices]
    for index, face in enumerate(box.faces + 1):
        lines += ["g lid"] if index == 0 else ["g rest"] if index == 2 else []
        lines.append("f " + " ".join(map(str, face)))
    Path("part.obj").write_text("\n".join(lines) + "\n")
    # A closed prism that crosses itself.
    ring, turn = np.array(BOW_TIE, float), np.arange(4)
    points = np.concatenate([np.column_stack((ring, np.full(4, z))) for z in (-1, 1)])
    after = np.roll(turn, -1)
    sides = [
        *zip(turn, after, turn + 4, strict=True),
        *zip(after, after + 4, turn + 4, strict=True),
    ]
    faces = [*sides, (4, 5, 6), (4, 6, 7), (0, 2, 1), (0, 3, 2)]
    trimesh.Trimesh(points, faces, process=False).export("bow_tie.stl", file_type="stl_ascii")
    Path("camera.toml").write_text(CAMERA)
    Path("lens.toml").write_text(
        CAMERA + "pixel_size = [1e-5, 1e-5]\nfocal_length = 1.1e-3\naperture = 5e-4\n"
        "focus_distance = 0.004\n"
    )
    Path("plan.toml").write_text(PLAN)
    rng = np.random.default_rng(7)
    room = shapes.room()
    low, high = room.bounds
    within = low + (high - low) * rng.uniform(0.2, 0.8, (2, 3, 3))
    rc.write_poses("room.json", rc.look_at(*within))
    ends = 0.0035 * np.concatenate((np.eye(3), -np.eye(3)))
    rc.write_poses("rig.json", rc.look_at(ends, np.zeros(3)))
    rc.write_poses("poor.json", rc.look_at(ends[:2], np.zeros(3)))
    bad = rc.look_at(1000 * ends, np.zeros(3))
    bad[3, 0, 0] += 0.5
    np.save("bad.npy", bad)


def of_file(path: Path) -> object:
    """Content of a file that must not change: figures of JSON, columns of a table, arrays."""
    if path.suffix == ".json":
        return settled(json.loads(path.read_text()))
    if path.suffix == ".parquet":
        table = pyarrow.parquet.read_table(path)
        return {name: [str(table.schema.field(name).type), *sums(table[name].to_numpy())]
                for name in table.column_names}  # fmt: skip
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return {name: [str(arrays[name].dtype), *arrays[name].shape, *sums(arrays[name])]
                    for name in arrays.files if name != "of"}  # fmt: skip # the header
    return path.suffix


def sums(values: np.ndarray) -> list[float]:
    """Count of finite values, their sum, and a sum that depends on their order."""
    if values.dtype.kind not in "biuf":
        values = np.array([zlib.crc32(str(value).encode()) for value in values.ravel()])
    flat = np.asarray(values, np.float64).ravel()
    flat = np.where(np.isfinite(flat), flat, 0.0)
    order = np.cos(np.arange(len(flat)))
    return [int(np.count_nonzero(flat)), settled(float(flat.sum())), settled(float(flat @ order))]


def settled(value: object, key: str = "") -> object:
    """JSON without what differs from run to run, numbers rounded."""
    if key in VOLATILE or "seconds" in key:
        return type(value).__name__
    if key in HISTOGRAMS:  # most of their bins hold errors of the size of rounding
        return sum(count for _, count in value)
    if isinstance(value, dict):
        return {name: settled(each, name) for name, each in value.items()}
    if isinstance(value, list):
        return [settled(each) for each in value]
    if isinstance(value, float) and math.isfinite(value) and value:
        return round(value, DIGITS - 1 - math.floor(math.log10(abs(value))))
    return value


def main() -> None:
    """Write the answers of all runs, or of those named."""
    for name in sys.argv[1:] or RUNS:
        text = json.dumps(answer(name), indent=1, sort_keys=True)
        (GOLDEN / f"{name}.json").write_text(text + "\n")
        print(name, len(text))


if __name__ == "__main__":
    os.environ.pop("RASTERCOV_TRACEBACK", None)
    main()
