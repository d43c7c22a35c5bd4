"""The parameters of the core as ROS parameters, over the real parameter services."""

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.ros import NOT_SET_UP, RosWorld

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from rcl_interfaces import srv
from rclpy.parameter import Parameter, parameter_value_to_python

from are_ros.errors import CatalogueError, ParameterError
from are_ros.node.parameters import ParameterBridge
from are_ros.parameters.choices import Departures
from are_ros.parameters.declaration import (
    Description,
    NodeParameters,
    describe,
    flatten,
    plain,
    value_at,
)
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import assignments_for_ros, parameter_file_for_ros

ITEMS = describe(Parameters())
Bridged = Callable[..., "Bench"]


class Bench:
    """A node with a bridge, what the bridge reported, and a second node that calls its services."""

    def __init__(self, ros: RosWorld, **options: Any) -> None:
        self.ros = ros
        self.is_fixed = False
        self.checked: list[Parameters] = []
        self.changes: list[Parameters] = []
        self.objection = ""
        self.node = ros.make_node("ar_builder", **options)
        self.bridge = ParameterBridge(
            self.node, lambda: self.is_fixed, self._check, self.changes.append
        )
        self._caller = ros.make_node("caller")

    def _check(self, candidate: Parameters) -> None:
        self.checked.append(candidate)
        if self.objection:
            raise CatalogueError(self.objection)

    def set_each(self, *parameters: Parameter) -> list[str]:
        """Set one by one, and return the reasons of refusals, "" where there was none."""
        return [reason_of(one) for one in self._set(srv.SetParameters, *parameters).results]

    def set_together(self, *parameters: Parameter) -> str:
        """Set all or none, and return the reason of the refusal."""
        return reason_of(self._set(srv.SetParametersAtomically, *parameters).result)

    def get(self, *names: str) -> list[Any]:
        """Return the values that the service tells."""
        response = self.call(srv.GetParameters, names=list(names))
        return [parameter_value_to_python(value) for value in response.values]

    def describe(self, *names: str) -> list[Any]:
        """Return the descriptors that the service tells."""
        return list(self.call(srv.DescribeParameters, names=list(names)).descriptors)

    def call(self, kind: type[Any], **fields: Any) -> Any:
        """Call one of the node's parameter services; its name is that of its type."""
        words = "".join(f"_{c.lower()}" if c.isupper() else c for c in kind.__name__)
        service = f"/ar_builder/{words.lstrip('_')}"
        return self.ros.call(self._caller, kind, service, kind.Request(**fields))

    def _set(self, kind: type[Any], *parameters: Parameter) -> Any:
        return self.call(kind, parameters=[one.to_parameter_msg() for one in parameters])


def reason_of(result: Any) -> str:
    """Return why a set was refused, "" if it was not; a refusal has a reason."""
    assert result.successful != bool(result.reason)
    return str(result.reason)


@pytest.fixture
def bench(ros: RosWorld) -> Iterator[Bench]:
    """Return a node with defaults, and check in the end that ROS and the bridge agree."""
    made = Bench(ros)
    yield made
    agree(made)


@pytest.fixture
def bridged(ros: RosWorld) -> Bridged:
    """Return what makes a node with values of its own."""
    return lambda **options: Bench(ros, **options)


def agree(bench: Bench) -> None:
    """Check that every value in ROS is the one in force, of its type, which is described so."""
    descriptors = bench.describe(*(item.path for item in ITEMS))
    values = bench.get(*(item.path for item in ITEMS))
    for item, found, shown in zip(ITEMS, values, descriptors, strict=True):
        wanted = plain(value_at(bench.bridge.values, item.path))
        assert found == (list(wanted) if isinstance(wanted, tuple) else wanted), item.path
        assert type(found) is (list if isinstance(wanted, tuple) else type(wanted)), item.path
        assert shown.type == bench.node.get_parameter(item.path).type_.value, item.path


def params_file(tmp_path: Path, text: str) -> list[str]:
    """Return the arguments that give a node a file with these parameters."""
    path = tmp_path / "parameters.yaml"
    path.write_text(f"ar_builder:\n  ros__parameters:\n{text}", encoding="utf-8")
    return ["--params-file", str(path)]


# ------------------------------------------------------------------------------------- declared


def test_all_are_declared_with_their_defaults(bench: Bench) -> None:
    """And no others but those of rclpy."""
    names = set(bench.call(srv.ListParameters).result.names)
    expected = {item.path for item in ITEMS} | {"autostart"}
    assert expected <= names
    assert names - expected == {"use_sim_time", "start_type_description_service"}
    assert bench.bridge.values == Parameters()
    assert bench.bridge.node_values == NodeParameters()
    assert bench.changes == []


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.path)
def test_descriptors_say_what_the_declaration_says(item: Description, described: Any) -> None:
    """Meaning, unit, bounds, choices, and when it takes effect."""
    shown = described[item.path]
    assert shown.name == item.path
    assert shown.description.startswith(item.text)
    assert item.unit in shown.description
    assert all(choice in shown.additional_constraints for choice in item.choices)
    assert ("takes effect at configure" in shown.additional_constraints) != item.live
    assert not shown.read_only
    assert not shown.dynamic_typing
    ranges = [*shown.floating_point_range, *shown.integer_range]
    is_number = isinstance(item.default, (int, float)) and not isinstance(item.default, bool)
    bounds = [(item.low, item.high)] if is_number and item.low is not None else []
    assert [(one.from_value, one.to_value) for one in ranges] == bounds


@pytest.fixture(scope="module")
def described(ros_available: None) -> dict[str, Any]:  # noqa: ARG001 - it skips where there is none
    """Return all descriptors, asked for once."""
    world = RosWorld()
    bench = Bench(world)
    shown = {one.name: one for one in bench.describe(*(item.path for item in ITEMS))}
    world.close()
    return shown


def test_list_describes_sections(bench: Bench) -> None:
    """As `ros2 param list` shows them."""
    found = bench.call(srv.ListParameters, prefixes=["mixture"]).result.names
    assert sorted(found) == ["mixture.rates", "mixture.weights"]


# ------------------------------------------------------------------------------------ overrides


def test_the_shipped_file_is_taken(bridged: Bridged) -> None:
    """With its empty lists, for which ROS has no type."""
    shipped = Path(__file__).resolve().parents[2] / "config" / "are.yaml"
    bench = bridged(arguments=["--params-file", str(shipped)])
    assert flatten(bench.bridge.values) == flatten(Parameters())
    agree(bench)


def test_values_of_a_file_are_taken(bridged: Bridged, tmp_path: Path) -> None:
    """Whole numbers for others, lists, choices, what is left of a list, the node's own."""
    text = (
        "    autostart: false\n    use_sim_time: true\n"
        "    qos_overrides:\n      /map: {subscription: {depth: 3}}\n"
        "    population: {mean_life: 60, departures: constant_rate}\n"
        "    camera.mount: [0, 0, 1, 0, 0, 0]\n    sensors.scans: []\n    frames.map: /world\n"
    )
    bench = bridged(arguments=params_file(tmp_path, text))
    values = bench.bridge.values
    assert values.population.mean_life == 60.0
    assert values.population.departures is Departures.CONSTANT_RATE
    assert values.camera.mount == (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    assert values.sensors.scans == ()
    assert values.frames.map == "world"
    assert not bench.bridge.node_values.autostart
    assert bench.get("autostart", "use_sim_time") == [False, True]
    agree(bench)


def test_the_command_line_goes_before_the_file(bridged: Bridged, tmp_path: Path) -> None:
    """As everywhere in ROS."""
    arguments = [*params_file(tmp_path, "    seed: 1\n    robot.radius: 1\n"), "-p", "seed:=7"]
    values = bridged(arguments=arguments).bridge.values
    assert (values.seed, values.robot.radius) == (7, 1.0)


def test_of_values_of_several_types_the_last_one_counts(bridged: Bridged, tmp_path: Path) -> None:
    """Of files and single values, as `are node` gives them: rcl itself would keep the first."""
    (first, second), text = (tmp_path / "a.yaml", tmp_path / "b.yaml"), "{{ros__parameters: {}}}"
    values = "{population: {mean_life: 30}, robot.radius: 1, camera.other_rates: [1], seed: 3}"
    first.write_text(f"/**: {text.format(values)}", encoding="utf-8")
    second.write_text(f"/**: {text.format('{robot: {radius: 0.5}}')}", encoding="utf-8")
    files = ["--params-file", str(tmp_path / "files.yaml")]
    (tmp_path / "files.yaml").write_text(parameter_file_for_ros([first, second]), encoding="utf-8")
    last = ["--params-file", str(tmp_path / "last.yaml")]
    given = assignments_for_ros(["population.mean_life:=12.5", "camera.other_rates:=[0.5, 1]"])
    (tmp_path / "last.yaml").write_text(given, encoding="utf-8")
    others = ["-p", 'camera.others:=["/rear", "/side"]', "-p", "seed:=4"]
    found = bridged(arguments=[*files, *others, *last]).bridge.values
    assert (found.population.mean_life, found.robot.radius) == (12.5, 0.5)
    assert (found.camera.other_rates, found.seed) == ((0.5, 1.0), 4)
    found = bridged(arguments=[*files, "-p", "population.mean_life:=12.5"]).bridge.values
    assert found.population.mean_life == 12.5


WRONG = [
    ("population.mean_lief: 60", "no such parameter; did you mean 'population.mean_life'?"),
    ("population.lief: 60", "parameter 'population.lief': there is no such parameter"),
    ("nonsense: {of: {mine: 3}}", "parameter 'nonsense.of.mine': there is no such parameter"),
    ("population.mean_life: long", "parameter 'population.mean_life': 'long' is not a number"),
    ("population.mean_life: -1", "parameter 'population.mean_life': -1.0 is below 0.001 s"),
    ("population.mean_life: .nan", "parameter 'population.mean_life': nan is not finite"),
    ("population.mean_life: .inf", "parameter 'population.mean_life': inf is not finite"),
    ("population.mean_life: {}", "parameter 'population.mean_life': it is given no value"),
    ("seed: 1.5", "parameter 'seed': 1.5 is not a whole number"),
    ("seed: true", "parameter 'seed': True is not a whole number"),
    ("seed: 9223372036854775808", "parameter 'seed': 9.223372036854776e+18 is not a whole number"),
    ("occlusion.mutual: 1", "parameter 'occlusion.mutual': 1 is not true or false"),
    ("catalogue: 3", "parameter 'catalogue': 3 is not a string"),
    ("sensors.scans: scan", "parameter 'sensors.scans': 'scan' is not a list"),
    ("sensors.scans: [1, 2]", "parameter 'sensors.scans': 1 is not a string"),
    ("mixture.rates: [a]", "parameter 'mixture.rates': 'a' is not a number"),
    ("population.mean_life: [0.5]", "parameter 'population.mean_life': [0.5] is not a number"),
    ("costmap.gate: some", "parameter 'costmap.gate': 'some' is none of perceived, all"),
    ("mixture.weights: [1.0]", "1 weight and 5 rates"),
    ("mixture.weights: []", "0 weights and 5 rates"),
    ("world.free_threshold: 90", "parameter 'world.free_threshold': 90 is not below"),
    ("autostart: 1", "parameter 'autostart': 1 is not true or false"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "sentence"), WRONG, ids=[line for line, _ in WRONG])
def test_a_wrong_value_at_the_start_is_an_error(
    bridged: Bridged, tmp_path: Path, line: str, sentence: str
) -> None:
    """It names the parameter and the reason."""
    with pytest.raises(ParameterError) as caught:
        bridged(arguments=params_file(tmp_path, f"    {line}\n"))
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------- while it runs


def test_a_live_parameter_changes_while_fixed(bench: Bench) -> None:
    """Each accepted call is reported once."""
    bench.is_fixed = True
    rate = Parameter("population.arrival_rate", value=0.25)
    assert bench.set_each(rate) == [""]
    assert bench.bridge.values.population.arrival_rate == 0.25
    assert bench.changes == [bench.bridge.values]
    assert bench.checked == [bench.bridge.values]


def test_several_in_one_call_are_one_change(bench: Bench) -> None:
    """Weights and rates of another number can only change together."""
    weights = Parameter("mixture.weights", value=[0.5, 0.5])
    rates = Parameter("mixture.rates", value=[1, 2])
    assert "2 weights and 5 rates" in bench.set_together(weights)
    assert bench.set_together(weights, rates) == ""
    assert bench.bridge.values.mixture.rates == (1.0, 2.0)
    assert bench.changes == [bench.bridge.values]


def test_one_by_one_each_is_a_change(bench: Bench) -> None:
    """The service set_parameters goes on after one that is refused."""
    reasons = bench.set_each(
        Parameter("robot.clearance", value=1.0),
        Parameter("occlusion.tau", value=-1),
        Parameter("costmap.memory", value=3),
    )
    assert reasons == ["", "parameter 'occlusion.tau': -1 is below 0 px", ""]
    assert [one.costmap.memory for one in bench.changes] == [0.0, 3.0]
    assert bench.bridge.values.occlusion.tau == Parameters().occlusion.tau


REFUSED = [
    (Parameter("population.mean_life", value=[0.5]), "mean_life': [0.5] is not a number"),
    (Parameter("population.mean_life", value="long"), "mean_life': 'long' is not a number"),
    (Parameter("population.mean_life", value=float("nan")), "nan is not finite"),
    (Parameter("population.mean_life", value=float("inf")), "inf is not finite"),
    (Parameter("population.mean_life", value=0.0), "0.0 is below 0.001 s"),
    (Parameter("population.mean_life", value=1e7 + 1), "10000001.0 is above 10000000.0 s"),
    (Parameter("population.mean_life", value=True), "True is not a number"),
    (Parameter("population.mean_life", Parameter.Type.NOT_SET), "it cannot be deleted"),
    (Parameter("population.max_alive", value=3.0), "3.0 is not a whole number"),
    (Parameter("population.max_alive", value=False), "False is not a whole number"),
    (Parameter("population.max_alive", value=100_001), "100001 is above 100000"),
    (Parameter("occlusion.shape", value="ball"), "'ball' is none of mesh, box"),
    (Parameter("occlusion.mutual", value="on"), "'on' is not true or false"),
    (Parameter("mixture.weights", value=["a"]), "'a' is not a number"),
    (Parameter("mixture.weights", value=[b"a"]), "b'a' is not a number"),
    (Parameter("mixture.weights", value=0.5), "0.5 is not a list"),
    (Parameter("mixture.weights", value=[0.2] * 4 + [0.3]), "they sum to 1.1, not to 1"),
    (Parameter("populaton.mean_life", value=1.0), "did you mean 'population.mean_life'?"),
    (Parameter("nonsense", value=1.0), "parameter 'nonsense': there is no such parameter"),
    (Parameter("autostart", value=False), "parameter 'autostart': it is read at the start only"),
]  # fmt: skip


@pytest.mark.parametrize(("wrong", "sentence"), REFUSED, ids=[str(i) for i in range(len(REFUSED))])
def test_a_wrong_value_leaves_everything_as_it_was(
    bench: Bench, wrong: Parameter, sentence: str
) -> None:
    """Also what was right in the same call, before it or after it; `bench` compares types too."""
    right = Parameter("population.max_alive", value=5)
    calls = [(wrong,), *([(right, wrong), (wrong, right)] if wrong.name != right.name else [])]
    for call in calls:
        assert sentence in bench.set_together(*call)
    (reason,) = bench.set_each(wrong)
    assert sentence in reason
    assert bench.bridge.values == Parameters()
    assert bench.changes == []


def test_what_runs_may_object(bench: Bench) -> None:
    """With any error of the family; its sentence is the reason."""
    bench.objection = "catalogue 'x.yaml': it is empty"
    assert bench.set_each(Parameter("catalogue", value="x.yaml")) == [bench.objection]
    assert bench.changes == []
    bench.objection = ""
    assert bench.set_each(Parameter("catalogue", value="x.yaml")) == [""]
    assert bench.bridge.values.catalogue == "x.yaml"


def test_what_takes_effect_at_configure_is_refused_when_fixed(bench: Bench) -> None:
    """With the way to change it; the value it has is accepted."""
    bench.is_fixed = True
    for item in ITEMS:
        default = list(item.default) if isinstance(item.default, tuple) else item.default
        same = Parameter(item.path, bench.node.get_parameter(item.path).type_, default)
        assert bench.set_each(same) == [""]
    (reason,) = bench.set_each(Parameter("seed", value=7))
    assert reason == (
        "parameter 'seed': it takes effect at configure; clean up the node first (if it is"
        " active: ros2 lifecycle set /ar_builder deactivate; then the same with cleanup)"
    )
    assert bench.bridge.values == Parameters()
    bench.is_fixed = False
    assert bench.set_each(Parameter("seed", value=7)) == [""]
    assert bench.bridge.values.seed == 7


@pytest.mark.parametrize("kind", ["BOOL_ARRAY", "STRING_ARRAY", "DOUBLE_ARRAY", "BYTE_ARRAY"])
def test_an_empty_list_has_no_type(bench: Bench, kind: str) -> None:
    """`ros2 param set` sends one of bools; it becomes one of strings, or of numbers."""
    nothing = Parameter("sensors.scans", Parameter.Type[kind], [])
    some = Parameter("sensors.scans", value=["a", "b"])
    assert bench.set_each(nothing, some, nothing) == ["", "", ""]
    assert [one.sensors.scans for one in bench.changes] == [(), ("a", "b"), ()]


def test_a_whole_number_keeps_the_parameters_type(bench: Bench) -> None:
    """So that tools go on to show a number with a fraction."""
    assert bench.set_each(Parameter("population.mean_life", value=60)) == [""]
    assert repr(bench.get("population.mean_life")) == "[60.0]"
    assert repr(bench.bridge.values.population.mean_life) == "60.0"


def test_a_value_is_told_as_it_is_used(bench: Bench) -> None:
    """Frames lose their leading slash, as in tf2."""
    assert bench.set_each(Parameter("frames.map", value="/world")) == [""]
    assert bench.get("frames.map") == ["world"]


def test_parameters_of_others_are_left_to_them(bench: Bench) -> None:
    """Those of rclpy, and any that the node declares itself; nothing of ours has changed."""
    bench.node.declare_parameter("somebody.elses", 3)
    assert bench.set_each(Parameter("somebody.elses", value=4)) == [""]
    assert bench.set_each(Parameter("use_sim_time", value=True)) == [""]
    assert bench.get("somebody.elses", "use_sim_time") == [4, True]
    assert bench.changes == []


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_a_refused_call_changes_nothing_of_others(bench: Bench, order: tuple[int, ...]) -> None:
    """Wherever in the call the wrong value stands."""
    bench.node.declare_parameter("somebody.elses", 3)
    call = (
        Parameter("somebody.elses", value=4),
        Parameter("seed", value=-1),
        Parameter("use_sim_time", value=True),
    )
    assert "-1 is below 0" in bench.set_together(*(call[i] for i in order))
    assert bench.get("somebody.elses", "use_sim_time") == [3, False]
    assert not bench.node.get_clock().ros_time_is_active


def test_others_may_refuse_a_call_that_is_fine_for_us(bench: Bench) -> None:
    """Then nothing changes here, nor at the next call of somebody else."""
    bench.node.declare_parameter("somebody.elses", 3)
    ours = Parameter("seed", value=5)
    reason = bench.set_together(ours, Parameter("somebody.elses", value="three"))
    assert "Wrong parameter type" in reason
    assert bench.set_each(Parameter("somebody.elses", value=4)) == [""]
    assert bench.bridge.values.seed == 0
    assert bench.changes == []
