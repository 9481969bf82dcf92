"""Address of `packed` that docs/c.md and rastercov.h name."""

from rastercov.report.packed_lens import packed

__all__ = ["packed"]
