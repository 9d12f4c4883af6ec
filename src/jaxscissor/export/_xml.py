"""Elements of XML files."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element


def add(parent: Element, tag: str, **attributes: str) -> Element:
    """A new element at the end of another."""
    return ElementTree.SubElement(parent, tag, attributes)


def text_of(numbers: Iterable[float]) -> str:
    """Numbers to the last digit."""
    return " ".join(repr(float(number)) for number in numbers)
