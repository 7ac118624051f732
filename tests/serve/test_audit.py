import json
import stat

import pytest

from mercator_design.serve.accounts.audit import AuditLog


@pytest.fixture
def audit(tmp_path, clock):
    found = AuditLog(tmp_path / "audit.log", clock.now, size=2000)
    yield found
    found.close()


def write(audit, what="POST /x", **given):
    audit.write(**{"user": "ana", "address": "192.0.2.1", "what": what, "job": "", "answer": 200} | given)


def test_a_line(audit, tmp_path):
    write(audit, job="a-b")
    assert json.loads((tmp_path / "audit.log").read_text()) == {
        "time": "2030-01-01T00:00:00.000+00:00",
        "user": "ana",
        "address": "192.0.2.1",
        "what": "POST /x",
        "job": "a-b",
        "answer": 200,
    }


@pytest.mark.parametrize(
    "text",
    ["a\nb", 'a", "user": "root', "\x1b[2J", "\x7f", "\x00", "\u2028", "\u202e", "\ud800", "é", "a" * 10_000, "%s"],
)
def test_a_text_stays_in_its_line(audit, tmp_path, text):
    write(audit, what=text, job=text, address=text)
    data = (tmp_path / "audit.log").read_bytes()
    assert data.count(b"\n") == 1
    assert all(32 <= byte < 127 for byte in data[:-1])
    assert len(data) < 6000
    assert json.loads(data)["user"] == "ana"


def test_it_is_for_its_owner_alone_and_begins_anew(audit, tmp_path):
    for number in range(200):
        write(audit, what=f"POST /{number}")
    files = sorted(tmp_path.iterdir())
    assert len(files) == 10
    assert all(file.stat().st_size <= 2000 for file in files)
    assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}
    assert json.loads((tmp_path / "audit.log").read_text().splitlines()[-1])["what"] == "POST /199"


def test_a_link_is_not_followed(tmp_path, clock, caplog):
    (tmp_path / "audit.log").symlink_to(tmp_path / "other")
    audit = AuditLog(tmp_path / "audit.log", clock.now)
    write(audit)
    audit.close()
    assert not (tmp_path / "other").exists()


def test_a_full_disk_is_reported_and_the_service_goes_on(audit, monkeypatch, caplog):
    write(audit)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(audit._handler.stream, "write", full, raising=False)
    write(audit)
    assert "audit: this line cannot be written" in caplog.text
