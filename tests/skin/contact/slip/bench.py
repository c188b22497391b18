"""Units under bodies that are dragged, and the kernel alone, in Python."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from skin.contact.model import contact_data, contact_model
from skin.contact.record import NEW, Event, UnitKind
from skin.contact.slip import SlipSettings
from skin.contact.slip.detector import detect_slip_python

STIFFNESS = 0.5
"""N/mm, tangential, of most units; that of each is a little else."""
TOLD = (
    "slip", "flags", "slip_units", "body_units", "stick_ratio", "pattern", "slip_probability",
    "slip_direction", "motion", "rotation", "friction", "friction_sigma", "friction_spread",
    "friction_at_least", "margin", "margin_at_least", "grip_force", "grip_force_at_most",
    "grip_force_sigma",
)  # fmt: skip
KEPT = (
    "anchor", "anchor_variance", "lag", "moved", "lag_variance", "moved_slow", "followed",
    "gain_error", "followed_out", "gain_information", "anchor_depth", "lag_mean", "age_s", "behind",
    "noisy", "noise_ratio", "noise_sum", "noise_count", "slow_sum", "slid_shear", "slid_load",
    "slid_variance", "borne", "began",
)  # fmt: skip
"""What a contact says of slip, and what is kept of each unit."""
EVERY = 10
"""Cycles from one that is written down to the next, unless a bench says."""


def flat_skin(n, rng):
    """Units in a plane, in rows of four, each turned about its own normal; all at random."""
    at = np.arange(n)
    place = 0.012 * np.array([at % 4, at // 4, 0.0 * at]) + rng.uniform(-0.002, 0.002, (3, n))
    turned = Rotation.from_euler("z", rng.uniform(-3.0, 3.0, (n, 1)))
    return _anywhere(place, turned, rng)


def curved_skin(n, rng, tilt=0.5):
    """The same with normals that point up to `tilt` radians away from their mean."""
    at = np.arange(n)
    place = 0.012 * np.array([at % 3, at // 3, 0.0 * at]) + rng.uniform(-0.002, 0.002, (3, n))
    turned = Rotation.from_euler("z", rng.uniform(-3.0, 3.0, (n, 1)))
    tilted = Rotation.from_rotvec(np.vstack([rng.uniform(-tilt, tilt, (2, n)), np.zeros(n)]).T)
    return _anywhere(place, tilted * turned, rng)


def _anywhere(place, frames, rng):
    whole = Rotation.random(random_state=int(rng.integers(1 << 30)))
    place = whole.apply(place.T).T + rng.uniform(-0.1, 0.1, (3, 1))
    return place, np.moveaxis((whole * frames).as_matrix(), 0, 2)


class Bench:
    """Bodies that bear on units of a skin: position (3, n) in metre, rotation (3, 3, n)."""

    def __init__(self, skin, rng, **settings):
        self.position, self.rotation = skin
        self.n, self.rng = self.position.shape[1], rng
        self.stiffness = STIFFNESS * (1.0 + 0.1 * np.cos(np.arange(self.n)))
        settings = SlipSettings(**settings)
        self.model = contact_model(*skin, 1e-4, np.zeros(self.n + 1), [])
        for name, value in asdict(settings).items():
            self.model.settings[name] = value
        self.data = contact_data(self.n, 4, 0)
        units = self.data.units
        self.reading = SimpleNamespace(**{
            name: units[name].T
            for name in ("force", "force_sigma", "displacement", "displacement_sigma")
        })  # fmt: skip
        self.contacts = self.data.contacts
        self.now_ns, self.seen = 10_000_000_000, set()
        self.every, self.judged, self.rows = EVERY, 0, []

    def drag(self, way_mm, angle=0.0, units=slice(None), tilt=0.0):
        """How a body that goes along the skin (2,), turns about its middle normal and tilts by
        radians drags units, (2, n) mm."""
        frames, place = self.rotation[:, :, units], self.position[:, units]
        up = frames[:, 2].mean(axis=1)
        up /= np.linalg.norm(up)
        along = np.cross(up, [0.3, 0.5, 0.8])
        along /= np.linalg.norm(along)
        across = np.cross(up, along)
        away = place - place.mean(axis=1, keepdims=True)
        turn = 1e3 * (angle * up + tilt * along)
        goes = way_mm[0] * along + way_mm[1] * across + np.cross(turn, away.T)
        drag = np.zeros((2, self.n))
        drag[:, units] = np.einsum("na,acn->cn", goes, frames[:, :2])
        return drag

    def read(self, load, drag, friction=np.inf, sigma_mm=0.03, noise=1.0):
        """Readings of units under loads (n,), of which friction lets no more through; with noise
        that is more than told by a factor."""
        far = np.maximum(np.hypot(*drag), 1e-12)
        drag = drag * np.minimum(1.0, friction * load / self.stiffness / far)
        reading, n = self.reading, self.n
        reading.displacement_sigma[:] = sigma_mm * np.array([[0.8], [1.2], [1.0]])
        error = noise * reading.displacement_sigma[:2] * self.rng.standard_normal((2, n))
        reading.displacement[:2] = drag + error
        reading.displacement[2] = load / 4.5
        reading.force[:2], reading.force[2] = self.stiffness * reading.displacement[:2], load
        reading.force_sigma[:] = np.array([[0.4], [0.7], [1.5]]) * sigma_mm

    def judge(self, contacts, dt_s=0.004, kind=None):
        """Judge contacts, each a dict of `id`, `members` and perhaps `parent`, `event`, `flags`,
        and write some cycles down; the records."""
        data, units = self.data, self.data.units
        self.now_ns += round(1e9 * dt_s)
        data.label[:], units["kind"] = -1, UnitKind.OUT if kind is None else kind
        records, begin = [], 0
        for k, contact in enumerate(contacts):
            members = np.array(contact["members"])
            slot = contact["id"] % 8
            data.slots["present"][k] = slot
            end = begin + members.size
            data.members[begin:end], data.label[members] = members, slot
            units["kind"][members] = UnitKind.OPEN
            born = contact["id"] not in self.seen
            self.seen.add(contact["id"])
            if born:
                self.contacts[slot] = NEW[0]
            record = self.contacts[slot]
            record["id"], record["parent"] = contact["id"], contact.get("parent", 0)
            record["event"] = contact.get("event", Event.BORN if born else Event.NONE)
            record["begin"], record["end"], record["flags"] = begin, end, contact.get("flags", 0)
            self._describe(record, members)
            records.append((record, members))
            begin = end
        cycle = data.cycle
        cycle["present"], cycle["elapsed_s"], cycle["now_ns"] = len(contacts), dt_s, self.now_ns
        detect_slip_python(self.model, data)
        if self.judged % self.every == 0:
            self.rows += [self._row(record, members) for record, members in records]
        self.judged += 1
        return [record for record, _ in records]

    def _row(self, record, members):
        """Numbers of a contact, and of its units each once by how far and how much."""
        mine = self.data.slips[members]
        kept = [f(mine[name]) for name in KEPT for f in (np.sum, np.linalg.norm)]
        states = np.bincount(self.data.slip, minlength=4)
        told = [np.ravel(record[name]) for name in TOLD]
        onset_s = 1e-9 * (self.now_ns - record["onset_ns"]) if record["onset_ns"] else np.nan
        return np.concatenate([[self.judged, record["id"], onset_s], *told, states, kept])

    def _describe(self, record, members):
        force, place = self.reading.force[:, members], self.position[:, members]
        frames = self.rotation[:, :, members]
        load, record["load"] = force[2], force[2].sum()
        centre = place @ load / load.sum()
        record["centroid"] = record["middle"] = centre
        away = (place - centre[:, np.newaxis]).T
        record["arm"] = np.linalg.norm(away, axis=1) @ load / load.sum()
        normal = frames[:, 2] @ load
        axes, _ = np.linalg.qr(np.column_stack([normal, np.eye(3)]))
        normal = -axes[:, 0] * np.sign(axes[:, 0] @ normal)
        record["axes"] = np.column_stack([axes[:, 1], np.cross(normal, axes[:, 1]), normal])
        total = np.einsum("abn,bn->an", frames, force)
        record["shear"] = np.linalg.norm(total.sum(axis=1) - normal * (normal @ total.sum(axis=1)))
        record["torsion"] = normal @ np.cross(away, total.T).sum(axis=0)
        sigma = self.reading.force_sigma[:, members]
        record["wrench_covariance"] = np.eye(6)
        covariance = np.einsum("acn,cn,bcn->ab", frames, sigma**2, frames)
        record["wrench_covariance"][:3, :3] = covariance
