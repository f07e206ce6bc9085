"""JSON and YAML texts that are damaged as files of strangers are, by the structure of the text."""

from __future__ import annotations

import json
import random
import re
from typing import Any

import yaml

NUMBER = re.compile(r"(?<![\w.\"])-?\d+(\.\d+)?([eE][-+]?\d+)?(?![\w\"])")
NUMBERS = ("NaN", "Infinity", "1e400", "1e308", "-1", "9" * 400, "9" * 5000, "true", "null", '"1"')
SCALARS = (
    *("!!bool maybe", '!!int ""', "!!float '-'", "!!timestamp soon", "!!binary x", "!!set {a, b}"),
    *("!!omap [a: 1]", "!!python/name:os.system x", "!foo 3", "2001-13-45", "=", "<<", "!!int _"),
    *(
        "0b",
        "190:20:30",
        ".nan",
        ".inf",
        "9" * 400,
        "!!merge x",
        "? [a, b]",
        "{[1, 2]: 3}",
        '"\\ud800"',
    ),
)


def damaged_json(data: Any, rnd: random.Random) -> tuple[str, bool]:
    """Write data as JSON with a damage; also say whether every reader must refuse it."""
    text = json.dumps(data)
    act = rnd.randrange(7)
    if act == 0 and '": ' in text:
        key = rnd.choice(re.findall(r'"([^"\\]{1,40})": ', text) or ["a"])
        spot = text.find(f'"{key}": ')
        if spot >= 0:
            return text[:spot] + f'"{key}": 1, ' + text[spot:], True
    if act == 1:
        depth = rnd.choice([101, 500, 100_000])
        return "[" * depth + text + "]" * depth, True
    if act == 2:
        return '{"a\\ud800": ' + text + "}", True
    if act == 3:
        return text[: rnd.randrange(len(text))], len(text) > 1 and text[0] in "[{"
    if act == 4:
        return rnd.choice(["", "nul", "{", "\ufeff{}", "{'a': 1}", "[1,]", "\x00"]), True
    spots = list(NUMBER.finditer(text))
    if not spots:
        return text + "}", True
    spot = rnd.choice(spots)
    return text[: spot.start()] + rnd.choice(NUMBERS) + text[spot.end() :], False


def damaged_yaml(data: Any, rnd: random.Random) -> tuple[str, bool]:
    """Write data as YAML with a damage; also say whether every reader must refuse it."""
    text = yaml.safe_dump(data, allow_unicode=True)
    act = rnd.randrange(7)
    if act == 0 and isinstance(data, dict) and data:
        key = rnd.choice(list(data))
        return text + yaml.safe_dump({key: data[key]}), True
    if act == 1:
        levels = rnd.choice([6, 25, 60])
        rows = ["m0: &m0 {a: 1, b: 2, c: 3}"]
        rows += [f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}'] * 9)}]}}" for i in range(1, levels)]
        return "\n".join(rows) + "\n" + text, True
    if act == 2:
        levels = rnd.choice([9, 15, 300])
        rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
        rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
        return "\n".join(rows) + "\n" + text, True
    if act == 3:
        return rnd.choice(
            ["&a [*a]", "&a {b: *a}", "[" * 3000, "- " * 2000, "\t", "%YAML 9\n---\na"]
        ), True
    spots = list(re.finditer(r"(?<=: )[^\s{}\[\],&*#|>][^\n{}\[\],#]*$", text, re.MULTILINE))
    if not spots:
        return text + "\nz: !!bool maybe\n", True
    spot = rnd.choice(spots)
    new = rnd.choice(SCALARS)
    return text[: spot.start()] + new + text[spot.end() :], False
