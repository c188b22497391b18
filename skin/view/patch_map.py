"""A patch as a flat map: an image whose pixels belong to units."""

from __future__ import annotations

import numpy as np

from skin.view.colour import OFF_COLOUR, colours, is_on, valid
from skin.view.drawing import radii
from skin.view.scene import BACKGROUND, CHOSEN_COLOUR, RIM_COLOUR

__all__ = ["PatchMap", "flattened"]

WIDTH_PX, HIGHEST_PX = 340, 420
"""Of the image: as wide as the panel, and its largest height."""
CROSS_WIDTH = 0.16
"""Half a bar of the cross of an invalid unit, in radii."""


def flattened(position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Places of the units of a patch on paper, shape (2, m), metre.

    A flat patch is seen from outside, the x axes of its units to the right. A cylinder is unrolled
    about the axis that its normals are perpendicular to. Of a dome, each unit is as far from the
    middle as its normal is turned (azimuthal equidistant projection).

    Parameters
    ----------
    position : ndarray, shape (3, m)
    rotation : ndarray, shape (3, 3, m)
    """
    outward = -rotation[:, 2]
    mean = outward.mean(axis=1)
    spread, axes = np.linalg.eigh(outward @ outward.T / outward.shape[1])
    if spread[2] > 1.0 - FLAT and np.linalg.norm(mean) > 0.5:
        across, along = _plane(_unit(mean, axes[:, 2]), rotation[:, 0].mean(axis=1))
        flat: np.ndarray = np.stack([across, along]) @ position
        return flat
    if spread[0] < FLAT:
        axis = axes[:, 0] * (-1.0 if axes[np.abs(axes[:, 0]).argmax(), 0] < 0.0 else 1.0)
        front = _unit(mean - (mean @ axis) * axis, axes[:, 2])
        frame = np.stack([np.cross(axis, front), front])
        turned = np.arctan2(*(frame @ outward))
        return np.stack([_bend(frame @ outward, frame @ position) * turned, axis @ position])
    front = _unit(mean, axes[:, 2])
    across, along = _plane(front, rotation[:, 0].mean(axis=1))
    frame = np.stack([across, along, front])
    x, y, z = frame @ outward
    sideways = np.hypot(x, y)
    share = np.arctan2(sideways, z) / np.where(sideways > 1e-9, sideways, 1.0)
    return _bend(frame @ outward, frame @ position) * np.stack([x, y]) * share


def _unit(vector: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-6 else otherwise


def _plane(normal: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors across a normal: the first near x."""
    least = np.eye(3)[np.abs(normal).argmin()]
    across = _unit(x - (x @ normal) * normal, np.cross(normal, least))
    across = across / np.linalg.norm(across)
    return across, np.cross(normal, across)


def _bend(outward: np.ndarray, position: np.ndarray) -> float:
    """The radius of a bend: how far places move as normals turn, by least squares."""
    turned = outward - outward.mean(axis=1, keepdims=True)
    moved = position - position.mean(axis=1, keepdims=True)
    return float(np.sum(turned * moved) / max(float(np.sum(turned * turned)), 1e-12))


FLAT = 0.02
"""Largest mean square of the normals across their main direction, for a flat patch, or across
their plane, for a cylinder [assumed: 8 degrees]."""


class PatchMap:
    """The image of a patch; its pixels are found once.

    Parameters
    ----------
    units : ndarray, shape (m,), int
        Of the patch.
    position, rotation : ndarray, shape (3, n) and (3, 3, n)
        Of all units.
    area : ndarray, shape (n,)
        Square metre.
    """

    def __init__(
        self, units: np.ndarray, position: np.ndarray, rotation: np.ndarray, area: np.ndarray
    ) -> None:
        from scipy.spatial import KDTree

        self.units = units
        flat = flattened(position[:, units], rotation[:, :, units])
        radius = radii(np.vstack([flat, np.zeros(units.size)]), area[units])
        low = (flat - radius).min(axis=1)
        size = (flat + radius).max(axis=1) - low
        margin = 0.04 * float(size.max())
        scale = min(WIDTH_PX / (size[0] + 2.0 * margin), HIGHEST_PX / (size[1] + 2.0 * margin))
        columns, rows = WIDTH_PX, int(np.ceil(scale * (size[1] + 2.0 * margin)))
        x = (np.arange(columns) + 0.5 - 0.5 * columns) / scale + low[0] + 0.5 * size[0]
        y = low[1] - margin + (rows - 0.5 - np.arange(rows)) / scale
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        distance, nearest = KDTree(flat.T).query(grid)
        away = (grid - flat.T[nearest]) / radius[nearest][:, np.newaxis]
        share = distance / radius[nearest]
        diagonal = np.abs(away @ (np.sqrt(0.5) * np.array([[1.0, 1.0], [1.0, -1.0]])))
        shape = rows, columns
        self._unit = np.where(share <= 1.0, nearest, -1).reshape(shape)
        """Index within the patch of each pixel, -1 outside of units."""
        self._rim = (share > 0.92).reshape(shape) & (self._unit >= 0)
        self._thick_rim = (share > 0.84).reshape(shape) & (self._unit >= 0)
        self._cross = ((share < 0.8) & (diagonal.min(axis=1) < CROSS_WIDTH)).reshape(shape)

    def image(self, record: np.void, values: np.ndarray, ends: tuple[float, float],
              chosen: int | None) -> np.ndarray:  # fmt: skip
        """The image, shape (rows, columns, 3), uint8.

        Parameters
        ----------
        record : void
            A snapshot.
        values : ndarray, shape (n,)
            That colour the units.
        ends : (float, float)
            Of the scale of colours.
        chosen : int or None
            The chosen unit.
        """
        on = is_on(record["status"])[self.units]
        heard = valid(record)[self.units]
        palette = np.empty((self.units.size + 1, 3), np.uint8)
        palette[:-1] = colours(values[self.units], heard, *ends)
        palette[:-1][~on] = OFF_COLOUR
        palette[-1] = BACKGROUND
        image = palette[self._unit]
        crossed = np.append(~heard & on, False)
        image[self._cross & crossed[self._unit]] = 0
        image[self._rim] = RIM_COLOUR
        if chosen is not None:
            image[self._thick_rim & (np.append(self.units, -1)[self._unit] == chosen)] = (
                CHOSEN_COLOUR
            )
        return image
