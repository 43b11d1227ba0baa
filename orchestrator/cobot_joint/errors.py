"""Errors in a call or a file, in one line. The command line prints it and exits with 2."""


class UserError(ValueError):
    """A call or a file is wrong: what was given, what is allowed, where."""


def among(names: object, most: int = 12) -> str:
    """`a, b, c` for the end of an error message; long lists are cut with the number of what is left out."""
    listed = [str(name) for name in names]  # type: ignore[attr-defined]
    if len(listed) <= most:
        return ", ".join(listed) or "none"
    return f"{', '.join(listed[:most])} and {len(listed) - most} more"


def printable(text: str) -> str:
    """Control characters but for line breaks and tabs as their escapes: names from files may hold any."""
    return "".join(c if c.isprintable() or c in "\n\t" else ascii(c)[1:-1] for c in text)
