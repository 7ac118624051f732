"""The network endpoint of the service: address, TLS, proxy, and names that browsers use."""

import ipaddress
import re
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from mercator_design.serve.accounts.users import Users
from mercator_design.serve.settings import FILE, ServiceError

_LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
_HOST = re.compile(r"(?:\[([0-9a-f:.]{2,45})\]|([a-z0-9._-]{1,253}))(?::\d{1,5})?", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Endpoint:
    """Network endpoint of the service.

    host: The address on which it listens.
    has_tls: Whether it has a certificate.
    is_behind_proxy: Whether a proxy with a certificate is in front of it.
    names: Further names by which browsers reach it.
    proxies: Addresses or networks of the proxy.
    """

    host: str = "127.0.0.1"
    has_tls: bool = False
    is_behind_proxy: bool = False
    names: tuple[str, ...] = ()
    proxies: tuple[str, ...] = ("127.0.0.1", "::1")

    @property
    def is_local(self) -> bool:
        """Whether only this machine reaches it, so that no users are needed."""
        address = _address(self.host)
        is_loopback = self.host == "localhost" if address is None else address.is_loopback
        return is_loopback and not self.is_behind_proxy

    def serves_host(self, host: str) -> bool:
        """Whether a Host header names this service. Another site may have rebound its own name to this machine."""
        found = _HOST.fullmatch(host)
        if found is None:
            return False
        name = (found[1] or found[2]).lower().rstrip(".")
        if name in _LOOPBACK_NAMES or name in {one.lower() for one in self.names}:
            return True
        if self.is_local or self.is_behind_proxy:
            return False
        # No page can rebind the address of a machine itself.
        return name in {self.host.lower(), socket.gethostname().lower()} or _address(name) is not None

    def is_proxy(self, address: str) -> bool:
        """Whether an address is that of the proxy, which has many clients."""
        found = _address(address)
        networks = [ipaddress.ip_network(one, strict=False) for one in self.proxies if self.is_behind_proxy]
        return found is not None and any(found in network for network in networks)

    def check(self, users: Users) -> None:
        """Refuse to open a service to others without users or without TLS.

        Raises:
            ServiceError: The list of what is missing.
        """
        if self.is_local:
            return
        missing = []
        if not users.has_token():
            missing.append(f"a user, because others reach the service: mdesign users add NAME --data {_data(users)}")
        if not (self.has_tls or self.is_behind_proxy):
            missing.append("TLS: --certificate FILE --key FILE, or --behind-proxy if a proxy before it has TLS")
        if self.is_behind_proxy and not self.names:
            missing.append(f"the names by which browsers reach the proxy: hosts: [NAME, ...] in {_data(users) / FILE}")
        for network in self.proxies:
            try:
                ipaddress.ip_network(network, strict=False)
            except ValueError:
                missing.append(f"proxies: an address or a network, found {network}")
        if missing:
            raise ServiceError(*(f"--host {self.host}: expected {one}" for one in missing))


def tls_of(certificate: Path, key: Path) -> ssl.SSLContext:
    """TLS context with a certificate and its key.

    Raises:
        ServiceError: They cannot be used.
    """
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)

    def refuse() -> str:
        raise ServiceError(f"{key}: expected a key without a passphrase")

    try:
        tls.load_cert_chain(certificate, key, refuse)
    except ssl.SSLError as error:
        raise ServiceError(
            f"{certificate}, {key}: expected a certificate and its key (PEM), found something else: {error.reason}"
        ) from None
    except OSError as error:
        file = next((one for one in (certificate, key) if not one.is_file()), key)
        raise ServiceError(f"{file}: cannot be read: {error.strerror}") from None
    return tls


def network_of(address: str) -> str:
    """Network of an address; in IPv6 its first 64 bits, because a client can choose the others."""
    found = _address(address.partition("%")[0])
    if isinstance(found, ipaddress.IPv6Address):
        return str(found.ipv4_mapped or ipaddress.ip_network((int(found) >> 64 << 64, 64)))
    return address


def _data(users: Users) -> Path:
    return users.file.parent.parent


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Address in a text; None if it is not one."""
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None
