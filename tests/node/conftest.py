"""Fixtures of the tests of the whole node, over real DDS."""

import gc
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from tests.ros import RosWorld

MakeBench = Callable[..., Any]


@pytest.fixture(scope="session")
def catalogue_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a catalogue of three boxes."""
    from tests.node.live_scene import write_catalogue

    return write_catalogue(tmp_path_factory.mktemp("catalogue"))


@pytest.fixture(scope="session")
def warm_once(ros_available: None) -> Callable[..., bool]:  # noqa: ARG001 - it skips
    """Return what compiles the kernels at its first call, and does nothing at later ones.

    That is all that `warm_up` is for, and kernels stay compiled for as long as a process lives.
    """
    from are_ros.builder.warm_up import warm_up

    is_warm = False

    def warm(catalogue: Any, is_wanted: Callable[[], bool]) -> bool:
        nonlocal is_warm
        is_warm = is_warm or warm_up(catalogue, is_wanted)
        return is_warm

    return warm


@pytest.fixture
def make_bench(
    warm_once: Callable[..., bool],
    catalogue_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> Iterator[MakeBench]:
    """Return what makes a node and a user of it: parameters by path, and the state to begin in."""
    from tests.node.live_bench import Bench
    from tests.node.live_scene import QUIET

    monkeypatch.setattr("are_ros.node.ar_builder_node.warm_up", warm_once)
    with ExitStack() as stack:

        def make(
            values: Mapping[str, Any] | None = None,
            *transitions: str,
            use_events_executor: bool = False,
            arguments: tuple[str, ...] = (),
        ) -> Bench:
            worlds = [
                stack.enter_context(closing(RosWorld(use_events_executor=kind)))
                for kind in (use_events_executor, False)
            ]
            own = {**QUIET, "catalogue": str(catalogue_file), "use_sim_time": True}
            values = {**own, **(values or {})}
            bench = Bench(worlds[0], worlds[1], values, lambda: capfd.readouterr().err, arguments)
            if transitions:
                assert bench.change_state(*transitions)
            return bench

        yield make
    gc.collect()  # a lifecycle node is known to DDS until it is collected
