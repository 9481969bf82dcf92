"""Goals of a selection: the fewest cameras for a coverage, or the best coverage within limits."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Le

from rastercov.base.errors import ConfigError
from rastercov.base.typed import check_fields


@dataclass(frozen=True)
class FewestCameras:
    """Reach a coverage with the fewest cameras, or at the least cost.

    Attributes
    ----------
    coverage : float
        Share of the weight of all faces to cover, [0, 1].
    groups : mapping of str to float
        Share to cover of the weight of single groups, by name.
    of_reachable : bool
        True where shares are of the weight that all candidates together cover, not of the total.
    """

    coverage: Annotated[float, Ge(0), Le(1)] = 1.0
    groups: Mapping[str, Annotated[float, Ge(0), Le(1)]] = field(default_factory=dict)
    of_reachable: bool = False

    def __post_init__(self) -> None:
        check_fields(self)
        for name, share in {"coverage": self.coverage, **self.groups}.items():
            if not 0 <= share <= 1:
                raise ConfigError(f"the share to cover of {name} must be 0 to 1, got {share!r}")


@dataclass(frozen=True)
class BestCoverage:
    """Cover the most with a number of cameras, or within a budget.

    Attributes
    ----------
    cameras : int, optional
        Greatest number of cameras.
    budget : float, optional
        Greatest total cost.
    """

    cameras: int | None = None
    budget: Annotated[float, Ge(0)] | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.cameras is None and self.budget is None:
            raise ConfigError("best coverage needs a number of cameras or a budget; give one")
        if self.cameras is not None and (isinstance(self.cameras, bool) or self.cameras < 0):
            raise ConfigError(f"cameras must be 0 or more, got {self.cameras!r}")
        if self.budget is not None and not 0 <= self.budget < math.inf:
            raise ConfigError(f"budget must be 0 or more, and finite, got {self.budget!r}")


Goal = FewestCameras | BestCoverage
