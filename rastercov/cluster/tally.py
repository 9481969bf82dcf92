"""Sums over the shards that workers made: where the time went."""

from dataclasses import dataclass, field
from typing import Any

from rastercov.base.format import plural
from rastercov.cluster.job import Made


@dataclass
class Tally:
    """Shards, poses and time of each worker.

    Attributes
    ----------
    by_worker : dict of str to list
        Shards, poses, seconds and CPU seconds of each worker process.
    """

    by_worker: dict[str, list[float]] = field(default_factory=dict)

    def add(self, made: Made) -> None:
        """Count a shard."""
        sums = self.by_worker.setdefault(made.worker, [0, 0, 0.0, 0.0])
        for place, value in enumerate((1, made.n_poses, made.seconds, made.cpu_seconds)):
            sums[place] += value

    def to_json(self) -> dict[str, Any]:
        """Sums by worker, ready for JSON; empty where no worker made a shard."""
        names = ("shards", "poses", "seconds", "cpu_seconds")
        return {
            worker: dict(zip(names, sums, strict=True))
            for worker, sums in sorted(self.by_worker.items())
        }

    def lines(self) -> list[str]:
        """A line for each worker, for people."""
        return [
            f"worker {worker}: {plural(int(shards), 'shard')}, {plural(int(poses), 'pose')}, "
            f"{seconds:.1f} s, of these {cpu:.1f} s on the CPU "
            f"({1e3 * cpu / max(1, poses):.2f} ms a pose)"
            for worker, (shards, poses, seconds, cpu) in sorted(self.by_worker.items())
        ]
