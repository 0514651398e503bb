"""Records of a file of dynamic data, as they stand there: not yet devices of a case."""

from __future__ import annotations

from dataclasses import dataclass

from gridfold.grid.case import UnitKey


@dataclass(frozen=True)
class DynamicRecord:
    """One record of PSS/E dynamics data: a model at a bus, and its numbers.

    Parameters
    ----------
    model : str
        Name of the model, in upper case.
    bus : int
        Bus number; 0 in models that belong to no single bus.
    id : str
        Machine id, or what else stands in its place.
    values : tuple of float or str
        All that follows, in the order of the file; texts where it has texts.
    line : int
        Line at which the record begins, from 1.
    announced : (int, int) or None
        Numbers of ICONs and CONs that a user-written record says it has.
    """

    model: str
    bus: int
    id: str
    values: tuple[float | str, ...]
    line: int
    announced: tuple[int, int] | None = None

    @property
    def key(self) -> UnitKey:
        """Bus number and id."""
        return UnitKey(self.bus, self.id)

    def __str__(self) -> str:
        return f"{self.model} {self.key}"


@dataclass(frozen=True)
class SkippedRecord:
    """A record that is not read further.

    Parameters
    ----------
    line : int
        Line at which the record begins, from 1.
    text : str
        Its beginning.
    unit : UnitKey or None
        Bus and id of a user-written model, whose equations are in code that the user has; None for
        a record that is no device record of PSS/E at all.
    is_comment : bool
        Whether it stands behind the ``/`` of another record, where PSS/E reads nothing.
    model : str
        Its second item in upper case, where a device record has its model.
    user_written : DynamicRecord or None
        A user-written model of a machine (``USRMDL``) by the name of that model, with its ICONs and
        CONs as values: for those who have the model.
    """

    line: int
    text: str
    unit: UnitKey | None = None
    is_comment: bool = False
    model: str = ""
    user_written: DynamicRecord | None = None


@dataclass(frozen=True)
class DynamicData:
    """All records of one file, in its order; `file` is its name, for messages."""

    file: str
    records: tuple[DynamicRecord, ...]
    skipped: tuple[SkippedRecord, ...] = ()
