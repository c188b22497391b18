"""Features of contacts of plain arrays, of any 3-axis tactile array."""

from __future__ import annotations

import numpy as np

from skin.contact.describe import describe
from skin.contact.graph import checked_graph
from skin.contact.model import (
    GIVEN,
    ContactData,
    ContactModel,
    Gate,
    Readings,
    Wants,
    contact_data,
    posed_units,
)
from skin.contact.record import BORN, OUT, SILENT

__all__ = ["contact_features"]


_NO_GATE = Gate(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, needs_displacement=False)
_ALL = Wants(total=True, each=True, slip=False)


def contact_features(
    label: np.ndarray,
    force: np.ndarray,
    force_sigma: np.ndarray | float,
    position: np.ndarray,
    rotation: np.ndarray,
    area: np.ndarray | float,
    *,
    displacement_mm: np.ndarray | None = None,
    temperature: np.ndarray | None = None,
    silent: np.ndarray | None = None,
    neighbour_start: np.ndarray | None = None,
    neighbour_index: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Describe clusters of units of any 3-axis tactile array, and their total.

    Parameters
    ----------
    label : ndarray, shape (n,)
        Cluster of each unit, 0 to k - 1; -1 for none. See `contact_clusters`.
    force : ndarray, shape (3, n)
        Newton, unit frame: what the world exerts on the unit; z, into the skin, is the normal load.
    force_sigma : ndarray, shape (3, n), or float
        Newton, one-sigma.
    position : ndarray, shape (3, n)
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the skin frame.
    area : ndarray, shape (n,), or float
        Sensing area, m².
    displacement_mm : ndarray, shape (3, n), optional
        Millimetre, unit frame; the depth makes the normal that of what touches, not of the skin.
    temperature : ndarray, shape (n,), optional
        Degree Celsius.
    silent : ndarray, shape (n,), bool, optional
        Units that say nothing; with the neighbour graph, for the coverage.
    neighbour_start, neighbour_index : ndarray, optional
        Neighbour graph in compressed rows.

    Returns
    -------
    contacts : ndarray, shape (k,), CONTACT
        What is known of each cluster; identity, path and slip are left zero.
    total : ndarray, shape (), CONTACT
        The same of all of them together.

    Examples
    --------
    Two of three units in a row carry 1 N and 3 N; the third is silent:

    >>> force = np.array([[0, 0, 0], [0, 0, 0], [1.0, 3.0, np.nan]])
    >>> position = np.array([[0.00, 0.01, 0.02], [0, 0, 0], [0, 0, 0]])
    >>> contacts, total = contact_features(
    ...     np.array([0, 0, -1]), force, 0.01, position, np.stack([np.eye(3)] * 3, 2), 1e-4,
    ...     silent=[False, False, True], neighbour_start=[0, 1, 3, 4], neighbour_index=[1, 0, 2, 1])
    >>> contacts["centroid"][0].round(6).tolist(), contacts["load"].tolist()
    ([0.0075, 0.0, 0.0], [4.0])
    >>> contacts["coverage"].round(6).tolist()
    [0.666667]
    """
    n = np.size(label)
    dtype = np.result_type(force, np.float32)

    def row(values: np.ndarray | float | None, shape: tuple[int, ...]) -> np.ndarray:
        return np.array(np.broadcast_to(0.0 if values is None else values, shape), dtype, order="C")

    given = np.array([(displacement_mm is not None, temperature is not None)], GIVEN)
    reading = Readings(
        row(force, (3, n)), row(force_sigma, (3, n)), row(displacement_mm, (3, n)),
        np.zeros((3, n), dtype), row(temperature, (n,)), np.ones(n, bool), given,
    )  # fmt: skip
    if neighbour_start is None or neighbour_index is None:
        neighbour_start, neighbour_index = np.zeros(n + 1, np.int32), np.zeros(0, np.int32)
    graph = checked_graph(n, neighbour_start, neighbour_index)
    model = ContactModel(graph, _NO_GATE, posed_units(position, rotation, area), _ALL)
    count, data = _labelled(np.asarray(label), silent, reading)
    describe(count, True, 0 if silent is None else int(np.count_nonzero(silent)), model, data)
    return data.contacts[:count], data.contacts[-1]


def _labelled(
    label: np.ndarray, silent: np.ndarray | None, reading: Readings
) -> tuple[int, ContactData]:
    """Clusters as `find_contacts` leaves them, and how many."""
    count = int(label.max(initial=-1)) + 1
    order = np.argsort(label, kind="stable")
    ends = np.searchsorted(label[order], np.arange(count + 1))
    data = contact_data(reading, count)
    units, records = data.units, data.contacts
    records["begin"][:count], records["end"][:count] = ends[:-1] - ends[0], ends[1:] - ends[0]
    records["event"] = BORN
    units.label[:] = label
    units.members[: label.size - ends[0]] = order[ends[0] :]
    if silent is not None:
        units.kind[:] = np.where(silent, SILENT, OUT)
    data.slots.present[:] = np.arange(2 * count)
    data.counters["touching_units"] = label.size - ends[0]
    return count, data
