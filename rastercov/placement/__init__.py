"""Where the cameras go: from a mesh to candidate poses, and from many poses to a few."""
