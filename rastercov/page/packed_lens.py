"""Address of `pack_lens` that docs/c.md and rastercov.h name."""

from rastercov.report.packed_lens import pack_lens

__all__ = ["pack_lens"]
