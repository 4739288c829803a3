"""What stands between the blocks: commands in the running text, links, paths; and that a wrong page is caught."""

import re
from pathlib import Path

import pytest
from pages import PAGES, ROOT, Runner, blocks, inline_commands, read_command

FOLDERS = ("firmware/", "hil/", "host_tools/", "tests/", "docs/", "cases/", ".ci/")
PLACEHOLDER = re.compile(r"/(NAME|ID|DIR)\b")


def text(page: str) -> str:
    return (ROOT / page).read_text()


@pytest.mark.parametrize("page", PAGES)
def test_commands_in_the_text_are_known(page: str) -> None:
    for line in inline_commands(text(page)):
        read_command(line)


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    for target, anchor in re.findall(r"\]\((?!https://)([^)#]*)#?([^)]*)\)", text(page)):
        there = (ROOT / page).parent / target if target else ROOT / page
        assert there.exists(), f"{page}: {target}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", there.read_text(), re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
            assert anchor in slugs, f"{page}: {target}#{anchor}"


@pytest.mark.parametrize("page", PAGES)
def test_paths_exist(page: str) -> None:
    shown = {block.marks["file"] for other in PAGES for block in blocks(other, text(other)) if "file" in block.marks}
    for name in re.findall(r"`([\w.*/-]+)`", re.sub(r"^```.*?^```", "", text(page), flags=re.MULTILINE | re.DOTALL)):
        if name.startswith(FOLDERS) and name not in shown and not PLACEHOLDER.search(name):
            assert list(ROOT.glob(name.rstrip("/"))), f"{page}: no {name}"


def test_the_readme_sets_up_and_tests() -> None:
    said = [line.split("#")[0].strip() for block in blocks("README.md", text("README.md")) for line in block.lines]
    assert {"make demo", "make test"} < set(said)


SCENARIO = (
    'duration = "1 s"\nchecks = ["last(speed) > 9"]\n[[path]]\nterrain = "sand"\n'
    '[[operator]]\nat = 0\nrequest = "idle"\n'
)
WRONG = {
    "an option that is not there": "```sh\nterrapin run steady_sand --lnk pty\n```\n",
    "one for hardware": "<!-- needs: hardware -->\n```sh\nterrapin run steady_sand --lnk socketcan:can0\n```\n",
    "a sub-command": "<!-- needs: hardware -->\n```sh\nterrapin rnu steady_sand\n```\n",
    "a long one": "<!-- long: echo short -->\n```sh\nterrapin papers --outt x\n```\n",
    "a short form that fails": "<!-- long: false -->\n```sh\nterrapin papers\n```\n",
    "a target of make": "<!-- long: echo short -->\n```sh\nmake demos\n```\n",
    "a program": "<!-- needs: hardware -->\n```sh\nformat-disk\n```\n",
    "a command that says nothing": "```sh\ntrue\n```\n",
    "the last line's status": "<!-- status: 1 -->\n```sh\nterrapin effects\n```\n",
    "one that must be interrupted": "<!-- until: Ctrl-C -->\n```sh\nterrapin web --prt 0\n```\n",
    "Python": "```python\nimport terrapin\n```\n",
    "TOML without a file": f"```toml\n{SCENARIO}```\n",
    "TOML that is none": "<!-- file: a.toml -->\n```toml\nduration =\n```\n",
    "TOML that nothing uses": "<!-- file: a.toml -->\n```toml\na = 1\n```\n",
    "a scenario whose check fails": f"<!-- file: a.toml -->\n```toml\n{SCENARIO}```\n",
    "a change of a case": '<!-- changes: cases/heated_motor/case.toml -->\n```toml\n[model]\neffects = ["x"]\n```\n',
    "a change that does not fit": "```diff\n--- a/Makefile\n+++ b/Makefile\n@@ -1,2 +1,3 @@\n a\n+b\n c\n```\n",
    "no language": "```\nterrapin effects\n```\n",
    "an unknown language": "```bash\nterrapin effects\n```\n",
    "an indented block": "Then\n\n    terrapin effects\n",
    "an unknown marker": "<!-- skip: it -->\n```sh\nterrapin effects\n```\n",
    "a marker above nothing": "<!-- needs: hardware -->\n\nText.\n",
    "a command posing as output": "<!-- shows: output -->\n```sh\nterrapin effects\n```\n",
}


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_block_is_caught(what: str, tmp_path: Path) -> None:
    runner = Runner(tmp_path / "terrapin")
    with pytest.raises(AssertionError):
        runner.page(blocks("page.md", WRONG[what]))


def test_a_right_page_passes_and_is_counted(tmp_path: Path) -> None:
    page = (
        "Text.\n\n```sh\necho one\necho two  # 2\n```\n\n<!-- needs: hardware -->\n```sh\nterrapin flash --list\n```\n"
    )
    runner = Runner(tmp_path / "terrapin")
    runner.page(blocks("page.md", page))
    assert (runner.ran, runner.hardware) == (1, 1)


@pytest.mark.parametrize("line", ["terrapin run x --nothing", "terrapin nothing", "make nothing", "python nothing.py"])
def test_a_wrong_command_in_the_text_is_caught(line: str) -> None:
    assert inline_commands(f"Say `{line}`.") == [line]
    with pytest.raises(AssertionError):
        read_command(line)
