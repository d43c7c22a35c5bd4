"""Exact backward induction by a stencil, without a transition matrix, compiled."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.mdp.decision_kernels import (
    CHUNK,
    FAR,
    NEAR,
    Floats,
    Process,
    choose,
    move_far,
    move_near,
)

if TYPE_CHECKING:
    from are_ros.agents.mdp.model import Problem


def solved(
    problem: "Problem", kept: int, horizon: int
) -> tuple[Floats, npt.NDArray[np.int32], int]:
    """Return the values (kept, 4, h, w), as `induct` leaves them.

    And the last epoch that changed each cell, int32 (h, w), and the last epoch computed.
    """
    model, (_, height, width) = problem.model, problem.terminal.shape
    padding, size = max(*model.reaches, FAR) * width, 4 * height * width
    flat = np.empty(kept * size + 2 * padding, np.float32)
    planes = flat[padding : padding + kept * size].reshape(kept, 4, height, width)
    planes[0] = problem.terminal
    settled = np.zeros((height, width), np.int32)
    process = Process(
        flat,
        problem.lengths.reshape(-1).astype(np.int32),
        problem.gains.reshape(-1),
        width,
        np.array(model.reaches),
        np.array(model.effort, np.float32) + np.float32(model.rest),
        tuple(map(np.float32, model.chances)),
        (np.float32(model.quarter_turn), np.float32(model.half_turn)),
        settled.reshape(-1),
    )
    return planes, settled, induct(process, padding, kept, horizon)


@compiled
def induct(process: Process, padding: int, kept: int, horizon: int) -> int:
    """Fill V_1 .. V_horizon by backward induction, and return the last epoch computed.

    `flat` holds `padding` numbers that do not matter (so that looking as far as any move goes is
    allowed everywhere), `kept` times four planes of n = h * w cells, one per heading, and as much
    again; epoch h is in place h % kept, V_0 is given. Ends early when nothing has changed: so it
    would go on.
    """
    cells = process.settled.shape[0]
    scratch = np.empty(8 * CHUNK, np.float32)
    for epoch in range(1, horizon + 1):
        old = np.uint64(padding + (epoch - 1) % kept * 4 * cells)
        new, last = np.uint64(padding + epoch % kept * 4 * cells), 0
        for start in range(0, cells, CHUNK):
            part = old, np.uint64(start), np.uint64(min(CHUNK, cells - start))
            for pace in range(process.reaches.shape[0]):
                if process.reaches[pace] <= NEAR:
                    move_near(process, part, pace, scratch)
                else:
                    move_far(process, part, pace, scratch)
            last = max(last, int(choose(process, part, new, np.int32(epoch), scratch)))
        if last < epoch:
            return epoch
    return horizon
