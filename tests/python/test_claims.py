"""Claims know whether the program is the one that they were counted on (tests/tools/claims.py)."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "tools"))

import claims  # noqa: E402

DECISION = ROOT / "host_tools/terrapin_tools/workbench/discover"


def test_what_a_program_does_counts_and_what_it_says_does_not() -> None:
    source = (DECISION / "certainty.py").read_text()
    capped = source.replace("CEILING = 0.995", "CEILING = 0.8")
    said = source.replace('"""How sure:', '"""So sure:').replace("# simulated", "# drawn")
    assert capped != source
    assert said != source
    assert claims.of_source(capped) != claims.of_source(source)
    assert claims.of_source(said) == claims.of_source(source)


def test_a_sentence_is_not_the_program_but_a_name_is() -> None:
    one = 'def f(x):\n    return f"found {x} of it" if x == "catalogue" else "none at all"\n'
    assert claims.of_source(one.replace("found", "saw").replace("none at", "not any at")) == claims.of_source(one)
    assert claims.of_source(one.replace("catalogue", "mixed")) != claims.of_source(one)
    assert claims.of_source(one.replace("{x}", "{x + 1}")) != claims.of_source(one)


def test_a_room_has_one_digest_until_a_file_changes(tmp_path: Path) -> None:
    room = tmp_path / "host_tools/terrapin_tools/workbench/noise"
    room.mkdir(parents=True)
    (room / "odd.py").write_text("ODD = 0.01\n")
    before = claims.digest("decision", tmp_path)
    (room / "odd.py").write_text("ODD = 0.01  # of a case\n")
    assert claims.digest("decision", tmp_path) == before
    (room / "odd.py").write_text("ODD = 0.02\n")
    assert claims.digest("decision", tmp_path) != before


def test_the_page_has_the_claims_as_they_stand() -> None:
    """`make claims` writes it."""
    listed, now = claims.claims(claims.FILE.read_text()), {room: claims.digest(room) for room in claims.ROOMS}
    text = claims.PAGE.read_text()
    assert claims.page(text, claims.table(listed, now)) == text, (
        "what decides was changed: `make claims` marks its counts"
    )


def test_a_new_count_is_of_this_program() -> None:
    text, now = claims.FILE.read_text(), dict.fromkeys(claims.ROOMS, "12345678")
    name = claims.claims(text)[-1].name
    again = {one.name: one for one in claims.claims(claims.counted(text, name, "3 of 4", now))}
    assert (again[name].counted, again[name].digest) == ("3 of 4", "12345678")
    others = {one.name: one for one in claims.claims(text)}
    assert all(again[other] == others[other] for other in again if other != name)


def test_a_claim_that_lacks_something_is_named() -> None:
    with pytest.raises(ValueError, match=r"^bumps: .*command"):
        claims.claims('[bumps]\nsays = "a"\nbound = "b"\ncounted = "c"\nroom = "decision"\ndigest = ""\n')
    whole = 'says = "a"\nbound = "b"\ncounted = "c"\ncommand = "d"\ndigest = ""\n'
    with pytest.raises(ValueError, match=r"^bumps: room is 'attic', expected one of decision"):
        claims.claims(f'[bumps]\n{whole}room = "attic"\n')
