"""URDF files as text and as elements: read as tolerantly as the parsers of other tools do.

A URDF is made by many hands, and most of it is of no concern here. What XML forbids and the usual
parsers pass over is passed over: prefixes without a declaration, ``--`` in a comment, a bare
``&``, characters outside the encoding.
"""

import codecs
import re
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from annik_core.robots.errors import InvalidRobotDefinition

#: Most characters of a URDF; a description is some 100 kB with all its links.
MAX_LENGTH = 16 * 1024 * 1024
#: May begin a text.
BYTE_ORDER_MARK = "\ufeff"
#: Stands for bytes that are not of the file's encoding.
UNDECODED = "\ufffd"
#: How to turn xacro into a URDF.
EXPAND_XACRO = "it is xacro, which has to be expanded: xacro FILE > robot.urdf"

#: Elements of xacro that make nothing by themselves, and old ones, without a prefix, that do.
_DEFINITIONS = frozenset({"xacro:property", "xacro:arg", "xacro:macro"})
_OLD_XACRO = frozenset({"include", "if", "unless", "insert_block"})
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_DECLARED_ENCODING = re.compile(rb"\s*<\?xml[^>]*?encoding\s*=\s*[\"']([\w.:-]+)")
#: Python's codecs for other things than files, some of them very slow.
_NO_FILE_ENCODINGS = frozenset({"idna", "punycode", "raw-unicode-escape", "unicode-escape"})
#: Where to look for the end of what begins like this.
_ENDS = {"<!--": "-->", "<?": "?>", "<![CDATA[": "]]>"}
_BEGIN = re.compile("|".join(map(re.escape, _ENDS)))
_BARE_AMPERSAND = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[\da-fA-F]+);)")


def decoded(content: bytes) -> str:
    """The text of a file: by its byte-order mark, its XML declaration, or else UTF-8.

    Bytes that are not of that encoding become :data:`UNDECODED`.
    """
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            return content[len(mark) :].decode(encoding, "replace")
    # Without a mark the zero bytes around the first characters tell.
    zeros = tuple(byte == 0 for byte in content[:4])
    if zeros[:2] in ((True, False), (False, True)):
        width = "32" if zeros[2:] == (True, True) else "16"
        return content.decode(f"utf-{width}-{'be' if zeros[0] else 'le'}", "replace")
    if zeros[:2] == (True, True):
        return content.decode("utf-32-be", "replace")
    declared = _DECLARED_ENCODING.match(content)
    encoding = declared[1].decode() if declared else "utf-8"
    try:
        name = codecs.lookup(encoding).name
        if name not in _NO_FILE_ENCODINGS and b"<robot".decode(name) == "<robot":
            return content.decode(name, "replace")
    except (LookupError, UnicodeError):
        pass
    return content.decode("utf-8", "replace")


def parsed(text: str, source: str) -> ElementTree.Element:
    """The element ``<robot>`` of a URDF. Prefixes stay in the names, xacro's as ``xacro:``.

    Raises:
        InvalidRobotDefinition: if it is not XML, is too long, declares entities, or is no URDF.
    """
    if len(text) > MAX_LENGTH:
        raise InvalidRobotDefinition(
            source, f"{len(text)} characters are more than the {MAX_LENGTH} of the longest URDF"
        )
    root = _elements(text, source)
    xacro = {"xacro:"} | {
        f"{key.removeprefix('xmlns:')}:"
        for key, value in root.attrib.items()
        if key.startswith("xmlns:") and "xacro" in value
    }
    if root.tag.startswith(tuple(xacro)):
        raise InvalidRobotDefinition(source, EXPAND_XACRO)
    usual = root.tag[: root.tag.rfind(":") + 1]
    for element in root.iter():
        prefix = element.tag[: element.tag.rfind(":") + 1]
        if prefix in xacro:
            element.tag = f"xacro:{element.tag[len(prefix) :]}"
        elif prefix == usual:
            element.tag = element.tag[len(prefix) :]
    if root.tag != "robot":
        raise InvalidRobotDefinition(
            source, f"not a URDF: its outermost element is <{root.tag}>, not <robot>"
        )
    return root


def _elements(text: str, source: str) -> ElementTree.Element:
    builder = ElementTree.TreeBuilder()
    # One that knows of no namespaces needs no declarations of them.
    reader = expat.ParserCreate("utf-8")
    reader.buffer_text = True
    reader.StartElementHandler = builder.start
    reader.EndElementHandler = builder.end
    reader.CharacterDataHandler = builder.data

    def refuse_entity(*_: Any) -> None:
        # Nested ones expand without bound.
        raise InvalidRobotDefinition(source, "the XML declares entities, which no URDF needs")

    reader.EntityDeclHandler = refuse_entity
    clean = _BARE_AMPERSAND.sub("&amp;", _without_comments(text.removeprefix(BYTE_ORDER_MARK)))
    try:
        # Some programs end a file with a zero.
        clean = clean.lstrip().rstrip(" \t\r\n\0")
        reader.Parse(clean.encode("utf-8", "surrogatepass"), True)
    except expat.ExpatError as error:
        raise InvalidRobotDefinition(source, f"not XML: {error}") from error
    return builder.close()


def _without_comments(text: str) -> str:
    """The text without comments and instructions, with its line breaks."""
    kept: list[str] = []
    done = 0
    while (begin := _BEGIN.search(text, done)) is not None:
        end = text.find(_ENDS[begin[0]], begin.end())
        if end < 0:
            break
        end += len(_ENDS[begin[0]])
        if begin[0] == "<![CDATA[":
            kept.append(text[done:end])
        else:
            kept += text[done : begin.start()], "\n" * text.count("\n", begin.start(), end)
        done = end
    return "".join(kept) + text[done:]


def is_to_be_expanded(element: ElementTree.Element) -> bool:
    """Whether xacro would make something of an element."""
    tag = element.tag
    return tag in _OLD_XACRO or (tag.startswith("xacro:") and tag not in _DEFINITIONS)


def has_substitution(text: str) -> bool:
    """Whether xacro would replace a part of a value."""
    return "${" in text or "$(" in text
