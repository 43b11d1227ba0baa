"""The page of the diagnosis's reliability: what it states against what was counted."""

from __future__ import annotations

from pathlib import Path

from cobot_joint.diagnosis.evaluation.score import rate
from cobot_joint.diagnosis.selection.confidence import COUNTED
from figures import proof, svg


def page(root: Path) -> str:
    """Markdown."""
    _, score = proof.read(root / "proof" / "sealed")
    drawn = [counted()]
    if score:
        drawn.append(proof.outcomes("sealed", "Sealed campaigns", score["rows"]))
    return "\n".join(
        [
            "---\nhide: [toc]\n---\n",
            "# The diagnosis's confidence in figures\n",
            "A finding states how likely it is to be true. Here its confidence is held against what was true: in drawn "
            "campaigns with known answers ([how they were counted](../diagnosis-calibration.md)), and in the sealed "
            "campaigns that [someone else concealed](proof.md#sealed). Where a dot's interval reaches the grey band, "
            "the counts do not contradict the confidence.\n",
            f'<div class="results">{"".join(drawn)}</div>\n',
            table(),
        ]
    )


def counted() -> str:
    """The counts that a report quotes beside its confidences."""
    found = [svg.Share(low, min(high, 1.0), n, k) for (low, high), n, k in COUNTED]
    return svg.shares("counted", "Drawn campaigns", found, f"{sum(s.n for s in found)} findings.")


def table() -> str:
    """The counts of the drawn campaigns."""
    head = ("confidence stated", "findings", "true", "share that is true, 95 %")
    rows = []
    for (low, high), n, k in COUNTED:
        interval = "{:.2f} to {:.2f}".format(*rate(k, n)["ci95"]) if n else "-"
        rows.append((f"{low:g} to {min(high, 1):g}", n, k, interval))
    body = "\n".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    titles = "".join(f'<th scope="col">{title}</th>' for title in head)
    head_row = f"<caption>Drawn campaigns</caption><thead><tr>{titles}</tr></thead>"
    return f'<table class="counts">{head_row}\n<tbody>{body}</tbody></table>\n'
