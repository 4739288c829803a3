"""The controller in this process: the same C step, called from the simulator's C loop or frame by frame."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrapin_hil.errors import UserError
from terrapin_hil.firmware import Firmware
from terrapin_hil.links.link import Link, LinkError
from terrapin_hil.links.names import LinkName
from terrapin_hil.messages import Frame, interface

if TYPE_CHECKING:
    from terrapin_hil.simulation import Simulation

__all__ = ["InProcess", "open_link"]


class InProcess(Link):
    """The step in libterrapin.so, as it stands after a reset.

    `flash` is the file in which it keeps parameters, made if absent. LinkError when another controller uses it. Its
    `node` number counts for what it is told about itself (NODE_REQUEST): frames have the identifiers of node 0 here.
    """

    name = "inprocess"

    def __init__(self, firmware: Firmware | None = None, flash: Path | None = None, node: int = 0) -> None:
        self.firmware = firmware or Firmware.open()
        self._lib, self._ffi = self.firmware.lib, self.firmware.ffi
        self._link, self._inputs = self._ffi.new("terrapin_link *"), self._ffi.new("terrapin_inputs *")
        self._outputs, self._reply = self._ffi.new("terrapin_outputs *"), self._ffi.new("terrapin_frame *")
        self._file: Any = None
        self._identity = self._ffi.new("terrapin_identity *")
        self._lib.terrapin_identity_init(self._identity, 0, node)
        self._node = self._ffi.new("terrapin_node *")
        self._lib.terrapin_node_init(self._node, node)
        self._stopped, self._stop_kept = 1 << interface().faults["stop_all"], False  # STOP_ALL, and as the file has it
        self._reset()
        if flash is not None:
            self._open_flash(flash)

    def _reset(self) -> None:
        self._state = self.firmware.new_state()
        self._lib.terrapin_link_init(self._link, self._state, self._inputs)
        self._link.identity = self._identity

    def _open_flash(self, path: Path) -> None:
        file = self._ffi.new("terrapin_flash_file *")
        error = self._lib.terrapin_flash_file_open(file, os.fsencode(path))
        if error:
            taken = "another controller uses it" if error == errno.EWOULDBLOCK else os.strerror(error)
            raise LinkError(f"{path}: {taken}")
        self._file = file
        self._stop_kept = bool(self._lib.terrapin_flash_file_stopped(file))
        self._store = self._ffi.new("terrapin_store *")
        self._lib.terrapin_store_open(self._store, self._ffi.addressof(file, "flash"), file.pages)
        self._lib.terrapin_link_use_store(self._link, self._state, self._store)
        self._identity.store = self._ffi.addressof(self._lib, "terrapin_flash_file_set_node")
        self._identity.context = file
        self._identity.stored = self._lib.terrapin_flash_file_node(file)

    def start(self, parameters: Mapping[str, float]) -> None:
        self._reset()
        for name, value in parameters.items():
            self.firmware.set_parameter(self._state, name, value)
        self._link.test_mode = True

    def power_on(self, parameters: Mapping[str, float]) -> None:
        """A reset as `start`, but with the parameters that are stored, and `parameters` over them."""
        self._reset()
        if self._file is not None:
            self._lib.terrapin_link_use_store(self._link, self._state, self._store)
            if self._lib.terrapin_flash_file_stopped(self._file):
                self._lib.terrapin_latch(self._state, self._stopped)
        for name, value in parameters.items():
            self.firmware.set_parameter(self._state, name, value)
        self._link.test_mode = True

    @property
    def bridge_on(self) -> bool:
        """The last step left the bridge on."""
        return bool(self._outputs.enable)

    def advance(self, simulation: Simulation, ticks: int) -> None:
        if simulation.disturbed:
            super().advance(simulation, ticks)
        else:
            simulation.run(self.firmware.step, self.firmware.address(self._state), ticks)

    def exchange(self, frames: Sequence[Frame]) -> list[Frame]:
        answers: list[Frame] = []
        for piece in self.outgoing(frames):
            for frame in piece:
                answers += self._take(self._native(frame))
        return answers

    def hear(self, frames: Sequence[Frame]) -> list[Frame]:
        """As `exchange`, but as a controller on a bus that it shares: of frames with the identifiers of the bus it
        takes its own, and it answers with its own."""
        answers: list[Frame] = []
        for heard in frames:
            frame = self._native(heard)
            if not self._lib.terrapin_node_receive(self._node, frame):
                continue
            for answer in self._take(frame):
                sent = self._native(answer)
                self._lib.terrapin_node_send(self._node, sent)
                answers.append(_plain(sent))
        return answers

    @property
    def dropped(self) -> dict[str, int]:
        """Frames that were taken from the link and not used, by cause (see link/dispatch.h)."""
        names = ("bad_crc", "repeated", "malformed", "out_of_place", "unsealed", "unknown")
        return {name: int(getattr(self._link, name)) for name in names}

    def _native(self, frame: Frame) -> Any:
        identifier, data = frame
        return self._ffi.new("terrapin_frame *", {"id": identifier, "length": len(data), "data": data})

    def _take(self, frame: Any) -> list[Frame]:
        """What one frame brings."""
        answers: list[Frame] = []
        result = self._lib.terrapin_accept(self._link, self._state, frame, self._inputs, self._reply)
        self._lib.terrapin_link_store_work(self._link, self._state)
        if result == self._lib.TERRAPIN_ACCEPT_STEP:
            self._lib.terrapin_link_step(self._state, self._inputs, self._outputs)
            answers += map(_plain, self._outputs.frames[0 : self._outputs.frame_count])
        elif result == self._lib.TERRAPIN_ACCEPT_REPLY:
            answers.append(_plain(self._reply))
        if self._file is not None:
            stopped = bool(self._lib.terrapin_latched(self._state) & self._stopped)
            if stopped != self._stop_kept:
                self._stop_kept = stopped
                self._lib.terrapin_flash_file_set_stopped(self._file, stopped)
        return answers

    def checkpoint(self) -> tuple[Any, ...]:
        """The controller's memory, for `restore` of this object until it is started anew. UserError for one that keeps
        parameters in a file."""
        if self._file is not None:
            raise UserError("checkpoint: the controller keeps its parameters in a file, expected one without")
        return self._state, [bytes(self._ffi.buffer(memory)) for memory in self._memory()]

    def restore(self, kept: tuple[Any, ...]) -> None:
        """Back to a `checkpoint`. UserError when the controller was started since."""
        state, contents = kept
        if state is not self._state:
            raise UserError("restore: the controller was started since, expected a checkpoint of the same start")
        for memory, content in zip(self._memory(), contents, strict=True):
            self._ffi.memmove(memory, content, len(content))

    def _memory(self) -> list[Any]:
        state = self._ffi.cast(f"char (*)[{self.firmware.state_size}]", self._state)
        return [state, self._link, self._inputs, self._outputs, self._identity, self._node]

    def close(self) -> None:
        if self._file is not None:
            self._lib.terrapin_flash_file_close(self._file)
        self._file = None


def _plain(frame: Any) -> Frame:
    return int(frame.id), bytes(frame.data[0 : frame.length])


def open_link(name: LinkName, timeout: float, flash: Path | None = None) -> InProcess:
    """The link; there is nothing to wait for. LinkError as for InProcess."""
    return InProcess(flash=flash, node=name.node)
