"""Addresses of schedulers that are safe to connect to.

Whoever reaches an open scheduler can run any program on its workers, and whoever answers in its
place can run one in this process. So an address is of this machine, or of TLS with certificates on
both sides. On this machine its other users reach an open one, too: `risk` says so, and does not
refuse, because a machine or container with one user has no others.
"""

import ipaddress
from urllib.parse import urlsplit

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError

EXAMPLE = "tcp://127.0.0.1:8786 or tls://host:8786"


def check_address(address: str) -> None:
    """Accept the address of a scheduler.

    Raises
    ------
    ConfigError
        For an address of another form, and for one of another machine without TLS.
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or port is None or parts.path or parts.scheme not in ("tcp", "tls"):
        raise ConfigError(f"scheduler must be an address such as {EXAMPLE}, got {shown(address)}")
    if parts.scheme == "tcp" and not _is_loopback(host):
        raise ConfigError(
            f"{address}: refused, because anyone who reaches an open scheduler can run programs on "
            "its workers; use tls:// with certificates, or a tunnel to 127.0.0.1 (docs/scale.md)"
        )


def risk(address: str) -> str:
    """Line on the users of this machine, empty for TLS."""
    if not address.startswith("tcp:"):
        return ""
    return (
        f"{address}: every user of this machine can run programs as you through it; where there "
        "are others use --workers, or tls:// with certificates (docs/scale.md)"
    )


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name, which may mean any machine
        return False
