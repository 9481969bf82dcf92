"""Files of meshes and of cameras, a module a format."""
