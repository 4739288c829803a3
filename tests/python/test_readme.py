"""What README and docs say to type works, what they show as a file is one, and where they point there is something."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hil.physics.effects import Effect
from hil.physics.expression import parse
from hil.run import run
from hil.scenario import load_scenario

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = ["README.md", "CONTRIBUTING.md", *(str(p.relative_to(ROOT)) for p in sorted((ROOT / "docs").glob("*.md")))]


def blocks(document: str, language: str) -> list[str]:
    """Fenced blocks of a language in a document."""
    return re.findall(rf"^```{language}\n(.*?)^```", (ROOT / document).read_text(), re.MULTILINE | re.DOTALL)


def commands() -> list[str]:
    lines = "".join(blocks("README.md", "sh")).splitlines()
    return [line.split("#")[0].strip() for line in lines]


def test_readme_has_commands() -> None:
    assert {"make demo", "make test"} < set(commands())


@pytest.mark.parametrize("target", [line.split()[1] for line in commands() if line.startswith("make ")])
def test_make_target_exists_and_is_listed(target: str) -> None:
    subprocess.run(["make", "-n", target], cwd=ROOT, check=True, capture_output=True)
    listed = subprocess.run(["make", "help"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    assert re.search(rf"^make {target}\b", listed, re.MULTILINE)


def test_commands_of_the_readme_run(tmp_path: Path) -> None:
    """All but make's, in their order, in a folder that has cases/ and nothing else of the repository."""
    shutil.copytree(ROOT / "cases", tmp_path / "cases")
    (tmp_path / "out").mkdir()
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    others = [line for line in commands() if not line.startswith("make ")]
    assert others
    for line in others:
        done = subprocess.run(
            line, shell=True, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False
        )
        assert done.returncode == 0, f"{line}: exit {done.returncode}\n{done.stdout[-1500:]}\n{done.stderr[-1500:]}"
        assert line.startswith("cp ") or done.stdout.strip(), f"{line}: says nothing"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_somewhere(document: str) -> None:
    for target in re.findall(r"\]\((?!https://)([^)#]+)[^)]*\)", (ROOT / document).read_text()):
        assert (ROOT / document).parent.joinpath(target).exists(), f"{document}: {target}"


def test_scenario_of_the_documentation_passes(tmp_path: Path) -> None:
    examples = blocks("docs/scenarios.md", "toml")
    assert examples
    for number, text in enumerate(examples):
        path = tmp_path / f"example_{number}.toml"
        path.write_text(text)
        scenario = load_scenario(path)
        assert scenario.checks
        assert [outcome.text for outcome in run(scenario).outcomes if not outcome.passed] == []


def test_effect_of_the_documentation_is_one() -> None:
    (text,) = (block for block in blocks("docs/effects.md", "python") if "EFFECT = " in block)
    module: dict[str, object] = {}
    exec(compile(text, "docs/effects.md", "exec"), module)
    effect = module["EFFECT"]
    assert isinstance(effect, Effect)
    used = parse(effect.expression).names
    assert {parameter.name for parameter in effect.parameters} <= used
    assert used <= {parameter.name for parameter in effect.parameters} | {
        role for need in effect.needs for role in need
    }
