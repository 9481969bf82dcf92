"""Rasterisers: one contract (`contract`), implemented by `cpu` and `gl`."""
