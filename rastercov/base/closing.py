"""Base class of context managers that are closed with `close()`."""

from abc import ABC, abstractmethod
from typing import NoReturn, Self

from rastercov.base.errors import ConfigError
from rastercov.base.typed import guarded_class


class Unique:
    """Base of objects that cannot be copied: they hold a device, threads or scratch memory.

    A copy would give back what the first still uses, and a pickle would reach a process that has
    none of it, so `copy`, `deepcopy` and `pickle` raise `ConfigError`.
    """

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        name = type(self).__name__.lstrip("_")
        raise ConfigError(
            f"a {name} cannot be copied or pickled: it holds a device or memory of this process; "
            "open another one where it is wanted, of the same mesh and camera"
        )


class Closing(Unique, ABC):
    """Closed at the end of a `with` block, whatever ends it."""

    def __init_subclass__(cls) -> None:
        guarded_class(cls)  # callers have its instances for an Observer or a Rasterizer

    @abstractmethod
    def close(self) -> None:
        """Give back what it holds; again it does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
