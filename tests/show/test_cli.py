"""The verbs replay and plot."""

import pytest

FSM = "--nstates 1 --s0 0 --rwm0 5\n"


@pytest.fixture
def work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fsm.txt").write_text(FSM)
    (tmp_path / "other.txt").write_text("--nstates 1 --s0 1\n")
    return tmp_path


SHORT = ("--mission", "aggregation", "--set", "duration=2")


def test_page_of_two(work, mdesign):
    code, out, _ = mdesign("replay", "fsm.txt", "--compare", "other.txt", *SHORT, "--seed", "3")
    assert code == 0
    assert out.startswith("replay.html: fsm.txt on aggregation, seed 3: score ")
    page = (work / "replay.html").read_text()
    assert page.count('"title":') == 2
    assert "MercatorReplay" in page


def test_trace_and_picture(work, mdesign):
    assert mdesign("record", "fsm.txt", *SHORT, "-o", "trace.npz")[0] == 0
    code, out, _ = mdesign("replay", "trace.npz", *SHORT, "--fsm", "fsm.txt", "--png", "1.5")
    assert (code, out.split(":")[0]) == (0, "replay.png")
    assert (work / "replay.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_film(work, mdesign):
    code, out, _ = mdesign("replay", "fsm.txt", *SHORT, "--video", "film.gif")
    assert (code, out.split(":")[0]) == (0, "film.gif")
    assert (work / "film.gif").read_bytes().startswith(b"GIF")


def test_logs(work, mdesign, logs):
    code, _, err = mdesign("replay", *logs, "--start", "0,0,90", "--start", "1,0,0", "--start", "2,0,0")
    assert code == 0
    assert "starting poses" not in err
    assert '"names":["twin-0","twin-1","twin-2"]' in (work / "replay.html").read_text()


def test_plot(work, mdesign):
    code, out, _ = mdesign("plot", "fsm.txt", *SHORT, "-k", "states", "-o", "states.svg")
    assert (code, out) == (0, "states.svg\n")
    assert "mdesign plot fsm.txt" in (work / "states.svg").read_text()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["fsm.txt", "other.txt", *SHORT], 2, "expected one FSM, found 2 files; to compare, give --compare"),
        (["fsm.txt"], 2, "names no mission; give --mission"),
        (["fsm.txt", *SHORT, "--video", "film.avi"], 2, ".mp4 or .gif"),
        (["fsm.txt", *SHORT, "--video", "film.gif", "--png", "1"], 2, "not both"),
        (["fsm.txt", *SHORT, "--png", "1", "-o", "still.jpg"], 2, "ends in .html, .htm, .png, .svg or .pdf"),
        (["fsm.txt", *SHORT, "--png", "1", "-o", "still.html"], 2, "ends in .png, .svg or .pdf, found 'still.html'"),
        (["none.txt", *SHORT, "-o", "film.gif"], 2, "ends in .html, .htm, .png, .svg or .pdf, found 'film.gif'"),
        (["fsm.txt", *SHORT, "-o", "film.png"], 2, "ends in .html or .htm, found 'film.png'"),
        (["none.txt", *SHORT], 3, "none.txt: no such file"),
        (["fsm.txt", *SHORT, "-o", "none/replay.html"], 1, "none"),
        (["trace.csv"], 2, "with --mission"),
        (["log.jsonl", "--start", "1,2"], 2, "expected X,Y,DEGREES"),
        (["log.jsonl", "--compare", "fsm.txt"], 2, "--compare needs FSM as the first file, found LOG"),
        (["fsm.txt", *SHORT, "--start", "0,0,0"], 2, "--start needs LOG as the first file"),
        (["fsm.txt", *SHORT, "--png", "3"], 2, "expected at most 2 s"),
        (["fsm.txt", *SHORT, "--png", "nan"], 2, "'nan' is not a number"),
        (["fsm.html", *SHORT, "-o", "fsm.html"], 2, "expected another file than the one that is read"),
        (["fsm.txt", *SHORT, "--video", "film.gif", "-o", "x.html"], 2, "expected --video or -o, not both"),
        (["log.jsonl", "--set", "robots=2"], 2, "--set needs --mission"),
        (["log.jsonl"], 1, "log.jsonl"),
    ],
)
def test_mistakes(arguments, code, message, work, mdesign):
    (work / "trace.csv").write_text("time\n")
    (work / "log.jsonl").write_text("{}\n")
    (work / "fsm.html").write_bytes((work / "fsm.txt").read_bytes())
    found, out, err = mdesign("replay", *arguments)
    assert (found, out) == (code, "")
    assert message in err


def test_browser_is_opened(work, mdesign, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    assert mdesign("replay", "fsm.txt", *SHORT, "--open")[0] == 0
    assert opened == [(work / "replay.html").as_uri()]
