"""Rules of rigs, limits of their rays, uncertainty and the laser line."""
