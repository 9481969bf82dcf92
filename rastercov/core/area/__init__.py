"""Coverage by area: exact regions of faces, their union over cameras, and cells of equal size."""
