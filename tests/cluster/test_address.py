"""Addresses of schedulers, and the choice of workers."""

import pytest

from rastercov.base.errors import ConfigError
from rastercov.cluster.scheduler import HOOKS, check_address
from rastercov.shards import Workers


@pytest.mark.slow
@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:8786", "tcp://localhost:1", "tcp://[::1]:8786", "tls://host:8786"]
)
def test_loopback_and_tls_are_accepted_with_a_line_on_the_risk_of_the_first(address):
    check_address(address)
    assert ("run programs as you" in HOOKS.risk(address)) == address.startswith("tcp:")


@pytest.mark.parametrize(
    "address",
    ["tcp://10.0.0.7:8786", "tcp://host:8786", "tcp://0.0.0.0:8786", "tcp://[2001:db8::1]:8786",
     "tcp://127.0.0.1.example.org:8786", "tcp://localhost@10.0.0.7:8786"],
)  # fmt: skip
def test_an_open_address_is_refused_with_the_reason(address):
    with pytest.raises(ConfigError, match=r"anyone can run programs on the workers; use TLS"):
        check_address(address)


@pytest.mark.parametrize(
    "address",
    ["", "host:8786", "tcp://", "tcp://127.0.0.1", "http://127.0.0.1:8786", "tcp://h:x",
     "tcp://127.0.0.1:99999", "tcp://127.0.0.1:1/x", "ucx://127.0.0.1:1"],
)  # fmt: skip
def test_what_is_no_address_is_refused(address):
    with pytest.raises(ConfigError, match=r"expected a scheduler such as tcp://127"):
        check_address(address)


@pytest.mark.parametrize("number", [0, -1, 1.5, True, "2", 10**6])
def test_a_number_of_workers_is_a_whole_number(number):
    with pytest.raises(
        ConfigError, match=r"expected (workers|number) to be (from 1 to 1024|a whole number)"
    ):
        Workers(number)


def test_workers_are_a_number_or_a_scheduler():
    for both in ({}, {"number": 1, "scheduler": "tcp://127.0.0.1:1"}):
        with pytest.raises(ConfigError, match=r"got [02] of them; give one"):
            Workers(**both)
    assert Workers.of(None, None) is None
    assert Workers.of(3, None) == Workers(3)
