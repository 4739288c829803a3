"""The packages of this tree become importable through a static .pth, which editors and type checkers follow, `terrapin`
a command, the version known, and what the project offers to pytest and python-can (entry points). A wheel is what
others install (docs/install.md).

    link_project.py [SITE SCRIPTS]    folders of the environment; without them those of this Python
"""

import os
import sys
import sysconfig
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
site, scripts = (Path(word) for word in sys.argv[1:3] or [sysconfig.get_path(n) for n in ("purelib", "scripts")])
folders = [str(ROOT / name) for name in ("hil", "host_tools", "firmware")]
(site / "terrapin.pth").write_text("\n".join(folders) + "\n")
command = scripts / "terrapin"
command.write_text(f"#!{sys.executable}\nfrom terrapin_tools.cli import main\n\nmain()\n")
command.chmod(0o755)
about = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
about.mkdir(exist_ok=True)
extras = project.get("optional-dependencies", {})  # what a line tells to install, pip finds here as well
texts = {
    "METADATA": f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    + "".join(f"Provides-Extra: {extra}\n" for extra in extras)
    + "".join(f'Requires-Dist: {name}; extra == "{extra}"\n' for extra, names in extras.items() for name in names),
    "entry_points.txt": "".join(
        f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in entries.items()) + "\n"
        for group, entries in project.get("entry-points", {}).items()
    ),
}
for name, text in texts.items():
    (about / name).unlink(missing_ok=True)
    (about / name).write_text(text)
# so that pip can replace it by a wheel
files = [site / "terrapin.pth", command, *(about / name for name in texts), about / "RECORD"]
(about / "RECORD").write_text("".join(f"{os.path.relpath(path, site)},,\n" for path in files))
