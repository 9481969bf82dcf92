"""Colours of faces over time."""

from functools import partial

from rastercov.report.modes import FeatureModes, Mode, by_share

TIME = "Share of the time in which each part is covered."
NEVER = "never covered, even in part"
NOW = "Share of each part that is covered in this frame."
HOOKS = FeatureModes(
    time=Mode("Share of time", TIME, partial(by_share, none=NEVER), of="phases"),
    now=Mode("Covered in this frame", NOW, by_share, of=""),
)
