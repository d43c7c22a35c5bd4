"""Fixtures of the tests of the whole node, over real DDS."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.ros import RosWorld, running_ns

MakeBench = Callable[..., Any]
_DISCOVERY_S = 20.0
"""Participants announce themselves five times in half a second, then every three seconds."""


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

    def warm(catalogue: Any, needs: Any, is_wanted: Callable[[], bool], **_: Any) -> bool:
        nonlocal is_warm
        is_warm = is_warm or warm_up(catalogue, needs, is_wanted)
        return is_warm

    return warm


@pytest.fixture
def make_bench(
    warm_once: Callable[..., bool],
    catalogue_file: Path,
    running_clock: None,  # noqa: ARG001 - it comes first
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    record_property: Callable[[str, object], None],
) -> Iterator[MakeBench]:
    """Return what makes a node and a user of it: parameters by path, and the state to begin in."""
    from tests.node.live_bench import Bench, UndiscoveredError
    from tests.node.live_scene import QUIET

    monkeypatch.setattr("are_ros.node.ar_builder_node.warm_up", warm_once)
    with ExitStack() as stack:

        def begin(kinds: tuple[bool, bool], values: Mapping[str, Any], **options: Any) -> Bench:
            with ExitStack() as own:
                node_world, user_world = (
                    own.enter_context(closing(RosWorld(use_events_executor=kind))) for kind in kinds
                )
                said = partial(_read_log, capfd)
                bench = Bench(node_world, user_world, values, said, **options)
                stack.push(own.pop_all())
            return bench

        def make(
            values: Mapping[str, Any] | None = None,
            *transitions: str,
            use_events_executor: bool = False,
            arguments: tuple[str, ...] = (),
        ) -> Bench:
            own = {**QUIET, "catalogue": str(catalogue_file), "use_sim_time": True}
            kinds, wanted = (use_events_executor, False), {**own, **(values or {})}
            # Once in thousands of times Fast DDS never completes the discovery between two
            # participants of one process, however long one waits: on a second pair it does. No
            # test has begun by then, and none is of how fast participants find each other.
            try:
                bench = begin(kinds, wanted, arguments=arguments, discovery_s=_DISCOVERY_S)
            except UndiscoveredError as cause:
                record_property("discovery", f"begun again after {_DISCOVERY_S} s: {cause}")
                capfd.readouterr()
                bench = begin(kinds, wanted, arguments=arguments)
            if transitions:
                assert bench.change_state(*transitions)
            return bench

        yield make


@pytest.fixture
def without_packages(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Return what makes packages of messages look as if they were not installed."""
    message_classes = pytest.importorskip("are_ros.node.message_classes")

    def hide(*packages: str) -> None:
        def importing(name: str) -> ModuleType:
            if name.partition(".")[0] in packages:
                raise ModuleNotFoundError(name)
            return import_module(name)

        monkeypatch.setattr(message_classes, "import_module", importing)
        message_classes._class.cache_clear()

    yield hide
    message_classes._class.cache_clear()


@pytest.fixture
def running_clock(ros_available: None, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    """Let the node's ages of things (an input that stopped, what was refused) not count stalls."""
    for module in ("ar_builder_node", "topics", "live_builder"):
        monkeypatch.setattr(f"are_ros.node.{module}.monotonic_ns", running_ns)


def _read_log(capfd: pytest.CaptureFixture[str]) -> str:
    return str(capfd.readouterr().err)
