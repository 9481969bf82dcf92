"""Flights, orbits, facades and footprints on a map."""
