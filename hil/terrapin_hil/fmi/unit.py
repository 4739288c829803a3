"""An FMU of FMI 3.0 for co-simulation, opened: its variables, and its steps through fixed buffers.

An FMU is native code that runs in this process. Open one that you trust.

with Unit(Path("motor.fmu")) as unit:
    unit.start()
    unit.set("voltage", 5.0); unit.step(1e-3); unit.get("omega")
"""

from __future__ import annotations

import os
import queue
import shutil
import tempfile
import threading
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any, Self

import cffi

from terrapin_hil.errors import UserError
from terrapin_hil.fmi.export import platform_name

__all__ = ["Block", "Unit"]

FILES, BYTES, DESCRIPTION = 20_000, 2**30, 2**24  # what an archive may hold, unpacked; of modelDescription.xml
PATIENCE = 30.0  # s for loading and initialising
C_TYPES = {"Float64": "double", "Int32": "int32_t", "Int64": "int64_t", "UInt64": "uint64_t", "Boolean": "bool",
           "Float32": "float", "UInt32": "uint32_t", "Int16": "int16_t", "UInt16": "uint16_t"}  # fmt: skip
STATUS = ("OK", "warning", "discard", "error", "fatal error")
SUFFIX = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}


@cache
def _ffi() -> cffi.FFI:
    found = cffi.FFI()
    accessors = "".join(
        f"int fmi3Get{name}(void *, const uint32_t *, size_t, {kind} *, size_t);\n"
        f"int fmi3Set{name}(void *, const uint32_t *, size_t, const {kind} *, size_t);\n"
        for name, kind in C_TYPES.items()
    )
    found.cdef(
        accessors
        + """
        typedef void (*logger)(void *, int, const char *, const char *);
        void *fmi3InstantiateCoSimulation(const char *, const char *, const char *, bool, bool, bool, bool,
                                          const uint32_t *, size_t, void *, logger, void *);
        void fmi3FreeInstance(void *);
        int fmi3EnterInitializationMode(void *, bool, double, double, bool, double);
        int fmi3ExitInitializationMode(void *);
        int fmi3Terminate(void *);
        int fmi3DoStep(void *, double, double, bool, bool *, bool *, bool *, double *);
        int fmi3GetFMUState(void *, void **);
        int fmi3SetFMUState(void *, void *);
        int fmi3FreeFMUState(void *, void **);
        """
    )
    return found


@dataclass(frozen=True)
class _Variable:
    name: str
    type: str
    reference: int
    causality: str


class Block:
    """Variables of one type that are set or read together; `values` is the buffer."""

    def __init__(self, unit: Unit, names: Sequence[str], setting: bool) -> None:
        found = [unit.variables[name] for name in names]
        (type_,) = {one.type for one in found}
        ffi = _ffi()
        self.names = tuple(names)
        self.values = ffi.new(f"{C_TYPES[type_]}[]", len(found))
        self._references = ffi.new("uint32_t[]", [one.reference for one in found])
        self._function = getattr(unit.library, f"fmi3{'Set' if setting else 'Get'}{type_}")
        self._unit = unit

    def __call__(self) -> Any:
        """Sets them from the buffer, or reads them into it; the buffer."""
        count = len(self.names)
        self._unit.require(
            self._function(self._unit.instance, self._references, count, self.values, count), ", ".join(self.names)
        )
        return self.values


class Unit:
    """An FMU that is loaded. UserError where it is none of FMI 3.0 for co-simulation on this machine."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._folder = tempfile.mkdtemp(prefix="terrapin-fmu-")
        self.instance: Any = None
        self.library: Any = None
        self._said = ""
        self._jobs: queue.SimpleQueue[Callable[[], Any] | None] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[tuple[Any, BaseException | None]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self.late = self.failed = False
        try:
            self._unpack()
            self._describe()
        except BaseException:
            self.close()
            raise

    def _refused(self, found: str, expected: str, status: int = 2) -> UserError:
        return UserError(f"{self.path}: found {found}, expected {expected}", status=status)

    def _unpack(self) -> None:
        try:
            with zipfile.ZipFile(self.path) as archive:
                entries = archive.infolist()
                if len(entries) > FILES or sum(entry.file_size for entry in entries) > BYTES:
                    raise self._refused("an archive that unpacks to too much", f"at most {FILES} files of 1 GB in all")
                for entry in entries:
                    place = PurePosixPath(entry.filename.replace("\\", "/"))
                    if place.is_absolute() or ".." in place.parts:
                        raise self._refused(f"the place {entry.filename[:80]!r} inside", "places within the archive")
                archive.extractall(self._folder)
        except (zipfile.BadZipFile, NotImplementedError, EOFError, RuntimeError):
            raise self._refused("no archive that can be read", "an FMU") from None

    def _describe(self) -> None:
        file = Path(self._folder) / "modelDescription.xml"
        if not file.is_file() or file.stat().st_size > DESCRIPTION:
            raise self._refused("no modelDescription.xml of up to 16 MB", "an FMU")
        try:
            root = ElementTree.parse(file).getroot()
        except ElementTree.ParseError as error:
            raise self._refused(f"modelDescription.xml: {error}", "XML") from None
        version = root.get("fmiVersion", "none")
        if not version.startswith("3."):
            raise self._refused(f"FMI {version[:20]}", "FMI 3.0")
        simulation = root.find("CoSimulation")
        if simulation is None:
            raise self._refused("an FMU without co-simulation", "one for it")
        self.model = simulation.get("modelIdentifier", "")
        self.token = root.get("instantiationToken", "")
        self.step_size = float(simulation.get("fixedInternalStepSize", "0"))
        self.keeps_state = simulation.get("canGetAndSetFMUState") == "true"
        self.variables: dict[str, _Variable] = {}
        for one in root.iterfind("ModelVariables/*"):
            type_ = "Int64" if one.tag == "Enumeration" else one.tag
            name, reference = one.get("name", ""), int(one.get("valueReference", "0"))
            if one.find("Dimension") is None:
                self.variables[name] = _Variable(name, type_, reference, one.get("causality", "local"))

    # -- its thread: what an FMU does cannot be interrupted, only waited for -----------------------------------------

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                self._answers.put((job(), None))
            except BaseException as error:
                self._answers.put((None, error))

    def within(self, seconds: float, job: Callable[[], Any]) -> Any:
        """What `job` gives, in the thread that all of the FMU's work is done in. UserError when it comes late."""
        if self.late:
            raise UserError(f"{self.path}: it did not answer before, expected a new start", status=1)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="fmu", daemon=True)
            self._thread.start()
        self._jobs.put(job)
        try:
            found, error = self._answers.get(timeout=seconds)
        except queue.Empty:
            self.late = True
            raise UserError(f"{self.path}: no answer within {seconds:g} s", status=1) from None
        if error is not None:
            raise error
        return found

    def require(self, status: int, doing: str) -> None:
        """UserError, with what the FMU said, where it is not well."""
        if status > 1:
            if status > 2:  # after an error its end alone is allowed, after a fatal one not even that
                self.failed = True
            if status > 3:
                self.instance = None
            said = f": {self._said}" if self._said else ""
            word = STATUS[status] if status < len(STATUS) else str(status)
            raise UserError(f"{self.path}: {word} at {doing[:200]}{said}", status=1)

    def _log(self, _: Any, status: int, category: Any, message: Any) -> None:
        if status > 1:
            self._said = _ffi().string(message, 300).decode(errors="replace") if message else ""

    def _load(self) -> None:
        system = platform_name().rpartition("-")[2]
        file = Path(self._folder) / "binaries" / platform_name() / f"{self.model}{SUFFIX.get(system, '.so')}"
        if not file.is_file():
            there = sorted(one.name for one in (Path(self._folder) / "binaries").glob("*"))
            raise self._refused(f"binaries for {', '.join(there) or 'no platform'}", f"one for {platform_name()}")
        ffi = _ffi()
        try:
            self.library = ffi.dlopen(str(file))
        except OSError as error:
            raise UserError(f"{self.path}: its binary cannot be loaded: {error}", status=1) from None
        self._callback = ffi.callback("logger", self._log)
        resources = os.path.join(self._folder, "resources", "")
        self.instance = self.library.fmi3InstantiateCoSimulation(
            b"terrapin", self.token.encode(), resources.encode(), False, False, False, False, ffi.NULL, 0, ffi.NULL,
            self._callback, ffi.NULL,
        )  # fmt: skip
        if self.instance == ffi.NULL:
            self.instance = None
            raise UserError(f"{self.path}: it cannot be instantiated: {self._said or 'it does not say why'}", status=1)

    def _initialise(self, values: Mapping[str, float]) -> None:
        self._load()
        for name, value in values.items():
            block = Block(self, [name], True)
            block.values[0] = value
            block()
        self.require(self.library.fmi3EnterInitializationMode(self.instance, False, 0.0, 0.0, False, 0.0), "its start")
        self.require(self.library.fmi3ExitInitializationMode(self.instance), "its initialisation")
        ffi = _ffi()
        self._flags, self._last = ffi.new("bool[3]"), ffi.new("double *")
        self.time = 0.0

    def start(self, values: Mapping[str, float] | None = None) -> None:
        """Loads and initialises it with these parameters and inputs over its own. UserError."""
        self.within(PATIENCE, lambda: self._initialise(values or {}))

    def step(self, ticks: int = 1, done: int = 0) -> None:
        """`ticks` of 1 ms, `done` of them before; in its thread (`within`)."""
        if self.failed:
            raise UserError(f"{self.path}: it failed before, expected a new start", status=1)
        flags = self._flags
        status = self.library.fmi3DoStep(
            self.instance, done * 1e-3, ticks * 1e-3, True, flags, flags + 1, flags + 2, self._last
        )
        self.require(status, f"the step from {done * 1e-3:.3f} s")
        if flags[1]:
            raise UserError(f"{self.path}: it ends at {done * 1e-3:.3f} s, expected it to go on", status=1)

    def keep(self) -> Any:
        """Its state, for `back`; in its thread."""
        ffi = _ffi()
        state = ffi.new("void **")
        self.require(self.library.fmi3GetFMUState(self.instance, state), "keeping its state")
        return state

    def back(self, state: Any) -> None:
        """To a state that was kept; in its thread."""
        self.require(self.library.fmi3SetFMUState(self.instance, state[0]), "going back to a state")

    def _end(self) -> None:
        instance, self.instance = self.instance, None
        if instance is not None:
            if not self.failed:
                self.library.fmi3Terminate(instance)
            self.library.fmi3FreeInstance(instance)

    def close(self) -> None:
        """Ends it; what does not answer is left to the end of the process."""
        if self._thread is not None and not self.late:
            try:
                self.within(PATIENCE, self._end)
            finally:
                self._jobs.put(None)
                self._thread = None
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
