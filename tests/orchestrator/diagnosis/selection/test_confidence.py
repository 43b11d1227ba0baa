"""How sure a finding is, by what it takes and leaves."""

from __future__ import annotations

import pytest

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.selection.confidence import MOST, beside_background


def test_beside_a_background_three_quarters_make_a_listed_term_a_claim_and_four_fifths_an_unlisted_form() -> None:
    assert beside_background(0.74) < thresholds.EVEN < beside_background(0.76)
    assert beside_background(0.80, unlisted=True) < thresholds.EVEN < beside_background(0.83, unlisted=True)


def test_a_term_that_takes_nine_tenths_is_as_sure_as_was_counted_and_one_that_takes_half_stays_a_hint() -> None:
    """Of findings of which 0.5 to 0.9 was said 53 of 55 were true; short of even odds nothing was changed."""
    assert beside_background(0.9) == MOST
    assert beside_background(0.8) == pytest.approx(0.77, abs=0.02)
    assert beside_background(0.5) == pytest.approx(0.18, abs=0.01)


def test_more_taken_is_never_less_sure() -> None:
    given = [beside_background(share / 100) for share in range(101)]
    assert given == sorted(given)
