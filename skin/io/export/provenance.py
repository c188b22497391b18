"""Provenance of what is written: by which skin, calibration and options it was decoded."""

from __future__ import annotations

import hashlib
import json
import sys
from typing import TYPE_CHECKING

import numpy as np

from topology.packed import TEXTS, is_calibration, to_arrays

if TYPE_CHECKING:
    from skin.options import Options
    from topology import Topology

__all__ = ["calibration_hashes", "provenance_of"]


def provenance_of(topology: Topology, options: Options) -> dict[str, str]:
    """Names and hashes of all that decoded values depend on, but for their log.

    Returns
    -------
    dict of str to str
        ``skin``, ``topology_sha256`` (all of it but its calibration), ``calibration_sha256``,
        ``serials`` (of the units, JSON), ``options`` (JSON) and ``version``.
    """
    wiring, calibration = hashlib.sha256(), hashlib.sha256()
    for name, array in sorted(to_arrays(topology).items()):
        digest = calibration if is_calibration(name) else wiring
        digest.update(name.encode())
        if name == TEXTS:
            texts = json.loads(str(array))
            texts.pop("path", None)  # the same file may be in another folder
            digest.update(json.dumps(texts, sort_keys=True).encode())
        else:
            digest.update(array.tobytes())
    return {
        "skin": topology.name, "topology_sha256": wiring.hexdigest(),
        "calibration_sha256": calibration.hexdigest(), "serials": json.dumps(topology.serials),
        "options": json.dumps(options.report(), sort_keys=True),
        "version": str(vars(sys.modules["skin"])["__version__"]),
    }  # fmt: skip


def calibration_hashes(topology: Topology) -> list[str]:
    """The hash of the calibration of each unit: SHA-256 of its parameters, by their names."""
    digests = [hashlib.sha256() for _ in range(topology.n)]
    for name, values in sorted(topology.parameters.items()):
        for digest, own in zip(digests, np.moveaxis(values, -1, 0), strict=True):
            digest.update(name.encode() + own.tobytes())
    return [digest.hexdigest() for digest in digests]
