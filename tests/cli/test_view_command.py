"""`comwalk view` and `walk --view`: what stands in the way of a page, on one line."""

from __future__ import annotations

import http.client
import socket
import webbrowser

import pytest

from comwalk.cli.app import BAD_INPUT, main
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.model import load_robot
from comwalk.run import simulate
from comwalk.views import page_server
from comwalk.views.page_server import open_server


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A saved step."""
    gait = Gait(stand_time=0.1, start_time=0.4, stop_time=0.4)
    pattern = make_pattern(plan_steps(gait, 1), Pendulum())
    run = simulate(load_robot("paper"), pattern)
    return run.save(tmp_path_factory.mktemp("run"))


def refusal(capsys, *words):
    """Return the one line on which a command refuses its input."""
    assert main([str(word) for word in words]) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("comwalk: ")
    assert err.count("\n") == 1
    return err


def test_a_port_in_use_is_refused(folder, capsys):
    """It is not taken from under another, nor silently left for the next."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert f"127.0.0.1:{port}" in refusal(capsys, "view", folder, "--port", port)
    assert "[0, 65535]" in refusal(capsys, "view", folder, "--port", "99999")
    assert "--port" in refusal(capsys, "view", folder, "--host", "198.51.100.1")


def test_a_missing_browser_is_told(folder, capsys, monkeypatch):
    """Before anything is served."""

    def nothing(using=None):
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(webbrowser, "get", nothing)
    line = refusal(capsys, "view", folder, "--port", "0", "--open")
    assert "no browser" in line


def test_what_is_no_run_is_refused(folder, tmp_path, capsys):
    """Nothing there, no archive, no model."""
    assert "is not a run" in refusal(capsys, "view", tmp_path / "nothing")
    for name in ("run.npz", "scene.mjb"):
        broken = tmp_path / name
        broken.mkdir()
        for file in ("run.npz", "scene.mjb", "summary.json"):
            (broken / file).write_bytes((folder / file).read_bytes())
        (broken / name).write_bytes((folder / name).read_bytes()[:1000])
        assert name in refusal(capsys, "view", broken)


def test_flags_of_a_page_need_one(tmp_path, monkeypatch, capsys):
    """And a page needs a robot; nothing is left behind."""
    monkeypatch.chdir(tmp_path)
    assert "add --view" in refusal(capsys, "walk", "--port", "1234")
    walk = ("walk", "--steps", "1", "--view", "--port", "0")
    assert "needs a robot" in refusal(capsys, *walk, "--plant", "pendulum")
    assert not list(tmp_path.iterdir())


def test_a_server_listens_here_only_and_says_nothing(capfd):
    """At the loopback address, on a port that was free."""
    with open_server() as server:
        assert server.get_host() == "127.0.0.1"
        with socket.create_connection(("127.0.0.1", server.get_port()), timeout=10):
            pass
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize(
    ("host", "headers", "answered"),
    [
        ("127.0.0.1", {"Host": "127.0.0.1:8080"}, True),
        ("127.0.0.1", {"Host": "localhost:1", "Origin": "http://localhost:1"}, True),
        ("127.0.0.1", {"Host": "[::1]:80", "Origin": "http://[::1]:80"}, True),
        ("0.0.0.0", {"Host": "192.168.1.7:80"}, True),
        ("0.0.0.0", {"Host": socket.gethostname() + ":80"}, True),
        ("127.0.0.1", {"Host": "127.0.0.1:1", "Origin": "http://evil.example"}, False),
        ("127.0.0.1", {"Host": "localhost:1", "Origin": "http://localhost:2"}, False),
        ("127.0.0.1", {"Host": "localhost:1", "Origin": "null"}, False),
        ("127.0.0.1", {"Host": "evil.example:8080"}, False),
        ("0.0.0.0", {"Host": "evil.example:8080"}, False),
        ("127.0.0.1", {}, False),
    ],
)
def test_pages_of_other_sites_are_not_answered(host, headers, answered):
    assert (page_server.refusal(host, headers) is None) == answered


def test_a_server_answers_its_own_page_alone():
    """Both what is fetched and what steers."""
    with open_server() as server:
        own = f"127.0.0.1:{server.get_port()}"
        upgrade = {
            "Connection": "Upgrade",
            "Upgrade": "websocket",
            "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
        }
        found = []
        for headers in (
            {"Host": own},
            {"Host": "evil.example"},
            {"Host": own, "Origin": f"http://{own}", **upgrade},
            {"Host": own, "Origin": "http://evil.example", **upgrade},
        ):
            link = http.client.HTTPConnection(own, timeout=10)
            link.putrequest("GET", "/", skip_host=True)
            for name, value in headers.items():
                link.putheader(name, value)
            link.endheaders()
            found.append(link.getresponse().status)
            link.close()
    assert found == [200, 403, 101, 403]
