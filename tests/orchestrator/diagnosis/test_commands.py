"""What the commands of the diagnosis print."""

from __future__ import annotations

from cobot_joint.diagnosis import commands


def test_figures_that_a_repair_is_judged_by_are_printed_beside_those_of_free_runs() -> None:
    """99.9 % were said to be removed above a table in which the error grew."""
    free = {"noise": 0.02, "nominal": 0.55, "calibrated": 0.4, "repaired": 0.67}
    predicted = {"horizon": 0.2, "nominal": 0.16, "calibrated": 0.15, "repaired": 0.031}
    for channel, there in (({**free, "predicted": predicted}, True), ({**free, "predicted": None}, False)):
        with commands.console.capture() as shown:
            commands._print_figures("held-out runs", {"w": channel}, {"w": "rad/s"})
        assert "0.67" in shown.get()
        assert ("predictions over 0.2 s, held-out runs" in shown.get()) == there
        assert ("0.031" in shown.get()) == there
