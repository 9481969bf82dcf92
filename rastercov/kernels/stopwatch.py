"""Time that a job takes; rates are made of it."""

import time


class Stopwatch:
    """Seconds since it was made, without those in which this process compiled loops.

    Attributes
    ----------
    left_out : float
        Seconds of compilation since the process began; `rastercov.kernels.jit` adds them.
    """

    left_out = 0.0

    def __init__(self) -> None:
        self._began = time.perf_counter() - Stopwatch.left_out

    @property
    def seconds(self) -> float:
        """Seconds so far."""
        return time.perf_counter() - Stopwatch.left_out - self._began
