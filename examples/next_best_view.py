"""Next best view as an environment of gymnasium, for learning where to look next.

    pip install gymnasium
    python examples/next_best_view.py

An episode takes views of a part one after the other. An action is a position on a shell around the
part, from which the camera looks at the middle. The reward is the share of the area that the view
adds, where each face counts with its best coverage over the views so far. So the return of an
episode is the share that all its views cover, which can be compared with `rastercov place` and its
bound. The observation is the best coverage of each face and the position of the last view.
"""

import time
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import rastercov as rc


class NextBestView(gymnasium.Env[dict[str, NDArray[Any]], NDArray[Any]]):
    """Views of a mesh from a shell, one per step.

    Parameters
    ----------
    mesh, camera, task
        As for `rastercov.evaluate`.
    distance : float
        Radius of the shell, metres.
    views : int
        Steps of an episode.
    """

    def __init__(
        self, mesh: rc.Mesh, camera: rc.Camera, task: rc.Task, distance: float, views: int = 8
    ) -> None:
        self.mesh, self.camera, self.task = mesh, camera, task
        self.middle, self.distance, self.views = mesh.bounds.mean(axis=0), distance, views
        self.weights = np.where(mesh.task_mask, mesh.areas, 0.0) / mesh.areas[mesh.task_mask].sum()
        self.action_space = gymnasium.spaces.Box(-1, 1, (3,), np.float64)
        self.observation_space = gymnasium.spaces.Dict(
            coverage=gymnasium.spaces.Box(0, 1, (mesh.n_faces,), np.float64),
            place=gymnasium.spaces.Box(-1, 1, (3,), np.float64),
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Begin without any view."""
        super().reset(seed=seed)
        self.taken, self.best, self.place = 0, np.zeros(len(self.weights)), np.zeros(3)
        return self._observed(), {}

    def step(
        self, action: NDArray[Any]
    ) -> tuple[dict[str, NDArray[Any]], float, bool, bool, dict[str, Any]]:
        """Take the view in the direction of an action, and from above for (0, 0, 0)."""
        ahead = action if np.any(action) else np.array((0.0, 0.0, 1.0))
        ahead = ahead / np.abs(ahead).max()
        self.place = ahead / np.linalg.norm(ahead)
        pose = rc.look_at(self.middle + self.distance * self.place, self.middle)
        scene = self.mesh, self.camera, pose, self.task
        result = rc.evaluate(*scene, by="face", fields=["coverage"])
        before, self.best = self.best, np.maximum(self.best, result.coverage[0])
        self.taken += 1
        reward = float(self.weights @ (self.best - before))
        return self._observed(), reward, bool(self.best.all()), self.taken == self.views, {}

    def _observed(self) -> dict[str, NDArray[Any]]:
        return {"coverage": self.best.copy(), "place": self.place}


if __name__ == "__main__":
    mesh = rc.shapes.teapot()
    size = float(np.ptp(mesh.bounds, axis=0).max())
    camera = rc.Camera.load("khepra")
    environment = NextBestView(mesh, camera, rc.Task(max_incidence_deg=75), 1.5 * size)
    environment.action_space.seed(0)
    began, returns = time.perf_counter(), []
    for _ in range(20):
        environment.reset()
        rewards = [environment.step(environment.action_space.sample())[1] for _ in range(8)]
        returns.append(sum(rewards))
    seconds = time.perf_counter() - began
    print(f"{len(returns) * 8 / seconds:.0f} steps per second, {mesh.n_faces} faces")
    print(f"8 random views cover {100 * np.mean(returns):.1f} % of the area")
