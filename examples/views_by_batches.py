"""Views of a part chosen step by step among many candidates that were judged at once.

    pip install gymnasium
    python examples/views_by_batches.py
    rastercov evaluate part.stl -c camera.toml -p sphere:1000000 --method sampled --bits bits
    python examples/views_by_batches.py bits

An action is the number of a candidate, and the reward the faces that it adds. The observation is
the faces that are covered, packed as in the folder, which is mapped and not read: a step takes
microseconds. With torch the gains of all candidates are computed in batches, on a GPU where there
is one.
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import rastercov as rc

Octets = NDArray[np.uint8]
Gains = NDArray[np.int64]
BATCH = 1 << 14
COUNTS = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1, dtype=np.uint8)
"""Bits of each octet."""


class ViewsByBatches(gymnasium.Env[Octets, np.int64]):
    """Candidates of a folder of bits, one taken per step.

    Parameters
    ----------
    bits : CoverageBits
        Faces that each candidate covers.
    views : int
        Steps of an episode.
    """

    def __init__(self, bits: rc.CoverageBits, views: int = 8) -> None:
        self.bits, self.views = bits, views
        n_candidates, width = bits.packed.shape
        self.action_space = gymnasium.spaces.Discrete(n_candidates)
        self.observation_space = gymnasium.spaces.Box(0, 255, (width,), np.uint8)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Octets, dict[str, Any]]:
        """Begin with no face covered."""
        super().reset(seed=seed)
        self.taken = 0
        self.done: Octets = np.zeros(self.observation_space.shape or (), np.uint8)
        return self.done.copy(), {}

    def step(self, action: np.int64) -> tuple[Octets, float, bool, bool, dict[str, Any]]:
        """Take a candidate."""
        new = self.bits.packed[action] & ~self.done
        self.done |= new
        self.taken += 1
        reward = float(COUNTS[new].sum(dtype=np.int64))
        return self.done.copy(), reward, False, self.taken == self.views, {}


def gains(bits: rc.CoverageBits, done: Octets) -> Gains:
    """Faces that each candidate would add, (P,)."""
    parts = [COUNTS[part & ~done].sum(axis=1, dtype=np.int64) for part in batches(bits)]
    return np.concatenate(parts)


def gains_by_torch(bits: rc.CoverageBits, done: Octets) -> Gains:
    """The same by torch, which takes the memory of each batch without a copy."""
    import torch

    device = "cuda" if torch.cuda.is_available() else "cpu"
    counts, left = (torch.from_dlpack(each.copy()).to(device) for each in (COUNTS, ~done))
    parts = [
        counts[(torch.from_dlpack(part).to(device) & left).long()].sum(dim=1, dtype=torch.int64)
        for part in batches(bits)
    ]
    return np.asarray(torch.cat(parts).cpu())


def batches(bits: rc.CoverageBits) -> list[Octets]:
    """Candidates, `BATCH` at a time, in memory of their own."""
    return [np.array(bits.packed[at : at + BATCH]) for at in range(0, len(bits.packed), BATCH)]


def of_a_teapot() -> rc.CoverageBits:
    """Candidates around a teapot."""
    mesh, camera = rc.shapes.teapot(), rc.Camera.load("khepra")
    poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 1.5 * mesh.diagonal, 300)
    return rc.evaluate(mesh, camera, poses, method="sampled", fields=("covered",)).bits


if __name__ == "__main__":
    bits = rc.CoverageBits.open(Path(sys.argv[1])) if len(sys.argv) > 1 else of_a_teapot()
    environment = ViewsByBatches(bits)
    done, _ = environment.reset()
    best = gains_by_torch if find_spec("torch") else gains
    for _ in range(environment.views):
        action = best(bits, done).argmax()
        done, reward, *_ = environment.step(action)
        print(f"candidate {action} adds {reward:.0f} faces")
    n_faces = len(bits.views)
    share = COUNTS[done].sum(dtype=np.int64) / n_faces
    print(f"{environment.taken} of {len(bits.packed)} views cover {100 * share:.1f} % of the faces")
