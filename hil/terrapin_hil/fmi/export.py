"""The robot, its controller, or both as an FMU: sources, model description, and a binary for this machine.

export("controller", Path("controller.fmu"))
export("both", Path("robot.fmu"), load_scenario(find_scenario("steady_sand")))

The controller is the firmware's own C, the plant the simulator's, compiled as both are here: the same bits.
"""

from __future__ import annotations

import hashlib
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from terrapin_hil import paths
from terrapin_hil.errors import UserError
from terrapin_hil.fmi.variables import Kind, Model, Type, model_description, model_variables, spoken
from terrapin_hil.library import ffi
from terrapin_hil.messages import Interface, interface
from terrapin_hil.robots import selected
from terrapin_hil.scenario.scenario import Scenario
from terrapin_hil.simulation import Simulation

__all__ = ["export", "platform_name"]

CORE_FLAGS = ("-std=c11", "-O2", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off")  # as the builds have them
TIMEOUT = 300.0  # s, of the compiler


def platform_name() -> str:
    """FMI 3.0's name of this platform, x86_64-linux."""
    system = {"linux": "linux", "darwin": "darwin", "win32": "windows"}.get(sys.platform, sys.platform)
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    return f"{machine}-{system}"


# -- the configuration as C --------------------------------------------------------------------------------------------


def _literal(value: Any, kind: Any, known: Mapping[int, str]) -> str:
    """A value of the simulator's configuration as an initialiser of C, exact."""
    if kind.kind == "primitive":
        if kind.cname in ("double", "float"):
            number = float(value)
            if math.isinf(number):
                return "INFINITY" if number > 0 else "-INFINITY"
            return "NAN" if math.isnan(number) else str(number.hex())
        if kind.cname in ("_Bool", "bool"):
            return "true" if value else "false"
        suffix = "ULL" if kind.cname == "uint64_t" else "U" if int(value) > 2**31 - 1 else ""
        return f"{int(value)}{suffix}"
    if kind.kind == "array":
        return "{" + ", ".join(_literal(value[i], kind.item, known) for i in range(kind.length)) + "}"
    if kind.kind == "struct":
        return "{" + ", ".join(f".{n} = {_literal(getattr(value, n), f.type, known)}" for n, f in kind.fields) + "}"
    if kind.kind == "pointer":
        return known[int(ffi().cast("uintptr_t", value))] if value != ffi().NULL else "NULL"
    raise AssertionError(kind.kind)


def _configuration(simulation: Simulation) -> list[str]:
    """FMU_CONFIG, and the tables that it points to."""
    known: dict[int, str] = {}
    lines = []
    for number, (pointer, values, count) in enumerate(simulation.tables()):
        address = int(ffi().cast("uintptr_t", pointer))
        if address in known:
            continue
        item = ffi().typeof(values).item
        known[address] = name = f"TABLE_{number}"
        shown = [_literal(values[i], item, known) for i in range(count)] or ["0"]
        lines += [f"static const {item.cname} {name}[] = {{", *(f"    {one}," for one in shown), "};"]
    config = simulation.config
    return [*lines, f"static const hil_config FMU_CONFIG = {_literal(config, ffi().typeof(config), known)};"]


# -- generated C -------------------------------------------------------------------------------------------------------

TYPES: tuple[tuple[Type, str], ...] = (
    ("float64", "double"), ("int32", "int32_t"), ("int64", "int64_t"), ("uint64", "uint64_t"), ("boolean", "bool"),
)  # fmt: skip


def _header(model: Model, token: str) -> str:
    lines = ["#ifndef MODEL_H", "#define MODEL_H", f'#define FMU_TOKEN "{token}"']
    lines += [
        f"#define FMU_CONTROLLER {int(model.kind != 'plant')}",
        f"#define FMU_PLANT {int(model.kind != 'controller')}",
    ]
    for type_, _ in TYPES:
        upper = type_.upper()
        lines.append(f"#define FMU_{upper}_COUNT {len(model.of(type_))}")
        lines.append(f"#define FMU_{upper}_PARAMETERS {len(model.of(type_, 'parameter'))}")
        lines.append(f"#define FMU_{upper}_INPUTS {len(model.of(type_, 'input'))}")
    names = [v for v in model.variables if "." not in v.name and v.type != "float64"]
    lines += [f"#define FMU_{v.name.upper()} {v.place}" for v in names]
    if model.kind != "plant":
        lines.append("#define FMU_PARAMETER 1")
        lines += [
            f"#define FMU_FRAME_{n.upper()} {model.named(f'frame_1.{n}').place}" for n in ("id", "length", "data")
        ]
    if model.kind != "controller":
        lines += [f"#define FMU_{n} {model.named(v).place}" for n, v in
                  (("TRUTH", "truth_time"), ("BETA", "beta"), ("ALPHA", "alpha"))]  # fmt: skip
    return "\n".join([*lines, "#endif", ""])


def _table(name: str, kind: str, values: Iterable[str]) -> str:
    return f"static const {kind} {name}[] = {{{', '.join([*values, '0'])}}};"


def _start(type_: str, value: float) -> str:
    if type_ == "float64":
        return float(value).hex()
    return ("true" if value else "false") if type_ == "boolean" else f"{int(value)}" + "U" * (type_ == "uint64")


def _tables(model: Model, interface: Interface, simulation: Simulation | None) -> str:
    lines = []
    for type_, kind in TYPES:
        lines.append(_table(f"FMU_{type_.upper()}_START", kind, (_start(type_, v.start) for v in model.of(type_))))
    if model.kind != "plant":
        parameters = interface.parameters.values()
        lines.append(_table("FMU_PARAMETER_SCALE", "double", (p.scale.hex() for p in parameters)))
        lines.append(_table("FMU_PARAMETER_NAME", "char *const", (f'"{p.name}"' for p in parameters)))
        rows = [
            f"{{{m.id}, {s.start}, {s.length}, {'true' if s.signed else 'false'}, {float(s.scale).hex()}, "
            f"{model.named(f'{m.name}.{s.name}').reference}}}"
            for m in spoken(interface)
            for s in m.signals
        ]
        lines += [f"#define FMU_SIGNALS {len(rows)}", "static const fmu_signal FMU_SIGNAL[] = {"]
        lines += [*(f"    {row}," for row in rows), "};"]
    if simulation is not None:
        lines += _configuration(simulation)
    return "\n".join([*lines, ""])


def _limits(model: Model) -> str:
    lines = []
    for type_, causality in (("float64", "parameter"), ("int32", "input")):
        found = model.of(type_, causality)  # type: ignore[arg-type]
        # Half a step of slack, so that a bound written as a decimal is inside; the firmware has the last word.
        slack = [1e-9 * max(abs(v.low or 0.0), abs(v.high or 0.0)) if type_ == "float64" else 0.0 for v in found]
        low = (float((v.low or 0.0) - s).hex() for v, s in zip(found, slack, strict=True))
        high = (float((v.high or 0.0) + s).hex() for v, s in zip(found, slack, strict=True))
        lines.append(_table(f"FMU_{type_.upper()}_LOW", "double", low))
        lines.append(_table(f"FMU_{type_.upper()}_HIGH", "double", high))
    return "\n".join([*lines, ""])


# -- the archive -------------------------------------------------------------------------------------------------------


def _sources(kind: Kind) -> dict[str, Path]:
    """Place below sources/ -> file."""
    tree = paths.firmware_sources()
    if tree is None:
        raise UserError(
            "fmu: found no sources of the firmware, expected a tree of them: set TERRAPIN_BUILD to its build/host"
        )
    generated, hil = paths.build() / "generated", tree / "hil" / "terrapin_hil"
    found = {path.name: path for path in sorted((hil / "fmi" / "native").glob("*.[ch]"))}
    interface_files = ["terrapin_interface.c", "terrapin_interface.h", "terrapin_pack.h", "terrapin_scaling.h"]
    found |= {f"core/{name}": paths.need(generated / name) for name in interface_files}
    core = tree / "firmware" / "core"
    patterns = ["*.[ch]"] if kind != "plant" else ["terrapin.h", "terrapin_assert.h"]
    found |= {f"core/{path.name}": path for pattern in patterns for path in sorted(core.glob(pattern))}
    if kind != "controller":
        found |= {f"{path.parent.name}/{path.name}": path for path in sorted((hil / "physics").rglob("*.[ch]"))}
        found |= {f"robot/{path.name}": path for path in sorted((hil / "robot" / "native").glob("*.[ch]"))}
    return found


def _compile(folder: Path, sources: Iterable[str], out: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        raise UserError("fmu: no C compiler found, expected cc on PATH")
    places = sorted({str(Path(source).parent) for source in sources})
    command = [compiler, *CORE_FLAGS, "-shared", *(f"-I{place}" for place in places)]
    command += [*(s for s in sorted(sources) if s.endswith(".c")), "-o", str(out), "-lm"]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        raise UserError(f"fmu: the compiler was not ready within {TIMEOUT:g} s", status=1) from None
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or ["it says nothing"]
        raise UserError(f"fmu: it cannot be compiled: {lines[0][:300]}", status=1)


def _build_description(model: Model, sources: Iterable[str]) -> str:
    files = [s for s in sorted(sources) if s.endswith(".c")]
    places = sorted({str(Path(s).parent) for s in sources} - {"."})
    return "\n".join([
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<fmiBuildDescription fmiVersion="3.0">',
        f'  <BuildConfiguration modelIdentifier="{model.name}">',
        '    <SourceFileSet language="C11" compilerOptions="-ffp-contract=off">',
        *(f"      <SourceFile name={quoteattr(name)}/>" for name in files),
        *(f"      <IncludeDirectory name={quoteattr(name)}/>" for name in places),
        "    </SourceFileSet>",
        "  </BuildConfiguration>",
        "</fmiBuildDescription>",
        "",
    ])  # fmt: skip


def _pack(folder: Path, out: Path) -> None:
    """The same files give the same bytes; the archive appears whole or not at all."""
    begun = out.with_name(out.name + ".begun")
    try:
        with zipfile.ZipFile(begun, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(folder.rglob("*")):
                if path.is_file():
                    entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), (1980, 1, 1, 0, 0, 0))
                    entry.external_attr = (0o755 if path.suffix == ".so" else 0o644) << 16
                    entry.compress_type = zipfile.ZIP_DEFLATED
                    archive.writestr(entry, path.read_bytes())
        os.replace(begun, out)
    finally:
        begun.unlink(missing_ok=True)


def export(kind: Kind, out: Path, scenario: Scenario | None = None) -> Model:
    """Writes the FMU of the process's robot to `out`; its variables.

    `scenario` is that of the plant (kind "plant", "both"), whose controller has the scenario's parameters. UserError
    without sources or compiler; OSError when the file cannot be written.
    """
    if (kind != "controller") != (scenario is not None):
        raise AssertionError("a plant has a scenario, a controller alone has none")
    known = interface()
    simulation = Simulation(scenario) if scenario is not None else None
    model = model_variables(kind, known, scenario.firmware if scenario else {}, scenario.seed if scenario else 0)
    sources = _sources(kind)
    tables = _tables(model, known, simulation)
    digest = hashlib.sha256(repr((model, tables)).encode())
    for name, path in sources.items():
        digest.update(name.encode() + path.read_bytes())
    token = digest.hexdigest()
    about = {"controller": "Controller firmware", "plant": "Robot on its ground", "both": "Robot and controller"}[kind]
    about += f" of {selected().name}" + (f", scenario {scenario.name}" if scenario else "")
    with tempfile.TemporaryDirectory(prefix="terrapin-fmu-") as made:
        folder = Path(made)
        place = folder / "sources"
        for target, source in sources.items():
            (place / target).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, place / target)
        (place / "model.h").write_text(_header(model, token), encoding="utf-8")
        (place / "model.inc").write_text(tables, encoding="utf-8")
        (place / "limits.inc").write_text(_limits(model), encoding="utf-8")
        (place / "buildDescription.xml").write_text(_build_description(model, sources), encoding="utf-8")
        binary = folder / "binaries" / platform_name() / f"{model.name}.so"
        binary.parent.mkdir(parents=True)
        _compile(place, sources, binary)
        seconds = scenario.duration if scenario else 10.0
        text = model_description(model, known, token, about, seconds)
        (folder / "modelDescription.xml").write_text(text, encoding="utf-8")
        _pack(folder, out)
    return model
