"""A log of a bus or of a run, as columns with units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from terrapin_tools.door.named import Named
from terrapin_tools.errors import UserError, about, for_programs

if TYPE_CHECKING:
    from terrapin_tools.logs.decoding import Decoder

__all__ = ["Log"]


@final
class Log:
    """A log of any kind that `terrapin log` reads (docs/logs.md), and a DBC: it is read once, when it is first asked.

    >>> with Session("steady_sand", log="run") as s:
    ...     _ = s.step(0.2)
    >>> log = Log("run")
    >>> log.signals["GROUND.torque"], log["GROUND.torque"].column_names
    ('N m', ['time', 'GROUND.torque'])

    Parameters
    ----------
    path : a file, or the folder of a run.
    dbc : of the bus; a run's own, else the controller's, where none is named.

    Raises
    ------
    errors.InputError : there is no such log, or it is of no known kind.
    """

    __slots__ = ("_decoder", "_read", "dbc", "path")

    @for_programs
    def __init__(self, path: str | Path, dbc: str | Path | None = None) -> None:
        from terrapin_tools.logs.decoding import description_of
        from terrapin_tools.logs.reading import LogReader

        self.path = Path(path)
        self.dbc = Path(dbc) if dbc is not None else description_of(self.path)[0]
        LogReader(self.path)
        self._decoder: Decoder | None = None
        self._read: dict[str, Any] | None = None

    @property
    @for_programs
    def signals(self) -> dict[str, str]:
        """MESSAGE.SIGNAL of what is in the log -> its unit, "" for none."""
        tables, decoder = self._tables(), self._known()
        found = {f"{message}.{name}": unit for message in tables for name, unit in decoder.units(message)}
        return Named(found, f"{self.path}")

    @for_programs
    def __getitem__(self, name: str) -> Any:
        """A pyarrow.Table of `time` [s] and the signal, a row for each frame that carries it, the unit in its metadata.

        InputError when the log has no such signal.
        """
        from terrapin_tools.workbench.files.arrow_tables import labelled

        message, _, signal = name.partition(".")
        table = self._tables().get(message)
        if table is None or signal not in table.signals:
            known = [one for one in self.signals if one.startswith(f"{message}.")] or sorted(self._tables())
            raise UserError(f"{self.path}: found no {name}, expected one of {', '.join(known)}")
        values = table.signals[signal]
        there = values == values
        units = {"time": "s", name: dict(self._known().units(message))[signal]}
        return labelled({"time": table.times[there], name: values[there]}, units)

    @for_programs
    def table(self, period: str | float = "10 ms") -> Any:
        """All signals on a grid of time, the last value held, NaN before it: a pyarrow.Table with units in its
        metadata. `period`: "10 ms", or [s].
        """
        from terrapin_tools.logs.resample import signals_on_grid
        from terrapin_tools.workbench.files.arrow_tables import labelled
        from terrapin_tools.workbench.files.units import quantity

        with about("period"):
            seconds = quantity(period, "s")
        if not seconds > 0.0:
            raise UserError(f"period: found {period}, expected more than 0 s")
        return labelled(signals_on_grid(self.path, self._known(), seconds), {"time": "s", **self.signals})

    @for_programs
    def save(self, file: str | Path) -> Path:
        """Writes the log as another kind, by the suffix of `file` (docs/logs.md); MCAP has the signals too."""
        from terrapin_tools.logs.reading import LogReader
        from terrapin_tools.logs.writing import LogWriter

        with LogWriter(Path(file), self._known()) as out:
            for block in LogReader(self.path).blocks():
                out.write(block)
        return Path(file)

    def _known(self) -> Decoder:
        from terrapin_tools.logs.decoding import Decoder

        if self._decoder is None:
            self._decoder = Decoder(self.dbc)
        return self._decoder

    def _tables(self) -> dict[str, Any]:
        from terrapin_tools.logs.reading import read_log

        if self._read is None:
            self._read = self._known().decode(read_log(self.path)[0])
        return self._read

    def __reduce__(self) -> Any:
        return Log, (self.path, self.dbc)

    def __eq__(self, other: object) -> bool:
        return (self.path, self.dbc) == (other.path, other.dbc) if isinstance(other, Log) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.path, self.dbc))

    def __repr__(self) -> str:
        return f"Log({str(self.path)!r})"
