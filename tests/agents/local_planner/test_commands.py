"""What a new order changes, against a slow twin."""

import math

import numpy as np
import pytest

from are_ros.agents.body import Body, MotionCommand
from are_ros.agents.local_planner import deadlock as _deadlock
from are_ros.agents.local_planner import state as _state
from are_ros.agents.local_planner.planner import LocalPlanner
from are_ros.agents.table import AgentTable
from are_ros.population.artefact import GroundPose
from tests.agents.local_planner.streets import artefact_at

BODY = Body((0.2, 0.3))


def shift_m(before: MotionCommand, after: MotionCommand) -> float:
    """Return how far a sub-goal has moved; infinitely far if there was none, or is none now."""
    if before.subgoal_m is None or after.subgoal_m is None:
        return 0.0 if before.subgoal_m is after.subgoal_m else math.inf
    return math.dist(before.subgoal_m, after.subgoal_m)


def twin(
    agents: _state.AgentArrays, slot: int, before: MotionCommand, after: MotionCommand, now: int
) -> None:
    """Write an order into the records, one field after the other."""
    memory, moved_m = agents.memory[slot], shift_m(before, after)
    if moved_m > 0.1 or after.speed_mps != before.speed_mps:
        agents.due[slot] = now
    if moved_m > 0.0:
        memory["passed_at"] = _state.NEVER
    if moved_m > 1.0 and memory["credit"] < 0.0:
        memory["credit"] = 0.0
    if after.subgoal_m is None and moved_m > 0.0:
        memory["blocked"] = memory["credit"] = 0.0
        memory["detour_after"] = _deadlock._FIRST_DETOUR
        memory["obstruction"], memory["obstructed_by"] = _state.UNOBSTRUCTED, _state.NOBODY
    agents.command[slot] = _state.command_record(after)


def drawn_order(rng: np.random.Generator, before: MotionCommand) -> MotionCommand:
    """Return one like that before, a little or wholly other, or to stand."""
    if rng.random() < 0.2:
        return MotionCommand(None, 0.0)
    x_m, y_m = before.subgoal_m or (0.0, 0.0)
    step_m = rng.choice([0.0, 0.05, 0.5, 3.0])
    speed_mps = before.speed_mps if rng.random() < 0.5 else float(rng.choice([0.8, 1.3]))
    face_rad = None if rng.random() < 0.5 else 0.3
    subgoal_m = (x_m + step_m, y_m - step_m)
    return MotionCommand(subgoal_m, speed_mps, bool(rng.random() < 0.5), face_rad, 0.2, 0.4, 0.05)


def drawn_fleet(rng: np.random.Generator, count: int) -> _state.AgentArrays:
    """Return records of minds in any state, who all stand."""
    agents = _state.agent_arrays(count, 4)
    for name in ("blocked", "credit", "detour_after"):
        agents.memory[name] = rng.uniform(-1.0, 1.0, count)
    for name in ("passed_at", "obstruction", "obstructed_by"):
        agents.memory[name] = rng.integers(0, 4, count)
    agents.command[:] = _state.command_record(MotionCommand(None, 0.0))
    return agents


def test_orders_change_what_the_twin_changes() -> None:
    """Of some at once, again and again; the others' records stay what they are."""
    rng, count = np.random.default_rng(8), 12
    agents = drawn_fleet(rng, count)
    expected = _state.AgentArrays(*(table.copy() for table in agents))
    commands = [MotionCommand(None, 0.0)] * count
    for now in range(60):
        slots = rng.permutation(count)[:5]
        after = [drawn_order(rng, commands[slot]) for slot in slots]
        for slot, command in zip(slots.tolist(), after, strict=True):
            twin(expected, slot, commands[slot], command, now)
            commands[slot] = command
        rows = np.array([_state.command_record(command) for command in after], np.float64)
        _deadlock.write_commands(agents.command, agents.memory, agents.due, slots, rows, now)
        np.testing.assert_array_equal(agents.due, expected.due)
        for table, other in ((agents.memory, expected.memory), (agents.command, expected.command)):
            for name in table.dtype.names or ():
                np.testing.assert_array_equal(table[name], other[name])
        agents.memory["credit"] -= rng.uniform(0.0, 0.1, count)
        expected.memory["credit"] = agents.memory["credit"]


def traffic_of(*ids: int) -> LocalPlanner:
    """Return a traffic of people a metre apart."""
    table = AgentTable(0.05)
    for artefact_id in ids:
        table.add(artefact_at(artefact_id, GroundPose(float(artefact_id), 0.0, 0.0, 0.0)), BODY)
    return LocalPlanner(table)


def test_whom_nobody_knows_has_no_row() -> None:
    """Be it beyond all, or between two."""
    table = AgentTable(0.05)
    with pytest.raises(KeyError):
        table.rows_of([1])
    for artefact_id in (3, 8):
        table.add(artefact_at(artefact_id, GroundPose(0.0, 0.0, 0.0, 0.0)), BODY)
    for artefact_ids in ([9], [5], [3, 4], [1]):
        with pytest.raises(KeyError):
            table.rows_of(artefact_ids)
    assert table.rows_of([8, 3]).tolist() == [1, 0]


def test_no_orders_are_no_orders() -> None:
    """Nobody needs to be there."""
    planner = traffic_of()
    planner.give_commands([], [])
    assert planner.obstructions([]) == []


def test_where_all_are_is_kept_up_to_date() -> None:
    """Who comes, goes or is put elsewhere: as if it were looked for anew; old arrays stay."""
    table, rng, there = AgentTable(0.05), np.random.default_rng(3), dict[int, GroundPose]()
    planner = LocalPlanner(table)
    for step in range(300):
        before, copy = table.poses, table.poses.copy()
        artefact_id = int(rng.integers(1000))
        x_m, y_m, yaw_rad = rng.uniform(-3.0, 3.0, 3).tolist()
        pose = GroundPose(x_m, y_m, 0.0, yaw_rad)
        if artefact_id not in there and (len(there) < 9 or step % 3 == 0):
            table.add(artefact_at(artefact_id, pose), BODY)
            there[artefact_id] = pose
        else:
            artefact_id = list(there)[int(rng.integers(len(there)))]
            del there[artefact_id]
            if step % 3 == 1:
                table.remove(artefact_id)
            else:
                table.stand(table.row_of(artefact_id), pose)
                there[artefact_id] = pose
        np.testing.assert_array_equal(before, copy)
        assert table.ids.tolist() == table.arrays.place["id"].tolist() == sorted(there)
        expected = [(*pose[:2], pose.yaw_rad) for _, pose in sorted(there.items())]
        np.testing.assert_array_equal(planner.motion[:, :3], np.array(expected).reshape(-1, 3))
