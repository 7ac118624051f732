"""Users and tokens: the file, the verbs."""

import hashlib
import json
import os
import re
import stat
from datetime import UTC, datetime

import pytest

from mercator_design.serve.accounts.users import MAX_TOKENS, User, UserError, Users, id_of
from mercator_design.serve.settings import ServiceError

DAY = 86_400


@pytest.fixture
def users(tmp_path, clock):
    return Users(tmp_path, clock.now)


def test_a_token_is_that_of_its_user(users):
    token = users.add("ana", is_admin=True)
    holder = users.verify(token)
    assert holder.user == User("ana", is_admin=True)
    assert holder.token == id_of(token)


def test_a_token_has_256_bits(users):
    assert re.fullmatch(r"md_\w{8}_[A-Za-z0-9]{43}", users.add("ana"))
    assert 62**43 > 2**256


def test_the_file_has_no_secret_and_is_for_its_owner_alone(users):
    token = users.add("ana")
    secret = token.split("_")[2]
    text = users.file.read_text()
    assert secret not in text
    assert json.loads(text)["users"][0]["tokens"][0]["digest"] == hashlib.sha256(token.encode()).hexdigest()
    assert stat.S_IMODE(users.file.stat().st_mode) == 0o600
    assert stat.S_IMODE(users.file.parent.stat().st_mode) == 0o700


def test_the_file_stays_for_its_owner_alone(users):
    users.add("ana")
    users.file.chmod(0o644)
    users.add("bob")
    assert stat.S_IMODE(users.file.stat().st_mode) == 0o600


@pytest.mark.parametrize(
    "wrong", ["", "md_", "md__", "x", "md_aaaaaaaa_" + "b" * 43, "md_aaaaaaaa_" + "é" * 43, "\ud800", "a" * 100_000]
)
def test_what_is_no_token(users, wrong):
    users.add("ana")
    assert users.verify(wrong) is None


def test_a_token_with_another_secret(users):
    ana, bob = users.add("ana"), users.add("bob")
    assert users.verify(f"md_{id_of(ana)}_{bob[-43:]}") is None
    assert users.verify(ana[:-1] + ("a" if ana[-1] != "a" else "b")) is None


def test_tokens_expire(users, clock):
    token = users.add("ana", days=2)
    clock.seconds = 2 * DAY - 1
    assert users.verify(token) is not None
    clock.seconds = 2 * DAY
    assert users.verify(token) is None
    assert users.holder(id_of(token)) is None
    assert not users.has_token()


def test_tokens_expire_after_a_year_by_default(users):
    users.add("ana")
    assert users.accounts()[0].tokens[0].expires == "2031-01-01T00:00:00+00:00"


def test_a_revoked_user_has_no_token_and_keeps_the_name(users):
    first = users.add("ana")
    second = users.add_token("ana")
    users.verify(first)
    assert users.revoke("ana") == ("ana", (id_of(first), id_of(second)))
    assert users.verify(first) is users.verify(second) is None
    with pytest.raises(UserError, match="mdesign users token ana"):
        users.add("ana")
    assert users.verify(users.add_token("ana")).user.name == "ana"


def test_a_token_is_revoked_by_its_id(users):
    first = users.add("ana")
    second = users.add_token("ana")
    assert users.revoke(id_of(first)) == ("ana", (id_of(first),))
    assert users.verify(first) is None
    assert users.verify(second) is not None


def test_expired_tokens_are_forgotten_and_valid_ones_limited(users):
    users.add("ana", days=-1)
    for _ in range(MAX_TOKENS):
        users.add_token("ana")
    assert len(users.accounts()[0].tokens) == MAX_TOKENS
    with pytest.raises(UserError, match=f"expected less than {MAX_TOKENS} tokens"):
        users.add_token("ana")


def test_a_service_sees_changes_of_another_process(users, tmp_path, clock):
    other = Users(tmp_path, clock.now)
    assert not users.accounts()
    token = other.add("ana")
    assert users.verify(token) is not None
    other.revoke("ana")
    assert users.verify(token) is None
    users.file.unlink()
    with pytest.raises(ServiceError, match=r"users\.json: is gone"):
        users.accounts()
    assert not Users(tmp_path, clock.now).accounts()


@pytest.mark.parametrize(
    "name", ["", "Ana", "-a", ".a", "a/b", "a b", "a\n", "é", "x" * 33, "../a", "<b>", "local", "a\x00"]
)
def test_names_that_are_refused(users, name):
    with pytest.raises(UserError):
        users.add(name)
    assert not users.file.exists()


@pytest.mark.parametrize("name", ["a", "ana", "ana.b-c_d", "0", "x" * 32])
def test_names(users, name):
    assert users.verify(users.add(name)).user.name == name


@pytest.mark.parametrize("action", ["revoke", "add_token"])
def test_users_that_are_not_there(users, action):
    with pytest.raises(UserError, match="found bob"):
        getattr(users, action)("bob")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda _: "", "expected JSON"),
        (lambda _: "[" * 100_000, "expected JSON"),
        (lambda text: text.replace('"format": 1', '"format": 2'), "format: expected 1, found 2"),
        (lambda text: re.sub(r'"digest": "..', '"digest": "', text), r"users\[0\].tokens\[0\].digest: "),
        (lambda text: text.replace("2031-01-01", "2031-13-01"), "expires: expected a time"),
        (lambda text: text.replace('"ana"', '"A"'), r"users\[0\].name: "),
    ],
)
def test_a_damaged_file_lets_nobody_in(users, change, expected):
    token = users.add("ana")
    users.verify(token)
    users.file.write_text(change(users.file.read_text()))
    for _ in range(2):
        for see in (users.accounts, users.has_token, lambda: users.verify(token)):
            with pytest.raises(ServiceError, match=rf"users.json: .*{expected}|users.json: {expected}"):
                see()


def test_a_change_that_fails_leaves_the_file(users, monkeypatch):
    users.add("ana")
    before = users.file.read_text()
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OSError, match="No space"):
        users.add("bob")
    assert users.file.read_text() == before
    assert sorted(path.name for path in users.file.parent.iterdir()) == ["users.json", "users.lock"]


class TestVerbs:
    def test_add_shows_the_token_on_stdout_alone(self, mdesign, tmp_path):
        code, out, err = mdesign("users", "add", "ana", "--data", tmp_path)
        assert code == 0
        assert err == "ana: this token is shown once; it expires in 365 days\n"
        assert Users(tmp_path).verify(out.strip()).user == User("ana")

    def test_an_administrator_and_days(self, mdesign, tmp_path):
        _, out, _ = mdesign("users", "add", "ana", "--admin", "--days", "3", "--data", tmp_path)
        holder = Users(tmp_path).verify(out.strip())
        assert holder.user.is_admin
        assert 2 <= (holder.expires - datetime.now(UTC)).days <= 3

    def test_a_further_token_list_and_revoke(self, mdesign, tmp_path):
        _, first, _ = mdesign("users", "add", "ana", "--data", tmp_path)
        _, second, _ = mdesign("users", "token", "ana", "--data", tmp_path)
        mdesign("users", "add", "bob", "--admin", "--data", tmp_path)
        assert mdesign("users", "revoke", id_of(first), "--data", tmp_path)[2] == f"ana: revoked: {id_of(first)}\n"
        mdesign("users", "revoke", "bob", "--data", tmp_path)
        _, out, _ = mdesign("users", "list", "--data", tmp_path)
        head, ana, bob = (line.split() for line in out.splitlines())
        assert head == ["user", "admin", "token", "expires"]
        assert ana[:2] == ["ana", id_of(second)]
        assert bob == ["bob", "yes", "revoked"]

    def test_changes_are_in_the_audit_log(self, mdesign, tmp_path):
        _, first, _ = mdesign("users", "add", "ana", "--admin", "--data", tmp_path)
        _, second, _ = mdesign("users", "token", "ana", "--data", tmp_path)
        mdesign("users", "add", "ana", "--data", tmp_path)  # is refused, and changes nothing
        mdesign("users", "list", "--data", tmp_path)
        mdesign("users", "revoke", "ana", "--data", tmp_path)
        log = tmp_path / ".service" / "audit.log"
        found = [json.loads(line) for line in log.read_text().splitlines()]
        assert [one["what"] for one in found] == [
            f"mdesign users add ana --admin: {id_of(first)}",
            f"mdesign users token ana: {id_of(second)}",
            f"mdesign users revoke ana: {id_of(first)}, {id_of(second)}",
        ]
        assert {(one["user"], one["address"], one["answer"]) for one in found} == {("", f"account {os.getuid()}", 0)}
        assert stat.S_IMODE(log.stat().st_mode) == 0o600

    def test_mistakes(self, mdesign, tmp_path):
        assert mdesign("users", "list", "--data", tmp_path)[2].startswith(f"{tmp_path}: there are no users")
        code, out, err = mdesign("users", "add", "A\x1b", "--data", tmp_path)
        assert (code, out) == (1, "")
        assert err.startswith("Error: expected a name of up to 32 of a-z")
        assert "\x1b" not in err
        assert mdesign("users", "revoke", "bob", "--data", tmp_path)[0] == 1

    def test_a_folder_that_cannot_be_written(self, mdesign, tmp_path):
        (tmp_path / "file").write_text("")
        code, _, err = mdesign("users", "add", "ana", "--data", tmp_path / "file" / "runs")
        assert code == 1
        assert "Traceback" not in err

    def test_a_user_of_a_damaged_file(self, mdesign, tmp_path):
        mdesign("users", "add", "ana", "--data", tmp_path)
        (tmp_path / ".service" / "users.json").write_text(json.dumps({"format": 1, "users": 3}))
        code, _, err = mdesign("users", "add", "bob", "--data", tmp_path)
        assert code == 1
        assert "users: expected" in err
