"""What an image could be sent through: debug probes, serial ports, CAN interfaces."""

from __future__ import annotations

from terrapin_hil.links.names import LinkName
from terrapin_tools.errors import UserError

__all__ = ["listing", "serial_ports"]


def serial_ports() -> list[tuple[str, str]]:
    """Serial ports with hardware behind them: (device, what it is)."""
    from serial.tools import list_ports

    return [(port.device, port.description) for port in sorted(list_ports.comports()) if port.hwid != "n/a"]


def _can_interfaces() -> list[tuple[str, str]]:
    import logging

    import can

    logging.getLogger("can").setLevel(logging.CRITICAL)  # of drivers that are not installed
    found = []
    for entry in can.detect_available_configs(["socketcan", "pcan", "kvaser", "vector", "ixxat", "gs_usb", "slcan"]):
        kind, channel = entry["interface"], entry["channel"]
        if kind != "slcan":  # any serial port could be one: those are listed already
            name = LinkName("socketcan" if kind == "socketcan" else "can", kind, str(channel))
            found.append((str(name), str(entry.get("device_name", kind))))
    return found


def listing() -> str:
    """Lines for the terminal: the value for --port or --link, and what it is."""
    lines = []
    from terrapin_tools.flash.swd import probes

    try:
        found = probes()
        missing = "none plugged in"
    except UserError as error:
        found, missing = [], str(error)
    for title, via, entries, nothing in (
        ("debug probes", "--via swd", found, missing),
        ("serial ports", "--link serial:..., --via stm32", serial_ports(), "none"),
        ("CAN interfaces", "--link", _can_interfaces(), "none"),
    ):
        lines.append(f"{title} ({via}):")
        lines += [f"  {name}  {what}" for name, what in entries] or [f"  {nothing}"]
    return "\n".join(lines)
