"""Where the service may be opened: its addresses, users, TLS."""

import socket

import pytest

from mercator_design.serve.accounts.endpoint import Endpoint, tls_of
from mercator_design.serve.accounts.users import Users
from mercator_design.serve.settings import ServiceError

ANY = "0.0.0.0"  # noqa: S104 - that is what is tested


@pytest.fixture
def users(tmp_path, clock):
    return Users(tmp_path, clock.now)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_this_machine_needs_nothing(users, host):
    assert Endpoint(host=host).is_local
    Endpoint(host=host).check(users)


@pytest.mark.parametrize("host", [ANY, "::", "192.0.2.1", "lab.example.org", "", "127.0.0.1.example"])
def test_others_need_a_user_and_tls(users, host):
    assert not Endpoint(host=host).is_local
    with pytest.raises(ServiceError) as refused:
        Endpoint(host=host).check(users)
    first, second = refused.value.messages
    assert "mdesign users add NAME --data" in first
    assert "--certificate FILE --key FILE" in second
    assert "--behind-proxy" in second
    users.add("ana")
    with pytest.raises(ServiceError, match="expected TLS"):
        Endpoint(host=host).check(users)
    Endpoint(host=host, has_tls=True).check(users)


def test_a_user_must_have_a_token(users, clock):
    endpoint = Endpoint(host=ANY, has_tls=True)
    users.add("ana", days=1)
    users.add("bob")
    users.revoke("bob")
    endpoint.check(users)
    clock.seconds = 86_400
    with pytest.raises(ServiceError, match="expected a user"):
        endpoint.check(users)


@pytest.mark.parametrize("host", ["127.0.0.1", ANY])
def test_a_proxy_needs_a_user_and_names_also_on_this_machine(users, host):
    with pytest.raises(ServiceError, match="expected a user"):
        Endpoint(host=host, is_behind_proxy=True, names=("a",)).check(users)
    users.add("ana")
    with pytest.raises(ServiceError, match=r"hosts: \[NAME, ...\] in .*serve.yaml"):
        Endpoint(host=host, is_behind_proxy=True).check(users)
    with pytest.raises(ServiceError, match=r"proxies: an address or a network, found proxy\.example"):
        Endpoint(host=host, is_behind_proxy=True, names=("a",), proxies=("proxy.example",)).check(users)
    Endpoint(host=host, is_behind_proxy=True, names=("a",), proxies=("10.0.0.0/8", "::1")).check(users)


def test_a_damaged_file_of_users_stops_the_start(users):
    users.add("ana")
    users.file.write_text("{")
    with pytest.raises(ServiceError, match="expected JSON"):
        Endpoint(host=ANY, has_tls=True).check(users)


def test_a_certificate(certificate):
    tls_of(*certificate)


def test_addresses_of_the_proxy():
    endpoint = Endpoint(is_behind_proxy=True, proxies=("10.0.0.0/8", "::1"))
    assert [endpoint.is_proxy(one) for one in ("10.1.2.3", "::1", "11.0.0.1", "127.0.0.1", "unknown")] == [
        True, True, False, False, False,
    ]  # fmt: skip
    assert not Endpoint(proxies=("10.0.0.0/8",)).is_proxy("10.1.2.3")


@pytest.mark.parametrize(
    ("choose", "expected"),
    [
        (lambda cert, key: (cert, cert), "expected a certificate and its key"),
        (lambda cert, key: (key, key), "expected a certificate and its key"),
        (lambda cert, key: (cert.with_name("none"), key), "none: cannot be read: No such file"),
        (lambda cert, key: (cert, key.with_name("none")), "none: cannot be read: No such file"),
        (lambda cert, key: (cert, key.with_name("locked.pem")), "locked.pem: expected a key without a passphrase"),
    ],
)
def test_certificates_that_cannot_be_used(certificate, choose, expected):
    with pytest.raises(ServiceError, match=expected):
        tls_of(*choose(*certificate))


class TestVerb:
    @pytest.mark.parametrize(
        ("options", "code", "expected"),
        [
            (("--host", ANY), 1, "mdesign users add"),
            (("--host", "192.0.2.1", "--behind-proxy"), 1, "mdesign users add"),
            (("--behind-proxy",), 1, "mdesign users add"),
            (("--certificate", "x"), 2, "both --certificate and --key"),
            (("--key", "x"), 2, "both --certificate and --key"),
            (("--certificate", "x", "--key", "x"), 1, "x: cannot be read"),
        ],
    )
    def test_what_it_refuses(self, mdesign, tmp_path, options, code, expected):
        found, out, err = mdesign("serve", "--port", "0", "--data", tmp_path, *options)
        assert (found, out) == (code, "")
        assert expected in err
        assert not list(tmp_path.iterdir())

    def test_a_port_that_is_taken(self, mdesign, tmp_path):
        with socket.create_server(("127.0.0.1", 0)) as other:
            port = other.getsockname()[1]
            code, _, err = mdesign("serve", "--port", port, "--data", tmp_path)
        assert code == 1
        assert f"--port {port}: cannot listen there: Address already in use" in err
