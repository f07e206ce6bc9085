"""XML of untrusted files: no document types, no entities, no absurd size or nesting."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.parsing import read_bytes

MAX_BYTES = 64 * 1024 * 1024
MAX_DEPTH = 100  # of elements

Node = ElementTree.Element


def read_xml(path: Path, root: str) -> Node:
    """Read the root element of an XML file; namespaces are left out of the tags.

    Args:
        path: the file.
        root: tag that the root element must have.

    Raises:
        FormatError: it cannot be read, is not such a file, or has a document type.
    """
    content = read_bytes(path, MAX_BYTES)
    builder = _GuardedBuilder(path)
    try:
        found = builder.build(content)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise FormatError(f"{path}: is not valid XML: {error}") from None
    if found.tag != root:
        raise FormatError(f"{path}: its root element is <{found.tag}>; it must be <{root}>")
    return found


class _GuardedBuilder:
    """Builds elements, and refuses what untrusted files must not have."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._builder = ElementTree.TreeBuilder()
        self._depth = 0

    def build(self, content: bytes) -> Node:
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._refuse
        parser.EntityDeclHandler = self._refuse
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._builder.data
        parser.Parse(content, True)
        return self._builder.close()

    def _refuse(self, *_: object) -> None:
        raise FormatError(f"{self._path}: has a document type or entities; remove the DOCTYPE part")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise FormatError(f"{self._path}: elements are nested deeper than {MAX_DEPTH}")
        self._builder.start(tag.rpartition(":")[2], attributes)

    def _end(self, tag: str) -> None:
        self._depth -= 1
        self._builder.end(tag.rpartition(":")[2])
