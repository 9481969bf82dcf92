"""Sunlit areas of the parts of a spacecraft from directions over the whole sphere.

Forces of radiation pressure and power of panels follow the lit area that faces the sun; without
shadows the mean of a convex part is a quarter of its surface (Cauchy). `main(100_000)` takes about
10 s of a processor.
"""

import numpy as np

import rastercov as rc


def spacecraft():
    """A body with two panels and an antenna, metres."""
    body = rc.shapes.box((1, 1, 2))
    panels = [rc.shapes.box((0.02, 2, 1), centre=(0, y, 0)) for y in (-1.8, 1.8)]
    sphere = rc.shapes.sphere(2, 0.4)
    antenna = rc.Mesh(sphere.vertices + np.array((0, 0, 1.5)), sphere.faces)
    return rc.Mesh.joined([body, *panels, antenna], ["body", "left", "right", "antenna"])


def directions(n):
    """(n, 3) unit vectors that cover the sphere evenly: a spiral by the golden angle."""
    k = np.arange(n) + 0.5
    z = 1 - 2 * k / n
    angle = np.pi * (3 - 5**0.5) * k
    return np.column_stack(
        (np.cos(angle) * np.sqrt(1 - z**2), np.sin(angle) * np.sqrt(1 - z**2), z)
    )


def main(n=2000):
    """Sunlight from n directions."""
    mesh = spacecraft()
    lit = rc.sunlit(mesh, directions(n))
    unshaded = np.bincount(mesh.face_group, mesh.areas) / 4
    for row, (name, alone) in enumerate(zip(lit.names, unshaded, strict=True)):
        mean, least = lit.lit[:, row].mean(), lit.lit[:, row].min()
        share = f"{100 * mean / alone:.1f} % of unshaded"
        print(f"{name}: {mean:.3f} m2 face the sun on average, {share}; at least {least:.3f} m2")
    return lit


if __name__ == "__main__":
    main()
