"""`terrapin run` and `terrapin param` with a controller that has a link key: the process on a pty of its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from terrapin_hil.links import open_link
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.seal import LinkKey, open_session, seal_link, takes_changes
from terrapin_hil.links.wire import SlcanLink
from terrapin_hil.reading import ReadingError
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_tools.cli import main
from terrapin_tools.param.nodes import controllers, store_node


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "robot.key"
    path.touch(0o600)
    path.write_text(LinkKey.new().text(), encoding="utf-8")
    return path


@pytest.fixture
def keyed(key: Path) -> Iterator[SlcanLink]:
    """A controller with the key, over a link that does not seal."""
    with SlcanLink.of_process(arguments=["--link-key", str(key)]) as link:
        yield link


def test_a_sealed_run_is_the_open_one(key: Path) -> None:
    scenario = load_scenario(find_scenario("speed_control"), {"duration": "1.5 s"})
    with open_link("pty", link_key=key) as link:
        assert run(scenario, link).output_hash == run(scenario, "pty").output_hash


def test_without_the_key_nothing_changes(keyed: SlcanLink) -> None:
    assert not takes_changes(keyed)


def test_with_the_key_it_takes_changes(keyed: SlcanLink, key: Path) -> None:
    seal_link(keyed, LinkKey.read(key))
    assert takes_changes(keyed)


def test_another_key_is_told(keyed: SlcanLink) -> None:
    other = LinkKey.new()
    with pytest.raises(LinkError, match=f"wrong link key {other.fingerprint}: the controller has another"):
        seal_link(keyed, other)
    assert keyed.session is None


def test_another_generation_is_told(keyed: SlcanLink, key: Path) -> None:
    old = LinkKey(LinkKey.read(key).key, 2)
    with pytest.raises(LinkError, match=r"opens no session for link key .* generation 2"):
        seal_link(keyed, old)


def test_a_controller_without_a_key_is_told(key: Path) -> None:
    with pytest.raises(LinkError, match="has no link key and takes commands of anybody"):
        open_link("inprocess", link_key=key)


def test_a_session_that_was_replaced_is_no_more(keyed: SlcanLink, key: Path) -> None:
    """A number is never used twice: what the first session sealed is refused after the second one's first tag."""
    own = LinkKey.read(key)
    first = seal_link(keyed, own)
    second = open_session(keyed, own)
    assert first.number != second.number
    keyed.session = second
    assert takes_changes(keyed)
    keyed.session = first
    assert not takes_changes(keyed)


def test_a_file_without_a_key(tmp_path: Path) -> None:
    path = tmp_path / "none.key"
    path.touch(0o600)
    path.write_text("generation = 1\n", encoding="utf-8")
    with pytest.raises(ReadingError, match=r"none\.key: no link key; `terrapin keys link"):
        open_link("pty", link_key=path)


def call(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["terrapin", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    return int(stopped.value.code or 0)


def test_commands(
    key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--link", "pty", "--flash", str(tmp_path / "robot.flash"), "--link-key", str(key)]
    assert call(monkeypatch, "param", "set", "armature_resistance", "120 mohm", *words) == 0
    assert "1 written, 1 changed; kept in flash" in capsys.readouterr().out
    assert call(monkeypatch, "param", "reset", "armature_resistance", *words) == 0
    assert "1 written, 1 changed; kept in flash" in capsys.readouterr().out
    # the scenario is cut short: its checks may fail, its frames are taken
    assert call(monkeypatch, "run", "speed_control", "--set", "duration=1.5s", *words[:2], *words[4:]) in (0, 1)
    assert "output sha256" in capsys.readouterr().out


def test_a_node_number_needs_the_key(
    key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with SlcanLink.of_process(arguments=["--link-key", str(key), "--flash", str(tmp_path / "flash")]) as link:
        with pytest.raises(LinkError, match="takes no change without its link key; expected --link-key FILE"):
            store_node(link, 3, None)
        [answer] = controllers(link)  # to ask is free
        assert answer.stored == 0
        seal_link(link, LinkKey.read(key))
        assert store_node(link, 3, None).stored == 3
    words = ["--link", "pty", "--flash", str(tmp_path / "other"), "--link-key", str(key)]
    assert call(monkeypatch, "node", "set", "5", *words) == 0
    assert "node 5 from its next reset on" in capsys.readouterr().out


def test_a_recorded_run_is_replayed_sealed(
    key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "run")
    assert call(monkeypatch, "run", "speed_control", "--set", "duration=1.5s", "--out", out) in (0, 1)
    assert call(monkeypatch, "log", "replay", out, "--link", "pty", "--link-key", str(key)) == 0
    assert "every answer is the recorded one" in capsys.readouterr().out
