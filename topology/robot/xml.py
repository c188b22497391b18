"""XML as a tree of elements with their lines; document types are refused, so no entities are
read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

__all__ = ["Element", "XmlError", "parse"]

DEEPEST = 200
"""Largest depth of nesting [assumed: far above any robot's description]."""


class XmlError(ValueError):
    """The text is not XML, or not allowed here.

    Attributes
    ----------
    line : int
    """

    def __init__(self, reason: str, line: int) -> None:
        self.line = line
        super().__init__(reason)


@dataclass(eq=False)
class Element:
    """An element: its tag, attributes and children, and its line in the text."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def get(self, name: str) -> str | None:
        """Value of an attribute; None without it."""
        return self.attributes.get(name)

    def all(self, tag: str) -> list[Element]:
        """Children of that tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Element | None:
        """The first child of that tag; None if there is none."""
        return next(iter(self.all(tag)), None)

    def walk(self) -> Iterator[Element]:
        """The element and its descendants, in text order."""
        yield self
        for child in self.children:
            yield from child.walk()


def parse(text: bytes) -> Element:
    """The root element of a text.

    Raises
    ------
    XmlError
        It is not well formed, has a document type, or is nested too deep.

    Examples
    --------
    >>> parse(b"<robot>\\n<link name='palm'/></robot>").first("link").line
    2
    """
    parser = expat.ParserCreate()
    root: list[Element] = []
    open_: list[Element] = []

    def refuse(*_: object) -> None:
        raise XmlError("a document type, whose entities are not read", parser.CurrentLineNumber)

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(open_) == DEEPEST:
            raise XmlError(f"elements nested over {DEEPEST} deep", parser.CurrentLineNumber)
        element = Element(tag, attributes, parser.CurrentLineNumber)
        (open_[-1].children if open_ else root).append(element)
        open_.append(element)

    def end(_: str) -> None:
        open_.pop()

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise XmlError(expat.ErrorString(error.code), error.lineno) from None
    return root[0]
