"""OpenGL under attack: coplanar assemblies, extreme cameras, many contexts.

On Mesa's software renderer, in all plans, against a reference that shares nothing with them:

- faces of one plane that overlap, 1e-13 m apart or touching: the lowest is seen, except in samples
  within 1/128 px of an edge;
- cameras with lenses and images far from any that was built: right, or refused in one line;
- contexts opened and closed: resident memory stays.

And by the plan "compute" beside the CPU, with atomics of 32 and of 64 bits, each in a process of
its own: counts, and bits by random thresholds, of scenes of each kind of `scenes_of_devices`.

Random scenes have fixed seeds. The assemblies are put to the CPU rasteriser, too.
"""

import json
import sys

import numpy as np
from contexts import MOST_KIB, OURS, growth_in_a_process
from coplanar_scenes import CAMERA, EDGE, GAP, SCENES, views, wrong_samples
from processes import TESTS, run_python
from rows import Report
from scenes_of_devices import FOUND

from rastercov.base.errors import RastercovError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.gl import PLANS, GLRasterizer
from rastercov.gl.context import HeadlessContext, open_context
from rastercov.reference import samples

SCENES_AT_FULL, CAMERAS_AT_FULL, ROUNDS_AT_FULL = 500, 150, 300
FEW_ROUNDS = 150
SCENES_OF_A_KIND = 17
ATOMICS = {32: "", 64: "+GL_NV_shader_atomic_int64"}
"""Bits, and the name by which Mesa has them."""


def wrong_on_overlaps(seed: int, context: HeadlessContext) -> dict[str, int]:
    """Wrong samples of each plan, and of the CPU, in two views of a random assembly."""
    rng = np.random.default_rng(seed)
    mesh = list(SCENES.values())[seed % len(SCENES)](rng)
    poses = views(rng, mesh)
    wrong = {}
    for plan in (*PLANS, "cpu"):
        with _open(plan, mesh, CAMERA, context) as rasterizer:
            images = [rasterizer.render(pose).face for pose in poses]
        wrong[plan] = sum(
            len(wrong_samples(mesh, CAMERA, pose, face))
            for pose, face in zip(poses, images, strict=True)
        )
    return wrong


def random_camera(rng: np.random.Generator) -> dict[str, float]:
    """Arguments of a camera with figures from anywhere between 1e-320 and 1e308."""
    sizes = (1, 2, 7, 64, 701, 16385, 30000)
    width, height = (int(rng.choice(sizes)) for _ in range(2))
    if width * height > 200_000:
        height = 1 + height % 3
    arguments_ = {"width": width, "height": height}
    spread = rng.choice((2.0, 5.0, 12.0, 300.0))
    arguments_["fx"] = float(max(width, height) * 10.0 ** rng.uniform(-spread, spread))
    arguments_["fy"] = float(arguments_["fx"] * 10.0 ** rng.choice((0, 0, rng.uniform(-3, 3))))
    if rng.random() < 0.5:
        arguments_["cx"] = float(rng.normal() * 10.0 ** rng.uniform(0, spread))
        arguments_["cy"] = float(rng.normal() * 10.0 ** rng.uniform(0, spread))
    return {name: v if np.isfinite(v) else 1e308 for name, v in arguments_.items()}


def wrong_through_camera(seed: int, context: HeadlessContext) -> dict[str, int]:
    """Wrong samples of each plan, -1 where it refused in one line, -2 where it failed otherwise."""
    rng = np.random.default_rng((7, seed))
    mesh = shapes.torus(16, 8)
    described = random_camera(rng)
    try:
        camera = Camera(**described)
    except RastercovError as error:
        return dict.fromkeys(PLANS, -1 if "\n" not in str(error) else -2)
    pose = look_at(rng.normal(size=3) * 3, rng.normal(size=3) * 0.3)[0]
    wrong = {}
    expected = None
    for plan in PLANS:
        try:
            with _open(plan, mesh, camera, context) as rasterizer:
                face = rasterizer.render(pose).face
                counts = rasterizer.count(pose)
        except RastercovError as error:
            wrong[plan] = -1 if "\n" not in str(error) else -2
            continue
        except Exception:
            wrong[plan] = -2
            continue
        if expected is None:
            expected = samples.render(mesh, camera, pose)
            clear = (expected.edge_distance > EDGE) & (expected.depth_gap > GAP)
        owned = np.bincount(face.ravel() + 1, minlength=mesh.n_faces + 1)[1:]
        wrong[plan] = int((face != expected.face)[clear].sum())
        wrong[plan] += int(np.abs(owned - counts.visible[0]).sum())
    return wrong


def compare_with_cpu(report: Report, n: int) -> None:
    """Counts and bits of n scenes of each kind, with both kinds of atomics."""
    for bits, override in ATOMICS.items():
        words = TESTS / "support" / "scenes_of_devices.py", "surfaceless", n, bits
        said = run_python(*words, timeout=3600, MESA_EXTENSION_OVERRIDE=override).stdout
        told = json.loads(said)
        what = f"{bits}-bit atomics"
        report.check(f"{what}: those that are in use", told["atomics"] == bits)
        for kind, found in told["found"].items():
            is_same = found["wrong"] == found["wrong_bits"] == 0
            named = f"{what}: {found['scenes']} scenes, {kind}: counts and bits as the CPU's"
            report.check(named, is_same)
        for name in FOUND:
            total = sum(found[name] for found in told["found"].values())
            at_most = 0.0 if name.startswith("wrong") else None
            report.add(f"{what}, all scenes: {name}", total, name, at_most=at_most)


def _open(plan: str, mesh: Mesh, camera: Camera, context: HeadlessContext):
    if plan == "cpu":
        return CPURasterizer(mesh, camera, threads=1)
    return GLRasterizer(mesh, camera, device=context, plan=plan)


def attack(report: Report, effort: float) -> None:
    """All of it; `effort` 1 is the full campaign, less is a part of it."""
    n_scenes = max(3, round(SCENES_AT_FULL * effort))
    n_cameras = max(5, round(CAMERAS_AT_FULL * effort))
    with open_context("surfaceless") as context:
        wrong = [wrong_on_overlaps(seed, context) for seed in range(n_scenes)]
        for plan in (*PLANS, "cpu"):
            total = sum(item[plan] for item in wrong)
            what = f"{n_scenes} coplanar assemblies, {plan}"
            report.add(f"{what}: wrong samples", total, "samples", at_most=0)
            report.check(f"{what}: the lowest face is seen", total == 0)

        wrongs = [wrong_through_camera(seed, context) for seed in range(n_cameras)]
        for plan in PLANS:
            answers = [one[plan] for one in wrongs]
            what = f"{n_cameras} extreme cameras, plan {plan}"
            report.add(f"{what}: refused in one line", answers.count(-1), "cameras")
            right = all(answer in (0, -1) for answer in answers)
            report.check(f"{what}: all others right", right)

    compare_with_cpu(report, max(1, round(SCENES_OF_A_KIND * effort)))
    if effort < 0.05:  # the noise of fewer rounds is larger than what may stay
        return
    rounds = max(FEW_ROUNDS, round(ROUNDS_AT_FULL * effort))
    for kind in OURS:
        kib = growth_in_a_process(kind, rounds)
        if isinstance(kib, str):
            print(f"{kind} is left out: {kib}", file=sys.stderr)
            continue
        what = f"{rounds} contexts, {kind}: resident memory that stays of each"
        report.add(what, kib["resident"], "KiB", at_most=MOST_KIB)
        report.check(f"{what} is below {MOST_KIB:g} KiB", kib["resident"] <= MOST_KIB)
