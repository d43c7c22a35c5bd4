"""The frame tree's own rules: time, order, precedence, refusals."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from are_ros.errors import (
    DisconnectedFramesError,
    ExtrapolationToFutureError,
    ExtrapolationToPastError,
    InvalidTransformError,
    UnknownFrameError,
)
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import STATIC, FrameEdge, FrameTree, TransformSource

UNTURNED = (0.0, 0.0, 0.0, 1.0)
ODOMETRY, TF, PREFERRED_ODOMETRY, PARAMETER = TransformSource
S = 1_000_000_000


def put(
    tree: FrameTree,
    parent: str,
    child: str,
    stamp_s: float,
    x: float = 0.0,
    source: TransformSource = TF,
) -> None:
    """Give the tree a shift along x at a stamp in seconds."""
    tree.set_transform(parent, child, round(stamp_s * S), (x, 0, 0), UNTURNED, source=source)


def fix(tree: FrameTree, parent: str, child: str, x: float, source: TransformSource = TF) -> None:
    """Give the tree a static shift along x."""
    tree.set_static(parent, child, (x, 0, 0), UNTURNED, source=source)


def x_of(tree: FrameTree, target: str, source: str, stamp_s: float) -> float:
    """Return where the source's origin lies along the target's x axis."""
    return float(tree.lookup(target, source, round(stamp_s * S)).translation_m[0])


def moving() -> FrameTree:
    """Return map -> odom (every second) -> base (every 0.1 s) -> laser (static), 0 s to 2 s."""
    tree = FrameTree()
    for second in range(3):
        put(tree, "map", "odom", second, x=10.0 * second)
    for tenth in range(21):
        put(tree, "odom", "base", tenth / 10, x=tenth / 10)
    fix(tree, "base", "laser", 0.5)
    return tree


# --- time


def test_a_lookup_interpolates_along_the_chain() -> None:
    """Each edge is taken at the stamp, and the direction of the question is honoured."""
    tree = moving()
    assert x_of(tree, "map", "laser", 1.25) == pytest.approx(12.5 + 1.25 + 0.5)
    assert x_of(tree, "laser", "map", 1.25) == pytest.approx(-14.25)
    assert x_of(tree, "base", "laser", 99.0) == 0.5


def test_equal_frames_give_the_identity_at_any_time() -> None:
    """A known frame in itself is the identity; an unknown one is an error, not the identity."""
    tree = moving()
    np.testing.assert_array_equal(tree.lookup("base", "base", 99 * S).matrix(), np.eye(4))
    with pytest.raises(UnknownFrameError, match="'sofa' was not seen so far; known frames: base"):
        tree.lookup("sofa", "sofa", 0)


def test_nothing_is_extrapolated() -> None:
    """Outside an edge's stamps there is an error that names the edge and its bound."""
    tree = moving()
    put(tree, "map", "odom", 3)
    with pytest.raises(ExtrapolationToFutureError, match=r"odom -> base ends at 2\.000000000 s"):
        tree.lookup("map", "laser", 2 * S + 1)
    with pytest.raises(ExtrapolationToPastError, match=r"map -> odom begins at 0\.000000000 s"):
        tree.lookup("map", "odom", -1)
    assert x_of(tree, "map", "laser", 2.0) == pytest.approx(22.5)
    assert x_of(tree, "map", "laser", 0.0) == 0.5


@pytest.mark.parametrize("source", ["base", "laser"])
def test_an_edge_that_has_ended_is_named_before_one_that_goes_on(source: str) -> None:
    """A localization that is silent for longer than the history: odometry is not to blame."""
    tree = moving()
    for second in range(3, 20):
        put(tree, "odom", "base", second)
    ended = r"map -> odom ends there, and odom -> base begins at"
    with pytest.raises(ExtrapolationToPastError, match=ended):
        tree.latest_before("map", source, 19 * S)


def test_separate_trees_are_told_apart() -> None:
    """Known frames without a chain between them are a different error."""
    tree = moving()
    fix(tree, "moon", "crater", 1.0)
    with pytest.raises(DisconnectedFramesError, match="no chain"):
        tree.lookup("moon", "odom", S)


def test_a_single_sample_holds_at_its_stamp_only() -> None:
    """One sample gives its own stamp, and an error of the right direction elsewhere."""
    tree = FrameTree()
    put(tree, "a", "b", 5, x=3.0)
    assert x_of(tree, "a", "b", 5) == 3.0
    with pytest.raises(ExtrapolationToPastError):
        tree.lookup("a", "b", 5 * S - 1)
    with pytest.raises(ExtrapolationToFutureError):
        tree.lookup("a", "b", 5 * S + 1)


def test_the_latest_time_is_the_slowest_edges() -> None:
    """The latest common time is the least of the edges' newest; static chains have none."""
    tree = moving()
    put(tree, "odom", "base", 2.7)
    assert tree.latest_common_time("map", "laser") == 2 * S
    assert tree.latest_common_time("odom", "laser") == round(2.7 * S)
    assert tree.latest_common_time("laser", "base") == STATIC
    assert tree.latest_before("laser", "base", 7) == 7


def test_the_newest_pose_is_that_at_the_latest_common_time() -> None:
    """An edge that goes on does not matter; a frame in itself is the identity, known or not."""
    tree = moving()
    put(tree, "odom", "base", 2.7)
    newest = tree.lookup_latest("map", "laser").matrix()
    np.testing.assert_array_equal(newest, tree.lookup("map", "laser", 2 * S).matrix())
    np.testing.assert_array_equal(tree.lookup_latest("sofa", "sofa").matrix(), np.eye(4))
    with pytest.raises(UnknownFrameError, match="'sofa' was not seen so far"):
        tree.lookup_latest("map", "sofa")


def test_samples_of_the_future_do_not_spoil_a_tick() -> None:
    """An edge stamped beyond now allows now itself; a slower one sets the time."""
    tree = moving()
    put(tree, "base", "wheel", 1.0)
    put(tree, "base", "wheel", 2.5, x=15.0)
    assert tree.latest_before("odom", "wheel", round(1.95 * S)) == round(1.95 * S)
    assert tree.latest_before("odom", "wheel", round(2.3 * S)) == 2 * S
    assert x_of(tree, "base", "wheel", 2.0) == pytest.approx(10.0)


def test_an_edge_that_begins_after_now_is_an_error() -> None:
    """With nothing at or before the time the edge that begins too late is named."""
    tree = moving()
    put(tree, "base", "wheel", 2.2)
    with pytest.raises(ExtrapolationToPastError, match="base -> wheel begins"):
        tree.latest_before("map", "wheel", 2 * S)
    with pytest.raises(ExtrapolationToPastError, match="base -> wheel begins"):
        tree.latest_before("map", "wheel", 3 * S)
    with pytest.raises(ExtrapolationToPastError):
        tree.latest_before("map", "base", -1)


def test_a_slow_correction_is_held() -> None:
    """map->odom is the last before the stamp, odom->laser exactly at it."""
    tree = moving()
    put(tree, "odom", "base", 2.4, x=2.4)
    assert tree.lookup_held("map", "odom", "laser", round(2.3 * S)).translation_m[
        0
    ] == pytest.approx(20.0 + 2.3 + 0.5)
    with pytest.raises(ExtrapolationToFutureError):
        tree.lookup_held("map", "odom", "laser", round(2.5 * S))


def test_the_edge_that_is_late_is_named_not_the_one_that_is_held() -> None:
    """Both end before the stamp."""
    tree = moving()
    with pytest.raises(ExtrapolationToFutureError, match=r"odom -> base ends at 2\.0"):
        tree.lookup_held("map", "odom", "laser", round(2.5 * S))


def test_a_clock_that_jumps_back_forgets_the_future() -> None:
    """Samples after now go, those up to now and static ones stay; then time goes on from there."""
    tree = moving()
    put(tree, "base", "wheel", 1.8)
    tree.forget_after(round(1.5 * S))
    assert tree.latest_common_time("map", "laser") == S
    assert tree.latest_common_time("odom", "laser") == round(1.5 * S)
    with pytest.raises(DisconnectedFramesError):
        tree.lookup("base", "wheel", S)
    put(tree, "odom", "base", 1.6, x=7.0)
    assert x_of(tree, "odom", "base", 1.6) == 7.0
    tree.clear()
    assert tree.edges() == []
    assert not tree.has_frame("map")


def test_samples_far_ahead_of_the_clock_give_way() -> None:
    """After a clock jumped back, what was still on its way; tf2 would drop all others till then."""
    tree, still = FrameTree(), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    for stamp_ns, now_ns in ((0, 0), (58 * S, 2 * S), (2 * S, 2 * S), (3 * S, 3 * S)):
        tree.set_transform("odom", "base", stamp_ns, *still, now_ns=now_ns)
        tree.set_transform("odom", "other", stamp_ns, *still)
    assert tree.latest_common_time("odom", "base") == 3 * S
    assert tree.latest_common_time("odom", "other") == 58 * S
    said = tree.drain_notices()
    assert "transforms of base stamped more than 10 s ahead of the clock are forgotten" in said
    tree.set_transform("odom", "base", 12 * S, *still, now_ns=4 * S)
    tree.set_transform("odom", "base", 4 * S, *still, now_ns=4 * S)
    assert tree.latest_common_time("odom", "base") == 12 * S


# --- order


def test_samples_may_come_out_of_order() -> None:
    """A shuffled recording gives the answers of the sorted one."""
    tree, dice = FrameTree(), np.random.default_rng(5)
    stamps = [n / 10 for n in range(80)]
    for stamp in dice.permutation(stamps):
        put(tree, "a", "b", stamp, x=stamp * stamp)
    for n in range(79):
        expected = (stamps[n] ** 2 + stamps[n + 1] ** 2) / 2
        assert x_of(tree, "a", "b", stamps[n] + 0.05) == pytest.approx(expected)


def test_the_history_ends() -> None:
    """Samples fall off behind the history, its limit included; late ones are dropped, said once."""
    tree = FrameTree(history_ns=2 * S)
    for second in range(6):
        put(tree, "a", "b", second, x=second)
    assert tree.edges()[0].first_ns == 3 * S
    put(tree, "a", "b", 2.99, x=50.0)
    put(tree, "a", "b", 2.5, x=50.0)
    assert tree.edges()[0].count == 3
    assert tree.drain_notices() == ["transforms of b older than the history of 2 s are dropped"]


def test_the_first_sample_of_a_stamp_stays() -> None:
    """A repeated stamp is ignored, as tf2 does, be it the newest or an older one."""
    tree = moving()
    put(tree, "odom", "base", 2, x=-1.0)
    put(tree, "odom", "base", 1, x=-1.0)
    assert (x_of(tree, "odom", "base", 2), x_of(tree, "odom", "base", 1)) == (2.0, 1.0)
    assert tree.drain_notices() == []


def test_long_recordings_keep_their_samples() -> None:
    """Segments that slide, grow and are packed anew lose and mix up nothing."""
    tree = FrameTree(history_ns=3 * S)
    for n in range(3000):
        for frame in range(1 + n // 1000):
            put(tree, "root", f"f{frame}", n / 100, x=n + 10_000 * frame)
    for frame in range(3):
        for n in (2710, 2999):
            assert x_of(tree, "root", f"f{frame}", n / 100) == n + 10_000 * frame
        assert tree.edges()[frame].count == 301


# --- parents


def test_a_frame_changes_its_parent_from_a_stamp_on() -> None:
    """Each sample keeps its parent; between two parents the older sample is held; said once."""
    tree = FrameTree()
    fix(tree, "world", "a", 100.0)
    fix(tree, "world", "b", 200.0)
    for stamp, parent in ((0, "a"), (1, "a"), (2, "b"), (3, "b")):
        put(tree, parent, "cup", stamp, x=stamp)
    assert [x_of(tree, "world", "cup", stamp) for stamp in (0.5, 1.5, 2.5)] == [100.5, 101, 202.5]
    assert x_of(tree, "a", "cup", 0.5) == 0.5
    assert tree.drain_notices() == ["tf gave cup a new parent: b instead of a, from its stamp on"]


def test_the_last_parent_of_a_stamp_wins() -> None:
    """Two parents at one stamp: the later message holds."""
    tree = FrameTree()
    put(tree, "a", "cup", 1, x=1.0)
    put(tree, "b", "cup", 1, x=2.0)
    assert x_of(tree, "b", "cup", 1) == 2.0
    with pytest.raises(DisconnectedFramesError):
        tree.lookup("a", "cup", S)


def test_the_latest_time_heeds_changing_parents() -> None:
    """The latest time is one at which the chain in force is known."""
    tree = FrameTree()
    for stamp, parent in ((0, "a"), (1, "a"), (2, "b")):
        put(tree, parent, "cup", stamp)
    assert tree.latest_before("a", "cup", round(1.5 * S)) == round(1.5 * S)
    assert tree.latest_before("b", "cup", 3 * S) == 2 * S
    put(tree, "base", "a", 1.2)
    put(tree, "base", "a", 0.2)
    assert tree.latest_before("base", "cup", round(1.9 * S)) == round(1.2 * S)


def test_an_edge_given_both_ways_round_is_one_edge() -> None:
    """A bag with a->b and b->a gives one history, said once."""
    tree = FrameTree()
    for n in range(5):
        put(tree, "a", "b", n, x=n)
        put(tree, "b", "a", n + 0.5, x=-(n + 0.5))
    assert x_of(tree, "a", "b", 3.25) == pytest.approx(3.25)
    assert x_of(tree, "b", "a", 3.25) == pytest.approx(-3.25)
    assert tree.drain_notices() == [
        "the transform b -> a from tf is kept as a -> b, as this pair of frames was given before"
    ]
    assert tree.drain_notices() == []


def test_a_loop_is_ignored_with_a_notice() -> None:
    """A transform of the same strength that would close a loop is ignored, and lookups end."""
    tree = FrameTree()
    put(tree, "a", "b", 1, x=1.0)
    put(tree, "b", "c", 1, x=2.0)
    put(tree, "c", "a", 1, x=4.0)
    fix(tree, "c", "a", 4.0)
    assert x_of(tree, "a", "c", 1) == 3.0
    assert tree.drain_notices() == [
        "the transform c -> a from tf is ignored: it would close a loop, a is above c already"
    ]


def test_a_loop_among_old_samples_is_an_error() -> None:
    """Parents that changed at different stamps can meet in a loop at one time: an error there."""
    tree = FrameTree()
    put(tree, "a", "b", 1)
    put(tree, "c", "b", 3)
    put(tree, "b", "a", 2)
    put(tree, "b", "a", 4)
    with pytest.raises(DisconnectedFramesError, match="loop"):
        tree.lookup("c", "a", round(2.5 * S))
    with pytest.raises(DisconnectedFramesError, match="loop"):
        tree.latest_before("c", "a", round(2.5 * S))
    assert x_of(tree, "c", "a", 3) == 0.0


# --- sources


@pytest.mark.parametrize("order", [(ODOMETRY, TF, PARAMETER), (PARAMETER, TF, ODOMETRY)])
def test_the_stronger_source_holds(order: tuple[TransformSource, ...]) -> None:
    """Parameter over tf over odometry, in either order of arrival, each override said once."""
    tree = FrameTree()
    for _ in range(2):
        for source in order:
            put(tree, "odom", "base", 1, x=float(source), source=source)
    assert x_of(tree, "odom", "base", 1) == float(PARAMETER)
    assert [edge.source for edge in tree.edges()] == [PARAMETER]
    overrides = tree.drain_notices()
    assert len(overrides) == len(set(overrides)) <= 3
    assert any("odom -> base from tf is overruled by the parameters" in text for text in overrides)


@pytest.mark.parametrize("order", [(PREFERRED_ODOMETRY, TF), (TF, PREFERRED_ODOMETRY)])
def test_preferred_odometry_overrules_tf(order: tuple[TransformSource, ...]) -> None:
    """Its samples hold, whichever came first, and the notice says what was preferred."""
    tree = FrameTree()
    for source in order * 2:
        put(tree, "odom", "base", 1, x=float(source), source=source)
    assert x_of(tree, "odom", "base", 1) == float(PREFERRED_ODOMETRY)
    assert tree.drain_notices() == [
        "the transform odom -> base from tf is overruled by preferred odometry"
    ]


@pytest.mark.parametrize("parameter_first", [True, False])
def test_a_static_parameter_overrules_preferred_odometry(parameter_first: bool) -> None:
    """What is said by hand holds against all else."""
    tree = FrameTree()
    for is_parameter in (parameter_first, not parameter_first):
        if is_parameter:
            fix(tree, "odom", "base", 5.0, PARAMETER)
        else:
            put(tree, "odom", "base", 1, x=2.0, source=PREFERRED_ODOMETRY)
    assert x_of(tree, "odom", "base", 1) == 5.0
    assert tree.drain_notices() == [
        "the transform odom -> base from preferred odometry is overruled by the parameters"
    ]


def test_tf_gives_another_parent_than_odometry() -> None:
    """A frame's parent comes from the stronger source, even if it is another parent."""
    for order in ((ODOMETRY, TF), (TF, ODOMETRY)):
        tree = FrameTree()
        for source in order * 2:
            put(tree, "odom" if source is ODOMETRY else "map", "base", 1, x=3.0, source=source)
        assert x_of(tree, "map", "base", 1) == 3.0
        with pytest.raises(DisconnectedFramesError):
            tree.lookup("odom", "base", S)
        assert tree.drain_notices() == [
            "the transform odom -> base from odometry is overruled by tf"
        ]


def turned(angle_rad: float) -> tuple[float, float, float, float]:
    """Return a turn about z and a little about x, as a quaternion."""
    x, y, z, w = Rotation.from_euler("zx", (angle_rad, 0.2)).as_quat().tolist()
    return x, y, z, w


@pytest.mark.parametrize("source", [ODOMETRY, PREFERRED_ODOMETRY])
@pytest.mark.parametrize("joints_from", [TF, PARAMETER])
@pytest.mark.parametrize("first", ["joints", "odometry", "between"])
def test_odometry_of_a_part_moves_the_robot(
    source: TransformSource, joints_from: TransformSource, first: str
) -> None:
    """A tracking camera below the base by two static joints: the base moves, both stay joined."""
    joints = [("base", "mount", (0.2, 0.1, 0.5), 0.7), ("mount", "camera", (0.0, 0.3, 0.1), -1.9)]
    tree, known = FrameTree(), {"odometry": 0, "between": 1, "joints": 2}[first]
    for parent, child, shift_m, angle_rad in joints[2 - known :]:
        tree.set_static(parent, child, shift_m, turned(angle_rad), source=joints_from)
    tree.set_transform("odom", "camera", S, (1.0, 2.0, 0.3), turned(0.4), source=source)
    for parent, child, shift_m, angle_rad in joints[: 2 - known]:
        tree.set_static(parent, child, shift_m, turned(angle_rad), source=joints_from)
    for second in (2, 3):
        at_m = (1.0 + second, 2.0, 0.3)
        tree.set_transform("odom", "camera", second * S, at_m, turned(0.4), source=source)
        expected = np.eye(4)
        expected[:3, :3], expected[:3, 3] = Rotation.from_quat(turned(0.4)).as_matrix(), at_m
        camera = tree.lookup("odom", "camera", second * S).matrix()
        np.testing.assert_allclose(camera, expected, atol=1e-12)
        for parent, child, shift_m, angle_rad in joints:
            joint = tree.lookup(parent, child, second * S)
            np.testing.assert_allclose(joint.translation_m, shift_m, atol=1e-12)
            np.testing.assert_allclose(joint.rotation_xyzw, turned(angle_rad), atol=1e-12)
    moving = [edge for edge in tree.edges() if not edge.is_static]
    assert [(edge.parent, edge.child) for edge in moving] == [("odom", "base")]
    names = {ODOMETRY: "odometry", PREFERRED_ODOMETRY: "preferred odometry"}
    assert (
        f"{names[source]} tells the pose of camera, which static transforms fix to base: it moves"
        " base"
    ) in tree.drain_notices()


def test_tf_overrules_odometry_of_a_part() -> None:
    """The base's own transform in tf holds, in either order; the part stays on the robot."""
    for order in ((ODOMETRY, TF), (TF, ODOMETRY)):
        tree = FrameTree()
        fix(tree, "base", "camera", 0.5)
        for source in order * 2:
            frame = "camera" if source is ODOMETRY else "base"
            put(tree, "odom", frame, 1, x=3.0 + source, source=source)
        assert x_of(tree, "odom", "base", 1) == 3.0 + TF
        assert x_of(tree, "odom", "camera", 1) == 3.5 + TF
        said = tree.drain_notices()
        assert said[-1] == "the transform odom -> base from odometry is overruled by tf"
        assert len(said) == 1 + (order[0] is ODOMETRY)  # it moved the base until tf came


@pytest.mark.parametrize("source", [ODOMETRY, TF])
def test_joints_up_to_the_parent_hold(source: TransformSource) -> None:
    """Static map -> odom -> base: odometry of the base is overruled; only odometry is carried."""
    tree = FrameTree()
    fix(tree, "map", "odom", 1.0)
    fix(tree, "odom", "mount", 1.0)
    fix(tree, "mount", "base", 1.0)
    if source is ODOMETRY:
        put(tree, "odom", "base", 1, x=9.0, source=ODOMETRY)
        put(tree, "map", "base", 1, x=9.0, source=ODOMETRY)
        assert x_of(tree, "map", "base", 1) == 3.0
    else:
        put(tree, "odom", "base", 1, x=9.0)
        assert x_of(tree, "map", "base", 1) == 10.0
    assert not [said for said in tree.drain_notices() if "fix" in said]


@pytest.mark.parametrize("order", [(ODOMETRY, TF), (TF, ODOMETRY)])
def test_tf_gives_odometrys_pair_the_other_way_round(order: tuple[TransformSource, ...]) -> None:
    """Odometry says odom->base, tf says map->base->odom: tf's tree stands whole."""
    tree = FrameTree()
    for stamp in (1, 2):
        for source in order:
            if source is ODOMETRY:
                put(tree, "odom", "base", stamp, x=7.0, source=ODOMETRY)
            else:
                put(tree, "base", "odom", stamp, x=-3.0)
                put(tree, "map", "base", stamp, x=10.0)
    assert x_of(tree, "odom", "base", 2) == 3.0
    assert x_of(tree, "map", "odom", 2) == 7.0
    assert {edge.source for edge in tree.edges()} == {TF}
    assert tree.drain_notices() == ["the transform odom -> base from odometry is overruled by tf"]


@pytest.mark.parametrize("parameter_first", [True, False])
def test_a_parameter_gives_tfs_pair_the_other_way_round(parameter_first: bool) -> None:
    """The parameter a->b holds against tf's b->a, and b keeps the parent that tf gives it."""
    tree = FrameTree()
    if parameter_first:
        fix(tree, "a", "b", 5.0, source=PARAMETER)
    for stamp in (1, 2, 3):
        put(tree, "map", "b", stamp, x=100.0)
        put(tree, "b", "a", stamp, x=-1.0)
        if not parameter_first and stamp == 2:
            fix(tree, "a", "b", 5.0, source=PARAMETER)
    assert x_of(tree, "a", "b", 3) == 5.0
    assert x_of(tree, "map", "a", 3) == 95.0


def test_a_stronger_source_opens_a_loop_at_its_weakest_edge() -> None:
    """Odometry's edge gives way where tf's would close a longer loop with it."""
    tree = FrameTree()
    put(tree, "odom", "base", 1, x=9.0, source=ODOMETRY)
    put(tree, "base", "footprint", 1, x=1.0)
    put(tree, "footprint", "odom", 1, x=2.0)
    assert x_of(tree, "base", "odom", 1) == 3.0
    put(tree, "odom", "base", 2, x=9.0, source=ODOMETRY)
    assert len(tree.edges()) == 2
    assert len(tree.drain_notices()) == 2


def test_static_and_stamped_replace_each_other() -> None:
    """From one source the newest kind holds, as in Jazzy's tf2, and it is said."""
    tree = FrameTree()
    fix(tree, "a", "b", 1.0)
    fix(tree, "a", "b", 2.0)
    assert x_of(tree, "a", "b", 0) == 2.0
    put(tree, "a", "b", 5, x=3.0)
    with pytest.raises(ExtrapolationToPastError):
        tree.lookup("a", "b", 0)
    fix(tree, "a", "b", 4.0)
    assert x_of(tree, "a", "b", 0) == 4.0
    assert len(tree.drain_notices()) == 2


# --- names and refusals


def test_leading_slashes_do_not_count() -> None:
    """Names with and without a leading slash are one frame, in data and in questions."""
    tree = FrameTree()
    fix(tree, "/map", "odom", 1.0)
    fix(tree, "odom", "/base", 2.0)
    assert x_of(tree, "map", "/base", 0) == 3.0
    edges = [(edge.parent, edge.child) for edge in tree.edges()]
    assert edges == [("map", "odom"), ("odom", "base")]
    assert tree.has_frame("/odom")
    assert tree.has_frame("base")
    assert not tree.has_frame("sofa")


@pytest.mark.parametrize(
    ("parent", "child", "x", "w", "reason"),
    [
        ("", "b", 0.0, 1.0, "empty"),
        ("a", "/", 0.0, 1.0, "empty"),
        ("a", "a", 0.0, 1.0, "the same frame"),
        ("/a", "a", 0.0, 1.0, "the same frame"),
        ("a", "b", math.nan, 1.0, "not finite"),
        ("a", "b", -math.inf, 1.0, "not finite"),
        ("a", "b", 0.0, 0.0, "length 0, not 1"),
        ("a", "b", 0.0, 1.0051, "length 1.0051, not 1"),
    ],
)
def test_a_refused_transform_changes_nothing(
    parent: str, child: str, x: float, w: float, reason: str
) -> None:
    """Unusable names and numbers are refused with the reason, and the tree is as before."""
    tree = FrameTree()
    fix(tree, "world", "house", 1.0)
    before = tree.edges()
    with pytest.raises(InvalidTransformError, match=reason):
        tree.set_transform(parent, child, S, (x, 0, 0), (0, 0, 0, w))
    with pytest.raises(InvalidTransformError, match=reason):
        tree.set_static(parent, child, (x, 0, 0), (0, 0, 0, w))
    assert (tree.edges(), tree.drain_notices()) == (before, [])
    assert not tree.has_frame("a")
    assert not tree.has_frame("b")


def test_near_unit_rotations_are_normalised() -> None:
    """A quaternion within tf2's tolerance is taken, and what comes out has unit length."""
    tree = FrameTree()
    tree.set_transform("a", "b", S, (0, 0, 0), (0, 0, 0.6, np.float32(0.802)))
    assert np.linalg.norm(tree.lookup("a", "b", S).rotation_xyzw) == pytest.approx(1, abs=1e-15)


def test_edges_are_listed() -> None:
    """The list has each edge's frames, source, kind, stamps and count."""
    edges = moving().edges()
    assert edges[0] == FrameEdge("base", "laser", TF, True, 0, 0, 1)
    assert edges[2] == FrameEdge("odom", "base", TF, False, 0, 2 * S, 21)


# --- properties, and a slow twin

places = st.floats(-10, 10)
turns = st.builds(
    lambda *values: np.array(values) / np.linalg.norm(values),
    *[st.floats(-1, 1).filter(lambda value: abs(value) > 0.01)] * 4,
)
poses = st.builds(
    lambda x, y, z, turn: RigidTransform(np.array((x, y, z)), turn), places, places, places, turns
)


@given(poses, poses, st.floats(0, 1))
def test_interpolation_is_linear_and_slerp(a: RigidTransform, b: RigidTransform, t: float) -> None:
    """Between two samples the pose is scipy's slerp and the weighted mean."""
    tree = FrameTree()
    tree.set_transform("a", "b", 0, a.translation_m, a.rotation_xyzw)
    tree.set_transform("a", "b", S, b.translation_m, b.rotation_xyzw)
    stamp = round(t * S)
    found, t = tree.lookup("a", "b", stamp), stamp / S
    mean = (1 - t) * a.translation_m + t * b.translation_m
    slerp = Slerp([0, 1], Rotation.from_quat([a.rotation_xyzw, b.rotation_xyzw]))
    if abs(a.rotation_xyzw @ b.rotation_xyzw) > 1e-3:  # half a turn has two shortest arcs
        np.testing.assert_allclose(found.rotation_matrix(), slerp(t).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(found.translation_m, mean, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-4, 0.05, 0.0999, 0.1001, 0.3, 3.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_small_angles_are_exact(angle: float, sign: float) -> None:
    """From parallel to nearly opposite, a third of the way is a third of the angle."""
    tree = FrameTree()
    end = sign * math.sin(angle / 2), sign * math.cos(angle / 2)
    tree.set_transform("a", "b", 0, (0, 0, 0), UNTURNED)
    tree.set_transform("a", "b", 3 * S, (0, 0, 0), (0, 0, *end))
    assert tree.lookup("a", "b", S).yaw_rad() == pytest.approx(angle / 3, abs=1e-14)


def random_tree(seed: int) -> FrameTree:
    """Return six frames below one root, static and dynamic, sampled from 0 s to 4 s."""
    dice, tree = np.random.default_rng(seed), FrameTree()
    for frame in range(1, 7):
        parent, times = f"f{dice.integers(frame)}", np.sort(dice.integers(1, 4 * S, 30))
        for stamp in (0, *times.tolist(), 4 * S):
            turn = dice.normal(size=4)
            pose = dice.normal(size=3), turn / np.linalg.norm(turn)
            if frame == 3:
                tree.set_static(parent, f"f{frame}", *pose)
            else:
                tree.set_transform(parent, f"f{frame}", stamp, *pose)
    return tree


@settings(max_examples=50, deadline=None)
@given(
    st.integers(0, 5), st.lists(st.integers(0, 6), min_size=3, max_size=3), st.integers(0, 4 * S)
)
def test_lookups_compose_and_invert(seed: int, frames: list[int], stamp: int) -> None:
    """lookup(a, b) @ lookup(b, c) is lookup(a, c), and lookup(b, a) undoes lookup(a, b)."""
    tree, (a, b, c) = random_tree(seed), [f"f{number}" for number in frames]
    direct = tree.lookup(a, c, stamp)
    by_b = tree.lookup(a, b, stamp) @ tree.lookup(b, c, stamp)
    np.testing.assert_allclose(by_b.matrix(), direct.matrix(), atol=1e-12)
    back = tree.lookup(c, a, stamp)
    np.testing.assert_allclose((back @ direct).matrix(), np.eye(4), atol=1e-12)


class SlowTree:
    """The obvious twin: dictionaries of samples, matrices, scipy's slerp, parents one by one."""

    def __init__(self) -> None:
        self.samples: dict[str, dict[int, tuple[str, RigidTransform]]] = {}

    def put(self, parent: str, child: str, stamp: int, pose: RigidTransform) -> None:
        """Keep a sample; the first of a stamp stays unless its parent changes."""
        kept = self.samples.setdefault(child, {})
        if stamp not in kept or kept[stamp][0] != parent:
            kept[stamp] = (parent, pose)

    def edge(self, child: str, stamp: int) -> tuple[str, RigidTransform] | None:
        """Return the parent at the stamp and parent_from_child, or None outside the samples."""
        stamps = sorted(self.samples.get(child, {}))
        if not stamps or not stamps[0] <= stamp <= stamps[-1]:
            return None
        before = max(s for s in stamps if s <= stamp)
        parent, older = self.samples[child][before]
        if before == stamp:
            return parent, older
        after = min(s for s in stamps if s > stamp)
        its_parent, newer = self.samples[child][after]
        if its_parent != parent:
            return parent, older
        t = (stamp - before) / (after - before)
        turn = Slerp([0, 1], Rotation.from_quat([older.rotation_xyzw, newer.rotation_xyzw]))(t)
        shift = (1 - t) * older.translation_m + t * newer.translation_m
        return parent, RigidTransform(shift, turn.as_quat())

    def up(self, frame: str, stamp: int) -> dict[str, RigidTransform]:
        """Return ancestor_from_frame of all ancestors, the frame itself first."""
        found, pose = {frame: RigidTransform.identity()}, RigidTransform.identity()
        while (edge := self.edge(frame, stamp)) is not None and edge[0] not in found:
            frame, pose = edge[0], edge[1] @ pose
            found[frame] = pose
        return found

    def lookup(self, target: str, source: str, stamp: int) -> RigidTransform | None:
        """Return target_from_source by way of the first common ancestor, or None."""
        above_target, above_source = self.up(target, stamp), self.up(source, stamp)
        for frame, pose in above_target.items():
            if frame in above_source:
                return pose.inverse() @ above_source[frame]
        return None


@pytest.mark.parametrize("seed", range(10))
def test_random_arrivals_agree_with_the_slow_twin(seed: int) -> None:
    """Shuffled samples, repeats and changing parents give the twin's poses and failures."""
    dice, tree, twin = np.random.default_rng(seed), FrameTree(), SlowTree()
    for _ in range(400):
        child = int(dice.integers(1, 6))
        parent = f"f{child - 1 if dice.random() < 0.8 else dice.integers(child)}"
        stamp, turn = int(dice.integers(200)) * 10_000_000, dice.normal(size=4)
        pose = RigidTransform(dice.normal(size=3), turn / np.linalg.norm(turn))
        tree.set_transform(parent, f"f{child}", stamp, pose.translation_m, pose.rotation_xyzw)
        twin.put(parent, f"f{child}", stamp, pose)
    for _ in range(200):
        target, source = (f"f{number}" for number in dice.integers(0, 6, 2))
        stamp = int(dice.integers(-5, 205)) * 10_000_000 + int(dice.integers(2)) * 3_333_333
        expected = twin.lookup(target, source, stamp)
        if expected is None:
            with pytest.raises((ExtrapolationToPastError, ExtrapolationToFutureError)):
                tree.lookup(target, source, stamp)
        else:
            found = tree.lookup(target, source, stamp).matrix()
            np.testing.assert_allclose(found, expected.matrix(), atol=1e-10)


def test_a_frame_has_the_parent_of_its_newest_sample() -> None:
    """Where one of another parent has the same stamp, that came last; or when it is forgotten."""
    tree = FrameTree()
    put(tree, "a", "c", 1)
    put(tree, "b", "c", 1)
    assert [edge.parent for edge in tree.edges()] == ["b"]
    tree = FrameTree()
    put(tree, "a", "c", 1)
    put(tree, "b", "c", 2)
    tree.forget_after(S)
    assert [edge.parent for edge in tree.edges()] == ["a"]


def test_a_sample_as_old_as_the_history_is_kept() -> None:
    """Older ones are dropped."""
    tree = FrameTree(10 * S)
    put(tree, "a", "c", 20)
    put(tree, "a", "c", 10)
    put(tree, "a", "c", 9)
    assert [edge.first_ns for edge in tree.edges()] == [10 * S]


def test_odometry_does_not_turn_a_static_edge_round() -> None:
    """What tf gives once and for all goes before odometry that names it the other way."""
    tree = FrameTree()
    fix(tree, "a", "b", 1.0)
    tree.set_transform("b", "a", S, (0.0, 0.0, 0.0), UNTURNED, source=ODOMETRY)
    assert [(edge.parent, edge.child) for edge in tree.edges()] == [("a", "b")]
