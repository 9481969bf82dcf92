"""Meshes, cameras, tasks, and what one camera or many cover of a surface."""
