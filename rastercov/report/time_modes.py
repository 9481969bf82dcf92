"""Colours of faces over time."""

from rastercov.report.modes import FeatureModes, Mode, by_share

TIME = "Share of the time in which each part is covered."
NOW = "Share of each part that is covered in this frame."
HOOKS = FeatureModes(
    time=Mode("Share of time", TIME, by_share, of="phases"),
    now=Mode("Covered in this frame", NOW, by_share, of=""),
)
