"""A base has one law in the engine and in the reference, and its inverse."""

import subprocess
from pathlib import Path

import numpy as np

import rastercov
from rastercov.engine import solver_lens


def check(command, folder):
    """Compile the equations of the copy; compare images with the twin, and rays with rays."""
    engine = Path(rastercov.__file__).parent / "engine"
    line = [
        "c++",
        "-std=c++20",
        "-ffp-contract=off",
        "-w",
        f"-I{engine}",
        f"-I{engine / 'include'}",
    ]
    program = folder / "rays"
    sources = [Path(__file__).with_name("rays.cpp"), engine / "lens" / "rounded.cpp"]
    subprocess.run([*line, *sources, "-o", program], check=True)
    done = subprocess.run([program], check=True, capture_output=True, text=True)
    code, *rows = done.stdout.splitlines()
    solver_lens.STEREOGRAPHIC = int(code)  # as the compiled modules name it with the sample
    from rastercov.reference import lenses

    X, Y, Z, x, y, *rays = np.array([list(map(float.fromhex, row.split())) for row in rows]).T
    twin = lenses.image_of_base(int(code), np.zeros(64), X, Y, Z)
    np.testing.assert_array_equal([x, y], twin)
    along = np.stack([X, Y, Z]) / np.linalg.norm([X, Y, Z], axis=0)
    np.testing.assert_allclose(np.stack(rays), along, atol=1e-9)
    half = np.arctan2(np.hypot(X, Y), Z) / 2
    np.testing.assert_allclose(np.hypot(x, y), 2 * np.tan(half), rtol=1e-9)
