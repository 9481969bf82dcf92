"""Shards that are made by the processes of a cluster; the extra `cluster` has what it needs."""
