"""XML of untrusted files: no document type, no entities, UTF-8 only.

Entities can expand a small file to gigabytes or read other files. Files of VTK and ParaView need none, so any
declaration is refused before the text reaches the parser.
"""

import re
from pathlib import Path
from xml.etree import ElementTree

from ..faults import fault

_DECLARATION = re.compile(r"^\ufeff?\s*<\?xml[^>]*\?>")


def parsed(path: Path, body: bytes, root: str = "VTKFile") -> ElementTree.Element:
    """The root element of an XML text. Raises ValueError if it declares entities, is damaged or has another root."""
    try:
        text = body.decode("utf-8")
    except UnicodeDecodeError as error:
        raise fault(path, f"the XML text must be UTF-8; byte {error.start} is not") from error
    if "<!DOCTYPE" in text.upper() or "<!ENTITY" in text.upper():
        raise fault(path, "a file of VTK has no document type and no entities; got a <!DOCTYPE or <!ENTITY. Remove it")
    try:
        element = ElementTree.fromstring(_DECLARATION.sub("", text))
    except ElementTree.ParseError as error:
        raise fault(path, f"the XML must be complete and valid; {error}. The file may be cut off or damaged") from None
    if element.tag != root:
        raise fault(path, f"the XML must have the root <{root}>; got <{element.tag[:40]}>")
    return element
