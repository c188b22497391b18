"""Coordinates of joints from poses of links: inverse kinematics by Gauss-Newton steps.

Recordings and `Skin.move` have poses of units and no joints; a picture of the robot needs them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from topology.robot.model import RobotModel

__all__ = ["coordinates"]

STEPS = 30
"""Most steps; they end where one changes less than `ENOUGH`."""
ENOUGH = 1e-5
"""rad or m: less than is seen."""
LENGTH_M = 0.05
"""Metres that weigh as much as a radian [assumed: a finger's phalanx]."""
LARGEST = 0.5
"""Largest step of a joint, rad or m: the equations are linear only nearby."""


def coordinates(
    robot: RobotModel, poses: Mapping[int, np.ndarray], start: np.ndarray
) -> np.ndarray:
    """Coordinates that bring links to poses, by least squares.

    Parameters
    ----------
    robot : RobotModel
    poses : mapping of int to ndarray, shape (4, 4)
        T_base_link, metre, by index of the link.
    start : ndarray, shape (J,)
        Rad or m: where the search begins. Joints that move none of the links stay there.

    Returns
    -------
    ndarray, shape (J,)
    """
    q, links = np.array(start, float), sorted(poses)
    if not links or not q.size:
        return q
    goal = np.stack([poses[link] for link in links])
    low = np.nan_to_num(robot.lower, nan=-np.inf)
    high = np.nan_to_num(robot.upper, nan=np.inf)
    moved_by = _moved_by(robot, links)
    for _ in range(STEPS):
        now = robot.forward(q)
        slopes = _slopes(robot, now, links, moved_by)
        step = np.linalg.lstsq(slopes, _errors(goal, now[links]), rcond=1e-9)[0]
        step *= min(1.0, LARGEST / max(float(np.abs(step).max()), LARGEST))
        before, q = q, np.clip(q + step, low, high)
        if np.abs(q - before).max() < ENOUGH:
            break
    return q


def _moved_by(robot: RobotModel, links: list[int]) -> np.ndarray:
    """Whether the joint of link k moves a link against the base: 1 or -1, shape (L, m); -1 where it
    lies between the root and the base, and the base moves away."""
    count = len(robot.parent)
    carries = np.eye(count)
    for link, parent in enumerate(robot.parent):
        if parent >= 0:
            carries[:, link] += carries[:, parent]
    found: np.ndarray = carries[:, links] - carries[:, [robot.base]]
    return found


def _slopes(
    robot: RobotModel, now: np.ndarray, links: list[int], moved_by: np.ndarray
) -> np.ndarray:
    """Derivatives of positions over `LENGTH_M` and rotation vectors, shape (6 m, J)."""
    slopes = np.zeros((len(links), 6, robot.home.size))
    place = now[links, :3, 3]
    for k, driver in enumerate(robot.driver):
        if driver < 0 or not moved_by[k].any():
            continue
        axis = now[k, :3, :3] @ robot.axis[:, k]
        gain = robot.multiplier[k] * moved_by[k][:, np.newaxis]
        if robot.kinds[k] == "prismatic":
            slopes[:, :3, driver] += gain * axis / LENGTH_M
            continue
        anchor = now[k, :3, 3] + now[k, :3, :3] @ robot.anchor[:, k]
        slopes[:, :3, driver] += gain * np.cross(axis, place - anchor) / LENGTH_M
        slopes[:, 3:, driver] += gain * axis
    return slopes.reshape(-1, robot.home.size)


def _errors(goal: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Of positions over `LENGTH_M`, and rotation vectors, shape (6 m,)."""
    from scipy.spatial.transform import Rotation

    turn = goal[:, :3, :3] @ np.swapaxes(now[:, :3, :3], 1, 2)
    place = (goal[:, :3, 3] - now[:, :3, 3]) / LENGTH_M
    return np.concatenate([place, Rotation.from_matrix(turn).as_rotvec()], axis=1).ravel()
