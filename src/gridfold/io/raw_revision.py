"""The revision of a PSS/E RAW file: by its header, or by the fields of its records.

Up to revision 30 bus records held shunts (``GL, BL``), since 31 they do not, so that all that
follows stands elsewhere; headers of that time give no revision, but many writers name one in a
comment. Up to 23 loads stood there too, and the name after all numbers. Since 34 the records of
branches have a name, since 35 those of generators and switched shunts have a node.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from enum import Enum

from gridfold.errors import CaseFileError, OptionError
from gridfold.io.raw_fields import Field, as_number, is_integer
from gridfold.io.raw_layouts import OLD_UNTIL
from gridfold.io.raw_sections import RawSections, fields_of

REVISIONS = range(29, 36)
READABLE = "gridfold reads revisions 29 to 35, and PSS/E can save a file as one of these"
_ADVICE = "--raw-revision 33 (raw_revision=33), or another one from 29 to 35, says how to read it"
_REVISION = 2  # place in the header
_VOLTAGES = (0.3, 2.5)  # p.u., of a bus


class Family(Enum):
    """Revisions whose records have the same fields as far as gridfold looks at them."""

    OLDEST = "revision 23 or older"
    OLD = "revision 30 or older"
    WITHOUT_NAMES = "revisions 31 to 33"
    WITH_NAMES = "revision 34"
    WITH_NODES = "revision 35"


_TAKEN = {Family.OLD: 30, Family.WITHOUT_NAMES: 33, Family.WITH_NAMES: 34, Family.WITH_NODES: 35}


def check_revision(revision: int | None) -> None:
    """Raise :class:`~gridfold.errors.OptionError` for a revision that cannot be asked for."""
    if revision is not None and revision not in REVISIONS:
        raise OptionError(f"raw_revision must be one of 29 to 35, not {revision!r}")


def _stated_revision(sections: RawSections) -> str:
    """The revision that the header gives, as it stands there; empty if it gives none."""
    fields = fields_of(sections.text.split("\n")[max(sections.header - 1, 0)])
    return fields[_REVISION].text.strip() if len(fields) > _REVISION else ""


def _commented_revision(sections: RawSections) -> str:
    """The revision in a comment of the header, as in ``/ PSS/E-30.3 RAW created ...``."""
    line = sections.text.split("\n")[max(sections.header - 1, 0)]
    named = re.search(r"/.*PSS\S{0,12}E-(\d{2})", line)
    return named[1] if named else ""


def find_revision(
    sections: RawSections, where: str, wanted: int | None = None
) -> tuple[int, list[str]]:
    """The revision of a file, and what is to be told of it; `where` is its name.

    A revision that is `wanted` is taken whatever header and records tell.

    Raises
    ------
    CaseFileError
        It is none that gridfold reads, the records contradict the header, or neither tells.
    """
    stated, found = _stated_revision(sections), _family(sections)
    if wanted is not None:
        if found is None or _suits(wanted, found):
            return wanted, []
        return wanted, [
            f"read as revision {wanted}, but the records have the fields of {found.value}"
        ]
    line = f"line {sections.header}: the header"
    if not stated:
        commented = _commented_revision(sections)
        too_old = commented and found is Family.OLD and int(commented) not in REVISIONS
        if found is Family.OLDEST or too_old:
            named = f", its comment names {commented}" if commented else ""
            fields = f"the bus records have the fields of {found.value if found else ''}"
            raise CaseFileError(f"{line} gives no revision{named}, and {fields}; {READABLE}", where)
        if found is Family.OLD and commented and int(commented) <= OLD_UNTIL:
            return int(commented), []
        if found is None:
            fault = f"{line} gives no revision, and the records have no fields that would tell"
            raise CaseFileError(fault, where, [_ADVICE])
        taken = _TAKEN[found]
        return taken, [
            f"the header gives no revision; the records have the fields of {found.value}, "
            f"read as {taken}"
        ]
    number = as_number(stated)
    if number is None or number not in REVISIONS:
        raise CaseFileError(f"{line} gives the revision {stated!r}; {READABLE}", where)
    revision = int(number)
    if found is not None and not _suits(revision, found):
        fault = (
            f"{line} gives revision {revision}, but the records have the fields of {found.value}"
        )
        raise CaseFileError(fault, where, [_ADVICE])
    return revision, []


def _suits(revision: int, found: Family) -> bool:
    """Whether records of this revision can have such fields; 34 and 35 are hard to tell apart."""
    if found in (Family.OLDEST, Family.OLD) or revision <= OLD_UNTIL:
        return found is Family.OLD and revision <= OLD_UNTIL
    return (revision >= 34) == (found is not Family.WITHOUT_NAMES)


def _family(sections: RawSections) -> Family | None:
    """What the fields of the records tell; None where that is nothing, or no one thing."""
    votes = {_bus_vote(fields) for fields in _records(sections, "BUS")} - {None}
    if votes != {Family.WITHOUT_NAMES}:
        return votes.pop() if len(votes) == 1 else None
    if not _branches_have_names(sections):
        return Family.WITHOUT_NAMES
    return _with_nodes(sections)


def _records(sections: RawSections, name: str) -> Iterator[list[Field]]:
    lines = sections.text.split("\n")
    return (fields_of(lines[number - 1]) for number in sections.of(name))


def _bus_vote(fields: Sequence[Field]) -> Family | None:
    """Of which revisions the fields of a bus are; None if they may be of several."""
    text = [field.text.strip() for field in fields] + [""] * 13
    if as_number(text[1]) is not None and text[9] and as_number(text[9]) is None:
        return Family.OLDEST  # before revision 24 the name came tenth
    old = (
        _numbers(text[4:6])
        and _codes(text[6:8])
        and _voltage(text[8])
        and (not text[10] or is_integer(text[10]))
    )
    new = _codes(text[4:7]) and _voltage(text[7])
    if old == new:
        return None
    return Family.OLD if old else Family.WITHOUT_NAMES


def _numbers(texts: Sequence[str]) -> bool:
    return all(not text or as_number(text) is not None for text in texts)


def _codes(texts: Sequence[str]) -> bool:
    """Whether these can be numbers of areas, zones and owners."""
    return all(not text or (is_integer(text) and int(text) > 0) for text in texts)


def _voltage(text: str) -> bool:
    value = as_number(text) if text else 1.0
    return value is not None and _VOLTAGES[0] <= value <= _VOLTAGES[1]


def _branches_have_names(sections: RawSections) -> bool:
    seventh = [fields[6] for fields in _records(sections, "BRANCH") if len(fields) > 6]
    told = [field for field in seventh if field.quoted or not field.blank]
    if told:
        return any(field.quoted or as_number(field.text) is None for field in told)
    return bool(sections.named & {"SYSTEM SWITCHING DEVICE", "SUBSTATION"})


def _with_nodes(sections: RawSections) -> Family | None:
    units = [fields[8].text for fields in _records(sections, "GENERATOR") if len(fields) > 8]
    loads = [len(fields) for fields in _records(sections, "LOAD")]
    if "0" in units or max(loads, default=0) > 17:
        return Family.WITH_NODES
    return Family.WITH_NAMES if any(as_number(text) for text in units) else None
