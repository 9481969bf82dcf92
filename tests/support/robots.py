"""Robots for tests: an arm of seven axes, with the lengths and limits of a KUKA LBR iiwa 7."""

LENGTHS = 0.1575, 0.1825, 0.2025, 0.1975, 0.2025, 0.1975, 0.081, 0.045
RADII = 0.09, 0.085, 0.08, 0.075, 0.07, 0.065, 0.05, 0.04
LIMITS = 2.967, 2.094, 2.967, 2.094, 2.967, 2.094, 3.054
AXES = "0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1"


def seven_axes(limits=LIMITS):
    """URDF of links `link_0` to `link_7` on joints `a1` to `a7`."""
    links = [
        f'<link name="link_{row}"><collision><origin xyz="0 0 {length / 2}"/><geometry>'
        f'<cylinder radius="{radius}" length="{0.94 * length}"/></geometry></collision></link>'
        for row, (length, radius) in enumerate(zip(LENGTHS, RADII, strict=True))
    ]
    joints = [
        f'<joint name="a{row + 1}" type="revolute"><parent link="link_{row}"/>'
        f'<child link="link_{row + 1}"/><origin xyz="0 0 {LENGTHS[row]}"/><axis xyz="{axis}"/>'
        f'<limit lower="{-limit}" upper="{limit}"/></joint>'
        for row, (axis, limit) in enumerate(zip(AXES, limits, strict=True))
    ]
    return f'<robot name="seven">{"".join(links + joints)}</robot>'
