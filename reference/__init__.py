"""Reference implementations that the fast paths must agree with, written for clarity."""

from typing import Any

__all__ = ["image_area", "visible_area", "visible_polygons"]


def __getattr__(name: str) -> Any:
    """Exported function of `polygons`, imported at its first use because shapely takes long."""
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    from rastercov.reference import polygons

    return getattr(polygons, name)
