from rastercov.near_plane import *  # noqa
from rastercov.raster.tie_order import in_one_order  # noqa
