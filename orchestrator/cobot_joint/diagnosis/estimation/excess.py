"""What a residual has above noise, sample block by sample block: slow structure stays in it, white noise goes."""

from __future__ import annotations

from cobot_joint.diagnosis.estimation.problem import BLOCK, Problem, Vector


def excess(problem: Problem, residual: Vector) -> list[Vector]:
    """Per block of the problem: chi-square of means over `BLOCK` samples, less its expectation, (n // BLOCK,).

    residual: whitened, (rows,). 1 sigma of an element is sqrt(2) where only noise is left.
    """
    found = []
    for block in problem.blocks:
        n = (block.rows.stop - block.rows.start) // BLOCK * BLOCK
        sums = residual[block.rows][:n].reshape(-1, BLOCK).sum(axis=1)
        found.append(sums**2 / BLOCK - block.weight[:n].reshape(-1, BLOCK).mean(axis=1))
    return found
