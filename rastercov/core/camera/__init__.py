"""Cameras: intrinsics, lenses, poses, rigs, rays, the near plane."""
