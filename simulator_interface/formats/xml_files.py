"""XML of untrusted files: no document types, no entities, no absurd size or nesting."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from mrta_falsify.core.errors import FormatError

MAX_BYTES = 64 * 1024 * 1024
MAX_DEPTH = 100  # of elements

Node = ElementTree.Element


def read_xml(path: Path, root: str) -> Node:
    """Root element of an XML file; namespaces are left out of the tags.

    Args:
        path: the file.
        root: tag that the root element must have.

    Raises:
        FormatError: it cannot be read, is no such file, or has a document type.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            limit = MAX_BYTES // 2**20
            raise FormatError(f"{path}: the file has {size / 2**20:.0f} MB; at most {limit} MB")
        content = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    builder = ElementTree.TreeBuilder()
    depth = 0

    def refuse(*_: object) -> None:
        raise FormatError(f"{path}: has a document type or entities; remove the DOCTYPE part")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise FormatError(f"{path}: elements are nested deeper than {MAX_DEPTH}")
        builder.start(tag.rpartition(":")[2], attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag.rpartition(":")[2])

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise FormatError(f"{path}: is not valid XML: {error}") from None
    found = builder.close()
    if found.tag != root:
        raise FormatError(f"{path}: its root element is <{found.tag}>; it must be <{root}>")
    return found
