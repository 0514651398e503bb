"""The content of a study file as text, for people to read again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def study_file_text(content: Mapping[str, Any]) -> str:
    """The content of a study as TOML, with all defaults; keys without a value are left out.

    Parameters
    ----------
    content : mapping
        As :meth:`gridfold.study.Study.content` gives it.
    """
    return "\n".join(_table(content, "")).strip() + "\n"


def _table(content: Mapping[str, Any], name: str) -> list[str]:
    lines = [f"{key} = {_value(value)}" for key, value in content.items() if _is_plain(value)]
    for key, value in content.items():
        inner = f"{name}.{key}".lstrip(".")
        if isinstance(value, Mapping):
            lines += ["", f"[{inner}]", *_table(value, inner)]
        elif _are_tables(value):
            for item in value:
                lines += ["", f"[[{inner}]]", *_table(item, inner)]
    return lines


def _is_plain(value: Any) -> bool:
    return value is not None and not isinstance(value, Mapping) and not _are_tables(value)


def _are_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _value(value: Any) -> str:
    # Strings, numbers, truth values and lists of them are written alike in TOML and JSON.
    return json.dumps(value, ensure_ascii=False)
