"""A page is one file of HTML that parsers read, holds what it was given as text, and loads nothing."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform.errors import LithoformError
from lithoform.report.page import Bullets, Cell, Page, Paragraph, Picture, Table

SPACE = "{http://www.w3.org/1999/xhtml}"
# The smallest PNG file: one pixel.
PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


def parsed(page: Page) -> ET.Element:
    return ET.fromstring(page.to_bytes())


def texts(root: ET.Element, tag: str) -> list[str]:
    return ["".join(element.itertext()) for element in root.iter(SPACE + tag)]


def full(label: str = "scans") -> Page:
    page = Page(f"Two populations: {label}")
    page.add(Paragraph(f"A is {label}."), Bullets((label, "second")))
    head = ("descriptor", label, "p", "verdict")
    rows = (
        ("roundness", "0.33", "0.01", Cell(f"differs from {label}", "strong")),
        ("solidity", "0.9", "0.4", Cell("agrees", "same")),
    )
    page.section(f"Numbers of {label}", Table(head, rows, caption=label, long=(3,), groups=(1,)))
    page.section("Pictures", Picture(PNG, label, caption=f"{label} as histograms"))
    return page


def test_what_goes_in_comes_out() -> None:
    root = parsed(full())
    assert texts(root, "title") == texts(root, "h1") == ["Two populations: scans"]
    assert texts(root, "h2") == ["Numbers of scans", "Pictures"]
    assert texts(root, "th") == ["descriptor", "scans", "p", "verdict"]
    assert texts(root, "td")[:4] == ["roundness", "0.33", "0.01", "differs from scans"]
    assert texts(root, "li") == ["scans", "second"]
    image = next(root.iter(SPACE + "img"))
    assert base64.b64decode(image.get("src").removeprefix("data:image/png;base64,")) == PNG
    assert image.get("alt") == "scans"
    tones = [cell.get("class") for cell in root.iter(SPACE + "td")]
    assert tones[3] == "text long strong"
    assert tones[1] is None
    assert tones[0] == "text"
    assert [row.get("class") for row in root.iter(SPACE + "tr")] == [None, None, "first"]


@pytest.mark.parametrize(
    "label",
    [
        "<script>alert(1)</script>",
        "</title><script>x</script>",
        "\" onerror='x' <b>",
        "a & b &amp; c",
        "]]><!--",
        "ñ 石 \U0001faa8",
    ],
)
def test_a_label_is_text_and_never_markup(label: str) -> None:
    page = full(label)
    root = parsed(page)
    assert texts(root, "h1") == [f"Two populations: {label}"]
    assert texts(root, "th")[1] == label
    assert next(root.iter(SPACE + "img")).get("alt") == label
    assert not list(root.iter(SPACE + "script"))
    assert b"<script" not in page.to_bytes()


@settings(deadline=None, max_examples=40)
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=30))
def test_any_text_leaves_the_page_whole(label: str) -> None:
    page = full(label)
    root = parsed(page)
    assert len(texts(root, "td")) == 8
    # Line ends are one and the same to XML; what it cannot hold at all is shown as a replacement.
    bad = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
    shown = bad.sub("\ufffd", label).replace("\r\n", "\n").replace("\r", "\n")
    assert texts(root, "li")[0] == shown


def test_nothing_is_loaded_from_outside() -> None:
    class Reader(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.links: list[str] = []
            self.tags: set[str] = set()

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.tags.add(tag)
            self.links += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]

    reader = Reader()
    text = full().to_bytes().decode()
    reader.feed(text)
    assert reader.links
    assert all(link.startswith("data:image/png;base64,") for link in reader.links)
    assert not reader.tags & {"script", "link", "iframe", "object", "embed", "base", "form"}
    assert not re.search(r"url\(|@import|javascript:", text)
    # The name of the XML vocabulary is the only address, and nothing follows it.
    assert re.findall(r"https?://[^\"]*", text) == ["http://www.w3.org/1999/xhtml"]
    assert "default-src 'none'; img-src data:" in text.replace("&#x27;", "'")


def test_it_has_two_schemes_and_a_form_for_paper() -> None:
    text = full().to_bytes().decode()
    assert "prefers-color-scheme: dark" in text
    assert "@media print" in text
    light, dark, printed = (set(re.findall(r"--(\w+):", part)) for part in re.split("@media", text)[:3])
    assert light == dark == printed


def test_long_names_can_be_broken() -> None:
    text = full("x" * 300).to_bytes().decode()
    assert re.search(r"\.text \{[^}]*max-width: \d+rem; overflow-wrap: break-word", text)
    # Numbers stay on a line; what a caller may have written long does not have to.
    assert re.findall(r"([^\n{}]*?) \{[^}]*nowrap", text) == ["td:not(.text)"]
    page = Page("x")
    page.add(Table(("name",), (("maximum_projection_sphericity",),)))
    assert texts(parsed(page), "td") == ["maximum_projection_sphericity"]
    assert page.to_bytes().count(b"<wbr />") == 2


def test_the_same_blocks_give_the_same_bytes() -> None:
    assert full().to_bytes() == full().to_bytes()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (Table(("a", "b"), (("1",),)), r"expected rows of 2 cells.*got one of 1"),
        (Table(("a",), ((Cell("1", "red"),),)), r"expected a tone of plain, .*got 'red'"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(table: Table, message: str) -> None:
    with pytest.raises(LithoformError, match=message):
        Page("x").add(table)
