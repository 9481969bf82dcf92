"""What holds something that must be given back: use it in a `with` block, or close it."""

from abc import ABC, abstractmethod
from typing import Self


class Closing(ABC):
    """Closed at the end of a `with` block, whatever ends it."""

    @abstractmethod
    def close(self) -> None:
        """Give back what it holds; again it does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
