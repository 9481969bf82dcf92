"""Shards of a motion in damaged and shared folders: the figures of one run, or one clear line.

`damaged` alters, cuts, exchanges or removes files of a folder of shards and makes the same call
again, `foreign` makes it in the folder of another motion or mesh, and `shared` twice at once. Each
gives regions that are those of one run to the bit, or one line.
"""

import hashlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from unittest import mock

import matrix_damage as damage
import numpy as np
from rows import Report

import rastercov as rc
from rastercov.base.errors import RastercovError
from rastercov.core.coverage import shards
from rastercov.core.mesh import shapes

FRAMES, DAMAGED, SHARED = 8, 400, 12
"""Frames of a motion, damaged folders and pairs of runs of the whole campaign."""
CAMERA = rc.Camera(width=64, height=48, fx=50, fy=50)
EYES = rc.look_at(np.array([[3.0, 0.5, 1], [0.4, 3, 1], [-2, -2, 2]]), np.zeros(3))
SCRIPT = "import sys, rows, attack_frames as a; print(a.bits(a.run(sys.argv[1])))"


def exchanged(folder: Path, other: Path, rng: np.random.Generator) -> str:
    """Two files change places."""
    one, two = rng.choice(damage.files_of(folder), 2, replace=False)
    first, second = one.read_bytes(), two.read_bytes()
    one.write_bytes(second)
    two.write_bytes(first)
    return f"{one.name} and {two.name} exchanged"


def foreign(folder: Path, other: Path, rng: np.random.Generator) -> str:
    """A file of another motion, every other time with its checksum."""
    own, theirs = (  # the shards of frames, of which there are more than of poses
        max(each.iterdir(), key=lambda result: len(damage.files_of(result)))
        for each in (folder, other)
    )
    path = rng.choice([each for each in damage.files_of(own) if each.suffix != ".sha256"])
    with_sum, into = bool(rng.integers(2)), path.relative_to(own)
    for each in (into, Path("sha256", f"{path.name}.sha256"))[: 1 + with_sum]:
        if (theirs / each).exists():
            shutil.copy(theirs / each, own / each)
    return f"{path.name} of another motion{', with its sum' * with_sum}"


KINDS = (
    damage.one_bit, damage.zeros, damage.cut, damage.longer, damage.garbage, damage.many_bits,
    damage.deleted, exchanged, foreign, foreign,
)  # fmt: skip
"""Ways to damage a folder, given another: each says what it did."""


def attack(report: Report, effort: float) -> None:
    """All of it; `effort` 1 is the whole campaign."""
    with tempfile.TemporaryDirectory() as name:
        base, wanted = Path(name), bits(run())
        whole, other = base / "whole", base / "other"
        right = bits(run(whole)) == wanted and bits(run(base / "by", workers=2)) == wanted
        report.check("shards of frames, and workers, give the bits of one run", right)
        differs = bits(run(other, shift=0.1))
        damaged(report, whole, other, wanted, max(len(KINDS), round(effort * DAMAGED)))
        shutil.copytree(whole, base / "both")
        alike = bits(run(base / "both", shift=0.1)) == differs and bits(run(whole)) == wanted
        report.check("a folder of another mesh is not taken for one's own", alike)
        shared(report, base, wanted, max(2, round(effort * SHARED)))


def run(folder: Path | str | None = None, shift: float = 0.0, workers: int = 0) -> rc.OverTime:
    """A ball that passes a box before three cameras, a frame a shard."""
    ball = shapes.sphere(1)
    away = rc.Mesh(ball.vertices * 0.4 + [0.9 + shift, 0, 0.2], ball.faces)
    mesh = rc.Mesh.joined([shapes.box((1, 1, 1)), away], names=["box", "ball"])
    motion = rc.Motion(mesh, {"ball": rc.conveyor(FRAMES, direction=(0, 1, 0), distance=1.5)})
    staff = rc.Workers(workers) if workers else None
    with mock.patch.object(shards, "PAIRS_A_SHARD", 1):
        result = rc.evaluate(mesh, CAMERA, EYES, motion=motion, fields=(), shards=(folder, staff))
        return result.over_time


def bits(over_time: rc.OverTime) -> str:
    """Hash of all arrays of the regions."""
    arrays = (getattr(over_time.regions, name) for name in shards.OF_REGIONS)
    return hashlib.sha256(b"".join(np.asarray(each).tobytes() for each in arrays)).hexdigest()


def damaged(report: Report, whole: Path, other: Path, wanted: str, count: int) -> None:
    """Damage any file of a folder, and make the call again."""
    rng, faults, refused = np.random.default_rng(2), [], 0
    for trial in range(count):
        folder = whole.with_name("damaged")
        shutil.copytree(whole, folder)
        what = KINDS[trial % len(KINDS)](folder, other, rng)
        try:
            faults += [f"{what}: other bits"] if bits(run(folder)) != wanted else []
        except RastercovError as error:
            refused += 1
            faults += [f"{what}: {error}"] if "\n" in str(error) else []
        except Exception as error:  # a fault, too
            faults.append(f"{what}: {type(error).__name__}: {error}")
        shutil.rmtree(folder)
    print("\n".join(faults), end="\n" * bool(faults), file=sys.stderr)
    report.add("damaged folders of frames", count, "folders")
    report.add("of these refused in a line", refused, "folders")
    report.add("damaged folders of frames: wrong", len(faults), "folders", at_most=0)
    report.check("a damaged folder of frames gives the same bits, or a line", not faults)


def shared(report: Report, base: Path, wanted: str, count: int) -> None:
    """Two processes at once in one folder: each has the figures, or finds the other at work."""
    faults, done = [], 0
    for trial in range(count):
        words = [sys.executable, "-c", SCRIPT, str(base / f"shared {trial}")]
        both = [
            subprocess.Popen(words, cwd=Path(__file__).parent, stdout=-1, stderr=-1, text=True)
            for _ in range(2)
        ]
        for out, said in (each.communicate() for each in both):
            last = said.strip().splitlines()[-1:]
            done += (is_right := out.strip() == wanted)
            if not is_right and (out or "another" not in "".join(last)):
                faults.append(f"{out}{said}")
    print("\n".join(faults), end="\n" * bool(faults), file=sys.stderr)
    report.add("pairs of runs in one folder", count, "pairs")
    report.add("runs of these that ended with the figures", done, "runs", must=count)
    report.check("two runs in one folder give the figures, or one finds the other", not faults)
