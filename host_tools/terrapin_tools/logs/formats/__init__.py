"""Kinds of CAN logs, one file each: a new kind is a new file here.

A module has SUFFIXES, `recognises(head) -> bool | None` (of the first bytes; None: its suffix alone says it) and
`blocks(source) -> Iterator[Frames]`.
"""
