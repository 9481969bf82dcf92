"""The engine: one contract (`contract`), and the rasterisers that keep it."""
