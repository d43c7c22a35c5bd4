"""The survey of frames."""

from are_ros.messages.transforms import StampedTransform
from are_ros.replay.survey.frame_survey import FrameSurvey, FrameSurveyor
from are_ros.world.transforms.tree import TransformSource

S = 1_000_000_000
ODOMETRY = TransformSource.ODOMETRY


def edge(parent: str, child: str, stamp_ns: int = 0) -> StampedTransform:
    """Return an edge; its numbers do not matter here."""
    return StampedTransform(parent, child, stamp_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def surveyed(*edges: StampedTransform, static: tuple[StampedTransform, ...] = ()) -> FrameSurvey:
    """Return the survey of edges that were recorded at their stamps."""
    surveyor = FrameSurveyor()
    for one in edges:
        surveyor.see([one], "/tf", one.stamp_ns, is_static=False)
    for one in static:
        surveyor.see([one], "/tf_static", one.stamp_ns, is_static=True)
    return surveyor.survey()


def test_edges_are_counted_and_timed() -> None:
    """Eleven stamps over a second are 10 Hz; static edges have no rate."""
    moving = [edge("odom", "base", k * S // 10) for k in range(11)]
    survey = surveyed(*moving, static=(edge("base", "laser"),))
    laser, base = survey.edges
    assert (base.parent, base.child, base.count, base.rate_hz) == ("odom", "base", 11, 10.0)
    assert (laser.is_static, laser.rate_hz, laser.topics) == (True, 0.0, ("/tf_static",))
    assert survey.oddities == ()


def test_rates_in_words() -> None:
    """A single stamp has none, however often it came."""
    texts = [
        surveyed(*(edge("odom", "base", stamp_ns) for stamp_ns in stamps_ns)).edges[0].rate_text()
        for stamps_ns in ((S,), (S, S), (S, 11 * S // 10), (S, 51 * S), (0, S, 2 * S))
    ]
    assert texts == ["once", "one stamp", "10.0 Hz", "0.02 Hz", "1.0 Hz"]
    assert surveyed(static=(edge("odom", "base"),)).edges[0].rate_text() == "static"


def test_the_tree_is_drawn_from_its_roots() -> None:
    """Roots first, children indented, separate trees one after the other."""
    survey = surveyed(
        edge("map", "odom"), edge("odom", "base"), static=(edge("base", "laser"), edge("a", "b"))
    )
    assert survey.tree_lines() == (
        "a",
        "  b (static, /tf_static)",
        "map",
        "  odom (once, /tf)",
        "    base (once, /tf)",
        "      laser (static, /tf_static)",
    )
    assert survey.connected_to("laser") == {"map", "odom", "base", "laser"}
    assert survey.connected_to("nowhere") == {"nowhere"}


def test_an_edge_in_both_directions_is_odd() -> None:
    """It is said, and drawing the ring ends."""
    survey = surveyed(edge("map", "odom"), edge("odom", "map"), edge("odom", "base"))
    assert survey.oddities == ("map -> odom is there in both directions",)
    assert survey.tree_lines() == (
        "map",
        "  odom (once, /tf)",
        "    base (once, /tf)",
        "    map (once, /tf, see above)",
    )


def test_a_frame_with_two_parents_is_odd() -> None:
    """It is said with both parents and with what holds then; both edges are drawn."""
    survey = surveyed(edge("map", "base"), edge("odom", "base"))
    (sentence,) = survey.oddities
    assert sentence == (
        "base has several parents: map, odom; of map and odom the newer transform holds, from its"
        " stamp on, so that all below base jumps or gets lost: let one of their publishers be"
        " silent"
    )
    assert len(survey.tree_lines()) == 4


def test_of_parents_of_several_sources_one_holds() -> None:
    """As in a replay: what is given before tf, tf before odometry."""
    surveyor = FrameSurveyor()
    sources = {"a": TransformSource.ODOMETRY, "b": TransformSource.TF}
    for parent, source in sources.items():
        surveyor.see([edge(parent, "base")], parent, 0, is_static=False, source=source)
    said = "base has several parents: a, b; tf holds, not odometry"
    assert surveyor.survey().oddities == (said,)
    given = TransformSource.PARAMETER
    surveyor.see([edge("c", "base")], "given", 0, is_static=True, source=given)
    assert surveyor.survey().oddities == (
        "odometry tells the pose of base, which static transforms fix to c: it moves c",
        "base has several parents: b, c; what is given holds, not tf",
    )


def test_odometry_of_a_part_joins_the_robot() -> None:
    """As in a frame tree: it moves what its part is fixed to, unless that has a parent in tf."""
    surveyor = FrameSurveyor()
    joints = [edge("base", "mount"), edge("mount", "camera")]
    surveyor.see(joints, "/tf_static", 0, is_static=True)
    surveyor.see([edge("odom", "camera")], "/odom", 0, is_static=False, source=ODOMETRY)
    survey = surveyor.survey()
    said = "odometry tells the pose of camera, which static transforms fix to base: it moves base"
    assert survey.oddities == (said,)
    assert survey.root_of("mount") == "odom"
    assert survey.connected_to("odom") == {"odom", "base", "mount", "camera"}
    surveyor.see([edge("map", "base")], "/tf", 0, is_static=False)
    survey = surveyor.survey()
    assert survey.oddities == ("camera has several parents: mount, odom; tf holds, not odometry",)
    assert survey.root_of("camera") == "map"
    assert survey.connected_to("odom") == {"odom"}


def test_a_moving_joint_parts_odometry_from_the_robot() -> None:
    """Odometry of what tf moves on the robot is overruled, so nothing joins the robot to it."""
    surveyor = FrameSurveyor()
    surveyor.see([edge("base", "camera")], "/tf", 0, is_static=False)
    surveyor.see([edge("odom", "camera")], "/odom", 0, is_static=False, source=ODOMETRY)
    survey = surveyor.survey()
    assert survey.oddities == ("camera has several parents: base, odom; tf holds, not odometry",)
    assert survey.connected_to("base") == {"base", "camera"}


def test_transforms_that_a_replay_refuses_make_no_edge() -> None:
    """Where some of an edge are good, the others are odd; where none is, the edge is refused."""
    zero = StampedTransform("map", "odom", 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    nan = StampedTransform("odom", "base", 0, (float("nan"), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    survey = surveyed(zero, zero, edge("odom", "base"), nan)
    assert [(one.parent, one.child, one.count) for one in survey.edges] == [("odom", "base", 1)]
    (refused,) = survey.refused
    assert refused.startswith("2 transforms map -> odom of /tf refused: the rotation (0.0, 0.0, 0")
    (odd,) = survey.oddities
    assert odd.startswith("1 transform odom -> base of /tf refused: a number is not finite")


def test_slashes_are_dropped_and_said() -> None:
    """A slash in front makes no other frame."""
    survey = surveyed(edge("/map", "odom"), edge("map", "/odom"))
    assert [(one.parent, one.child, one.count) for one in survey.edges] == [("map", "odom", 2)]
    assert survey.oddities == ("2 frame names begin with a slash, which is dropped: /map, /odom",)


def test_stamps_of_the_future_are_odd() -> None:
    """A moving edge that is stamped half a second ahead is said."""
    surveyor = FrameSurveyor()
    surveyor.see([edge("base", "laser", S // 2)], "/tf", 0, is_static=False)
    assert surveyor.survey().oddities == (
        "base -> laser is stamped up to 0.50 s after being recorded",
    )


def test_an_edge_of_two_topics_is_odd() -> None:
    """Odometry and tf that both give an edge are named."""
    surveyor = FrameSurveyor()
    for topic in ("/tf", "/odom"):
        surveyor.see([edge("odom", "base")], topic, 0, is_static=False)
    assert surveyor.survey().oddities == ("odom -> base comes from several topics: /odom, /tf",)
