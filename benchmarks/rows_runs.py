"""Rows on many runs and on long ones."""

from benchmarks.measure import Row, missing


def many() -> list[Row]:
    return [missing("1,000 varied runs on 2 cores / on 1", ">= 1.8 x", "no")]


def hour() -> list[Row]:
    return [missing("one hour", "flat", "no")]
