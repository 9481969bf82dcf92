"""Workers of tests as copies of one process that has imported what they need."""

import pytest

MODULES = ["distributed", "rastercov.evaluation_shards", "rastercov.placement.shard_work"]


@pytest.fixture(scope="module")
def workers_start_as_copies():
    """A worker costs a fork, not two seconds of imports.

    Heads that tests start as programs start their workers as those of users do.
    """
    import dask
    from distributed.utils import get_mp_context

    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        get_mp_context().set_forkserver_preload(MODULES)
        yield
