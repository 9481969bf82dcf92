"""Shards that the processes of a cluster make; it requires the extra `cluster`."""
