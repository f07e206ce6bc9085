"""JSON and YAML texts to plain data: dicts with text as keys, lists, text, numbers, bool, None.

What is not plain, not Unicode, nested too deep, too large once unfolded, or stands twice is refused
here, so that no reader behind it has to look.
"""

from __future__ import annotations

import collections
import itertools
import json
import stat
import sys
import warnings
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any, Literal

import yaml

from mrta_falsify.core.errors import DoubledKeyError, FormatError, InputNote

MAX_FILE_BYTES = 256 * 1024 * 1024  # a world is under 1 MB; anything this large is a mistake
MAX_VALUES = 10_000_000  # of a file, unfolded: aliases of YAML make many of few
MAX_MERGED = 100_000  # fields that merge keys of YAML bring into one file
MAX_DEPTH = 100  # of lists and objects within each other; a record has some 10

MERGE, TEXT = "tag:yaml.org,2002:merge", "tag:yaml.org,2002:str"  # of YAML

#: which of several values of one key counts; ``refused``: the file is wrong
Doubled = Literal["refused", "first", "last"]


def refuse_pipe(path: Path) -> None:
    """Refuse what may never end: a named pipe, or a device, where a file should be.

    What the shell hands over itself, as ``/dev/stdin`` or by ``<(command)``, is read.

    Raises:
        FormatError: it is one.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return  # whoever reads it says why not
    is_odd = not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))
    if is_odd and path.parts[1:2] not in (("dev",), ("proc",)):
        raise FormatError(f"{path}: is a pipe, a socket or a device; it must be a file")


def read_text(path: Path) -> str:
    """Read a text file that the user named; every failure is a :class:`FormatError`."""
    try:
        return read_bytes(path).decode().replace("\r\n", "\n").replace("\r", "\n")
    except ValueError as error:
        raise FormatError(f"{path}: cannot be read: {_why_no_text(error)}") from None


def read_bytes(path: Path, most: int = MAX_FILE_BYTES) -> bytes:
    """Read a file that the user named, of at most ``most`` bytes.

    Raises:
        FormatError: it is larger, no file, or cannot be read.
    """
    try:
        refuse_pipe(path)
        size = path.stat().st_size
        if size > most:
            raise FormatError(
                f"{path}: the file has {size / 2**20:.0f} MB; at most {most // 2**20} MB"
            )
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else _why_no_text(error)
        raise FormatError(f"{path}: cannot be read: {reason}") from None


def _why_no_text(error: ValueError) -> str:
    return "it is not UTF-8 text" if isinstance(error, UnicodeDecodeError) else str(error)


def parse_json(
    text: str | bytes, where: str, *, doubled: Doubled = "refused", most: int = MAX_VALUES
) -> Any:
    """Give the data of a JSON text.

    Args:
        text: of the file or line.
        where: it stands; errors begin with it.
        doubled: which value counts of a key that stands twice in an object; an
            :class:`~mrta_falsify.core.errors.InputNote` names it.
        most: values that it may have.

    Returns:
        Plain data. NaN and infinity are in it where the text has them; ``codec.decode`` refuses
        them.

    Raises:
        FormatError: it is no JSON, nested too deep, has half a surrogate pair, a whole number of
            too many digits, or a key twice.
    """

    def object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = {sys.intern(key): value for key, value in pairs}  # records of a log share them
        if len(made) != len(pairs):
            _tell_doubled((key for key, _ in pairs), where, doubled)
            if doubled == "first":
                made = dict(reversed(pairs))
        return made

    count = text.count("," if isinstance(text, str) else b",")  # type: ignore[arg-type]
    if count > most:
        raise FormatError(f"{where}: has {count:.1e} values; at most {most}")
    try:
        data = json.loads(text, object_pairs_hook=object_of)
    except json.JSONDecodeError as error:
        raise FormatError(f"{where}: is not valid JSON: {error}") from None
    except RecursionError:
        raise FormatError(f"{where}: is not valid JSON: it is nested too deep") from None
    except UnicodeDecodeError:
        raise FormatError(f"{where}: is not valid JSON: it is not UTF-8 text") from None
    except ValueError:  # Python converts no number of thousands of digits
        detail = "a number in it has too many digits"
        raise FormatError(f"{where}: is not valid JSON: {detail}") from None
    _check_plain(data, where, "JSON", _height)
    return data


def parse_yaml(
    text: str, where: str, *, doubled: Doubled = "refused", as_text: Collection[str] = ()
) -> Any:
    """Give the data of a YAML text, read by the safe loader.

    Tags for other things than JSON has (dates, sets, binary data) are refused; a date without a
    tag is text.

    Args:
        text: of the file.
        where: as of :func:`parse_json`.
        doubled: as of :func:`parse_json`.
        as_text: fields of other tools' files. If one of them is at the top, every scalar of the
            file stays the text that was written, for a reader that knows what it needs: a name
            ``007`` is no 7, and ``5e-2`` is a number (YAML 1.1 takes it for text).

    Raises:
        FormatError: it is no YAML, a tag does not fit its value, or as :func:`parse_json`.
    """
    try:
        loader = _Loader(text, where, doubled)
        try:
            top = loader.get_single_node()
            if top is not None and _has_field(top, as_text):
                _keep_text(top)
            data = None if top is None else loader.construct_document(top)
        finally:
            loader.dispose()
    except RecursionError:
        raise FormatError(f"{where}: is not valid YAML: it is nested too deep") from None
    except (yaml.YAMLError, ValueError) as error:
        detail = " ".join(str(error).split()).replace('in "<unicode string>", ', "in ")
        raise FormatError(f"{where}: is not valid YAML: {detail}") from None
    _check_plain(data, where, "YAML", _height_unfolded)
    return data


def _has_field(top: yaml.Node, names: Collection[str]) -> bool:
    keys = [key for key, _ in top.value] if isinstance(top, yaml.MappingNode) else []
    return any(isinstance(key, yaml.ScalarNode) and key.value in names for key in keys)


def _keep_text(top: yaml.Node) -> None:
    """Let every scalar below a node be the text that was written."""
    seen, border = set(), [top]
    while border:
        node = border.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            border += [part for pair in node.value for part in pair]
        elif isinstance(node, yaml.SequenceNode):
            border += node.value
        elif node.tag != MERGE:
            node.tag = TEXT


def _tell_doubled(keys: Iterable[Any], where: str, doubled: Doubled) -> None:
    """Refuse keys that stand twice, or note which of their values counts."""
    counts = collections.Counter(keys)
    for key in [key for key, count in counts.items() if count > 1]:
        text = f"{where}: {_short(key)} is there twice in one object"
        if doubled == "refused":
            raise DoubledKeyError(f"{text}; leave one of them out")
        warnings.warn(InputNote(f"{text}; the {doubled} one counts"), stacklevel=4)


def _short(key: Any) -> str:
    text = str(key)
    return text if len(text) <= 60 and text.isprintable() else repr(text[:57] + "...")


def _check_plain(
    data: Any, where: str, language: str, height_of: Callable[[Any, str], int]
) -> None:
    """Refuse what no reader expects, wherever it stands in ``data``.

    Raises:
        FormatError: it is nested too deep, has too many values, or half a surrogate pair.
    """
    try:
        height = height_of(data, where)
    except UnicodeEncodeError as error:
        raise FormatError(
            f"{where}: is not valid {language}: {error.object[:40]!a} has half a surrogate pair, "
            "which is no character"
        ) from None
    except RecursionError:
        height = MAX_DEPTH + 1
    if height > MAX_DEPTH:
        raise FormatError(
            f"{where}: is nested too deep; at most {MAX_DEPTH} lists and objects in each other"
        )


def _height(data: Any, where: str) -> int:
    """Count the levels of lists and objects of which each is there once; look at all text.

    Raises:
        UnicodeEncodeError: a text is no Unicode.
    """
    del where
    level, height = [data], 0
    while level:
        objects = [item for item in level if type(item) is dict]
        lists = [item for item in level if type(item) is list]
        for text in level:
            if type(text) is str and not text.isascii():
                text.encode()
        for key in itertools.chain.from_iterable(objects):
            if not key.isascii():
                key.encode()
        if not objects and not lists:
            return height
        height += 1
        if height > MAX_DEPTH:
            return height
        level = list(itertools.chain.from_iterable(lists))
        for item in objects:
            level += item.values()
    return height


def _height_unfolded(data: Any, where: str) -> int:
    """Count the levels of data in which lists and objects may be there more than once.

    Raises:
        FormatError: unfolded, it has too many values.
        RecursionError, UnicodeEncodeError: as of :func:`_size`.
    """
    count, height = _size(data, {})
    if count > MAX_VALUES:
        raise FormatError(
            f"{where}: its aliases (*name) unfold to {count:.1e} values; at most {MAX_VALUES}"
        )
    return height


def _size(data: Any, known: dict[int, tuple[int, int]], depth: int = 0) -> tuple[int, int]:
    """Count the values of nested lists and objects, and their levels; look at all text.

    A list or object that is there twice counts twice and is looked at once.

    Args:
        data: plain.
        known: by identity, the counts of lists and objects of an earlier look.
        depth: of ``data`` in the whole.

    Raises:
        RecursionError: it is nested too deep.
        UnicodeEncodeError: a text is no Unicode.
    """
    if not isinstance(data, (list, dict)):
        if isinstance(data, str) and not data.isascii():
            data.encode()
        return 1, 0
    if id(data) not in known:
        if depth > MAX_DEPTH:
            raise RecursionError
        known[id(data)] = (MAX_VALUES + 1, 1)  # it holds itself, if this is ever read
        count, height = 1, 0
        if isinstance(data, dict):
            for key in data:
                if isinstance(key, str) and not key.isascii():
                    key.encode()
        for part in data.values() if isinstance(data, dict) else data:
            if isinstance(part, (float, int)):
                count += 1
                continue
            inside, levels = _size(part, known, depth + 1)
            count, height = count + inside, max(height, levels)
        known[id(data)] = (count, height + 1)
    return known[id(data)]


class _Loader(yaml.SafeLoader):
    """The safe loader, for plain data; a tag that does not fit its value is an error."""

    def __init__(self, text: str, where: str, doubled: Doubled) -> None:
        super().__init__(text)
        self._where, self._doubled = where, doubled
        self._merged = 0
        self._looked_at: set[yaml.Node] = set()

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Make the value of a node."""
        try:
            return super().construct_object(node, deep=deep)
        except (KeyError, IndexError, AttributeError, TypeError, ValueError, OverflowError):
            tag = node.tag.rpartition(":")[2]
            raise yaml.constructor.ConstructorError(
                None, None, f"{_short(node.value)} is no {tag}", node.start_mark
            ) from None

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Bring in what merge keys name, up to a limit; own keys must differ."""
        if node not in self._looked_at:
            self._looked_at.add(node)
            self._look_for_doubled(node)
        before = len(node.value)
        super().flatten_mapping(node)
        self._merged += max(0, len(node.value) - before)
        if self._merged > MAX_MERGED:
            raise FormatError(
                f"{self._where}: its merge keys (<<) bring in over {MAX_MERGED} fields"
            )

    def _look_for_doubled(self, node: yaml.MappingNode) -> None:
        keys = [
            (key.tag, key.value)
            for key, _ in node.value
            if isinstance(key, yaml.ScalarNode) and key.tag != MERGE
        ]
        if len(set(keys)) == len(keys):
            return
        _tell_doubled((value for _, value in keys), self._where, self._doubled)
        if self._doubled == "first":
            node.value = node.value[::-1]


def _plain_constructors() -> None:
    kept = ("null", "bool", "int", "float", "str", "seq", "map", "merge", "value")
    prefix = "tag:yaml.org,2002:"
    _Loader.yaml_constructors = {
        tag: made
        for tag, made in yaml.SafeLoader.yaml_constructors.items()
        if tag is None or tag.removeprefix(prefix) in kept
    }
    _Loader.yaml_implicit_resolvers = {
        first: [(tag, pattern) for tag, pattern in rows if tag != prefix + "timestamp"]
        for first, rows in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


_plain_constructors()
