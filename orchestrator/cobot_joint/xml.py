"""XML from files that others wrote: no entities, no network, no document type."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import fmpy
from lxml import etree

from cobot_joint.errors import UserError

_PARSER = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)


def parse(text: bytes, where: str, schema: str | None = None) -> etree._Element:
    """The root element, held against the one of FMPy's SSP schemas that is named. UserError: not XML, or not valid."""
    try:
        root = etree.fromstring(text, _PARSER)
    except etree.XMLSyntaxError as error:
        raise UserError(f"{where}: not XML: {error.msg}") from error
    if root.getroottree().docinfo.doctype:
        raise UserError(f"{where}: a document type (DOCTYPE) is given, plain XML is allowed")
    if schema and not _schema(schema).validate(root):
        finding = _schema(schema).error_log[0]
        raise UserError(f"{where}: line {finding.line}: {finding.message}")
    return root


@cache
def _schema(name: str) -> etree.XMLSchema:
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "ssp" / "schema" / f"{name}.xsd"))
