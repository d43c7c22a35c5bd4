"""The local planner: planners propose motion primitives [1]; trajectories are committed to.

1. Each agent follows a trajectory that it is committed to: a primitive, then braking to a stand.
2. Where it stands it is safe for ever, so no agent is in an inevitable collision state [2].
3. An agent plans again every `REPLAN` sub-steps, after a new command, and when its trajectory is
   broken from outside: by an arrival, a displaced agent, a new map or the robot.
4. In a sub-step the agents that are due plan one after the other, in the order of their ids; each
   keeps clear of the trajectories that the others are committed to (prioritized planning).
5. The planner of its command proposes what it may do for about a second (`proposals`): a heading or
   a curvature, a speed, and a cost without dimension: 0 is what it likes best. The dynamic window
   [1] lists all there is (`primitives`); the social force and the path following list a few, and
   `user_planners` those that a class of the user wishes.
6. `rollouts` integrates a primitive and the braking as a unicycle, sub-step by sub-step.
7. `planning` tries the proposals, the cheapest first. One is feasible if its boxes overlap no
   closed ground (`walls`), not the robot (`robot`), and no other trajectory (`gaps`). Touching
   is no overlap; the test is exact. So no planner can make an agent collide.
8. The cheapest feasible trajectory is committed to. Without one the agent keeps its old
   trajectory, which still is free: all others have kept clear of it.
9. An agent without progress pushes others aside, by priority inheritance [3], or tries a detour
   (`deadlock`).
10. `planner` is what Python calls, and does this for all agents, in compiled kernels.

[1] Fox, Burgard, Thrun: The dynamic window approach to collision avoidance. IEEE Robotics and
    Automation Magazine 4(1), 1997.
[2] Fraichard, Asama: Inevitable collision states, a step towards safer robots? Advanced Robotics
    18(10), 2004.
[3] Sha, Rajkumar, Lehoczky: Priority inheritance protocols. IEEE Transactions on Computers 39(9),
    1990.
"""
