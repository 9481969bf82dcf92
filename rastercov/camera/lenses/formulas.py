"""Codes of bases, and parameters of lenses, as `native/lens/formulas.hpp` has them."""

BASES = (
    *("pinhole", "equidistant", "equisolid", "fov", "unified", "double_sphere", "division"),
    "equirectangular",
)
"""Names of the bases, by their codes."""
PINHOLE, EQUIDISTANT, EQUISOLID, FOV, UNIFIED, DOUBLE_SPHERE, DIVISION, EQUIRECT = range(len(BASES))

SIZE = 32
"""Parameters of a lens, float64."""
FX, FY, CX, CY, SKEW = range(5)
K1, K2, K3, K4, K5, K6 = range(5, 11)
"""Radial numerator: 1 + K1 q + ... + K6 q^6, q = x^2 + y^2."""
D1, D2, D3 = range(11, 14)
"""Radial denominator: 1 + D1 q + D2 q^2 + D3 q^3."""
P1, P2, S1, S2, S3, S4 = range(14, 20)
"""Tangential terms and thin prism, with OpenCV's letters."""
T00, T10, T11, T20, T21, T22 = range(20, 26)
"""Homography of the tilted sensor; its other entries are 0."""
B0, B1, B2 = range(26, 29)
"""Parameters of the base."""
LATE = 29
"""1 where tangential and prism terms take the radially distorted point, else 0."""
LIMIT = 30
"""Largest radius of the plane of the base on which the distortion is certified to be injective."""
SLOPE = 31
"""Border of the valid region, see `native/lens/lens.hpp`."""
