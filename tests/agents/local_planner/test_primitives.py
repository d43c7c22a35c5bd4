"""Options are tried from the cheapest on."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from are_ros.agents.local_planner.primitives import cheapest

_COSTS = st.sampled_from([0.0, -1.5, 0.25, 0.25, 2.0, np.inf]) | st.floats(-2.0, 3.0)


@given(st.lists(_COSTS, max_size=40), st.integers(0, 5))
def test_the_first_of_the_cheapest_is_tried_first(costs: list[float], more: int) -> None:
    """Of equal ones the first; none once all are spent, and none of those that do not count."""
    options = np.full((len(costs) + more, 5), -9.0)
    options[: len(costs), 3] = costs
    least = min(costs, default=np.inf)
    expected = costs.index(least) if least < np.inf else -1
    assert cheapest(options, len(costs)) == expected
