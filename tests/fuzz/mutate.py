"""Ways to spoil a file: bytes, lines, tokens, numbers and fields."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random

#: Numbers on which readers trip.
NUMBERS = (
    "0", "-0", "-1", "1", "2", "9", "99999", "1e9", "-1e9", "1e308", "-1e308", "1e400", "-1e400",
    "1e-308", "1e-400", "nan", "NaN", "-nan", "inf", "-inf", "Infinity", "0x10", "1_0", "1.5D-2",
    ".5", "5.", "+1", "--1", "1e", "9" * 30, "9" * 400, "0." + "0" * 400 + "1", "2147483648",
    "9223372036854775808", "-9223372036854775809", "18446744073709551616", "1,5", "٣", "½",
)  # fmt: skip
#: Pieces of text with a meaning somewhere.
WORDS = (
    "", " ", "\t", "\r", "\x00", "\x1a", "\x1b[31m", "[/red]", "[bold]", "'", '"', "'''", '"""', "/",
    "//", "@!", "#", "%", "%{", "%}", "...", ";", ",", ",,", "=", "==", "[", "]", "[[", "]]", "{}",
    "\\", "\\u0000", "../../etc", "true", "false", "null", "None", "Q", "0 /", "é", "\U0001f4a5",
    "\ufeff", "${HOME}", "$(id)", "a" * 3000, "(" * 2000, "[" * 2000, "=" * 2000,
)  # fmt: skip
_TOKEN = re.compile(r"[^\s,;=/'\"\[\]]+")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
#: Longest text that a mutation makes.
_LONGEST = 2_000_000


def mutated(content: bytes, chance: Random, text: bool = True) -> bytes:
    """The content spoilt in one to four ways; in its bytes alone where it is no text."""
    for _ in range(chance.choice((1, 1, 1, 2, 2, 3, 4))):
        if not text or chance.random() < 0.15:
            content = _bytes(content, chance)
        else:
            way = chance.choice(_WAYS)
            content = way(content.decode("latin-1"), chance).encode("utf-8", "surrogatepass")
    return content[:_LONGEST]


def _bytes(content: bytes, chance: Random) -> bytes:
    data = bytearray(content)
    at = chance.randrange(len(data) + 1)
    length = min(chance.choice((1, 1, 1, 2, 4, 8, 64, 1000)), len(data) - at)
    kind = chance.randrange(6)
    if kind == 0:
        return content[:at]
    if kind == 1:
        del data[at : at + length]
    elif kind == 2:
        data[at:at] = chance.randbytes(chance.choice((1, 2, 8, 100)))
    elif kind == 3:
        data[at:at] = data[at : at + length] * chance.choice((1, 2, 50))
    else:
        for k in range(at, at + length):
            data[k] = (
                data[k] ^ (1 << chance.randrange(8))
                if kind == 4
                else chance.choice(b"\x00\xff\x7f")
            )
    return bytes(data)


def _lines(text: str, chance: Random) -> str:
    lines = text.splitlines(keepends=True) or [""]
    at, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    kind = chance.randrange(6)
    if kind == 0:
        del lines[at : at + chance.choice((1, 1, 1, 5, 50))]
    elif kind == 1:
        lines[at:at] = [lines[other]] * chance.choice((1, 1, 2, 500))
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 3:
        lines[at] = lines[at][: chance.randrange(len(lines[at]) + 1)]
    elif kind == 4:
        lines[at] = lines[at].rstrip("\r\n")
    else:
        lines[at:at] = [chance.choice(WORDS) + "\n"]
    return "".join(lines)


def _tokens(text: str, chance: Random) -> str:
    return _replaced(
        _TOKEN, text, chance, lambda old, all_of: chance.choice((*WORDS, *all_of[:40]))
    )


def _numbers(text: str, chance: Random) -> str:
    def new(old: str, all_of: list[str]) -> str:
        return chance.choice((*NUMBERS, "-" + old, old + "0", "1" + old, *all_of[:10]))

    return _replaced(_NUMBER, text, chance, new)


def _fields(text: str, chance: Random) -> str:
    lines = text.splitlines(keepends=True) or [""]
    with_fields = [k for k, line in enumerate(lines) if "," in line] or [0]
    at = chance.choice(with_fields)
    cells = lines[at].split(",")
    place, kind = chance.randrange(len(cells)), chance.randrange(4)
    if kind == 0:
        del cells[place]
    elif kind == 1:
        cells.insert(place, chance.choice((*NUMBERS, *WORDS)))
    elif kind == 2:
        cells[place] = chance.choice((*NUMBERS, *WORDS))
    else:
        cells[place:place] = [cells[place]] * chance.choice((1, 2, 300))
    lines[at] = ",".join(cells)
    return "".join(lines)


def _replaced(
    pattern: re.Pattern[str], text: str, chance: Random, new: Callable[[str, list[str]], str]
) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text + chance.choice(WORDS)
    match = chance.choice(found)
    others = [chance.choice(found)[0] for _ in range(10)]
    return text[: match.start()] + new(match[0], others) + text[match.end() :]


_WAYS = (_lines, _tokens, _tokens, _numbers, _numbers, _numbers, _fields, _fields)
