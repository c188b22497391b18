"""Units under bodies that are dragged, and the kernel alone, in Python, beside the slow algebra."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from skin.contact.model import contact_data, contact_model
from skin.contact.record import NEW, Event, Flag, SlipState, UnitKind
from skin.contact.slip import SlipSettings
from skin.contact.slip.detector import detect_slip_python
from tests.naive.slip import NaiveSlip

STIFFNESS = 0.5
"""N/mm, tangential, of most units; that of each is a little else."""
TOLD = (
    "slip", "slip_units", "body_units", "onset_ns", "stick_ratio", "pattern", "slip_probability",
    "slip_direction", "motion", "friction", "friction_sigma", "friction_spread", "margin",
    "margin_at_least", "grip_force", "grip_force_at_most",
    "grip_force_sigma",
)  # fmt: skip
KEPT = {
    "anchor": "anchor", "anchor_variance": "anchor_variance", "lag": "lag", "moved": "moved",
    "lag_variance": "variance", "moved_slow": "slow", "followed": "known", "gain_error": "gain",
    "followed_out": "known_out", "gain_information": "sure", "anchor_depth": "depth",
    "lag_mean": "lag_mean", "age_s": "age_s", "behind": "behind",
}  # fmt: skip
"""What the kernel keeps of each unit, and how the slow algebra calls it."""


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
        self.naive = NaiveSlip(self.position, self.rotation, settings)
        self.data = contact_data(self.n, 4, 0)
        units = self.data.units
        self.reading = SimpleNamespace(**{
            name: units[name].T
            for name in ("force", "force_sigma", "displacement", "displacement_sigma")
        })  # fmt: skip
        self.contacts = self.data.contacts
        self.now_ns, self.seen = 10_000_000_000, set()

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
        and hold the kernel against the slow algebra; the records."""
        reading, data = self.reading, self.data
        units = data.units
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
        self.naive.silent = (units["kind"] == UnitKind.BRIDGE) | (units["kind"] == UnitKind.SILENT)
        self.naive.leave((data.label < 0) & (units["kind"] == UnitKind.OUT))
        judged = [(r, m) for r, m in records if not r["flags"] & Flag.WEAK]
        told = self.naive.cycle(dt_s, self.now_ns, reading, judged)
        for (record, members), each in zip(judged, told, strict=True):
            compare(record, each)
            compare_units(data, self.naive, members)
        return [record for record, _ in records]

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


def compare(record, told):
    """Hold what the kernel says of a contact against what the slow algebra says."""
    is_unknown = bool(np.isnan(told.margin))
    told.margin_at_least, told.grip_force_at_most = (
        bounds(told, record["load"]) if is_unknown else (told.margin, told.grip_force)
    )  # fmt: skip
    grip_n = 1e-5 * told.safety * record["load"]
    for name in TOLD:
        # a pattern is the root of its odds, a probability has rounding of their logarithm, a margin
        # is one less a ratio near one, and a grip that ratio of the load
        least = {"pattern": 1e-4, "margin": 1e-5, "margin_at_least": 1e-5, "grip_force": grip_n,
                 "grip_force_at_most": grip_n}.get(name, 1e-8)  # fmt: skip
        share = {"slip_probability": 1e-4, "grip_force_sigma": 1e-5}.get(name, 1e-6)
        np.testing.assert_allclose(record[name], getattr(told, name), share, least, err_msg=name)
    np.testing.assert_allclose(record["rotation"], told.turn, 1e-6, 1e-9)
    lower = max(told.friction_lower, 0.0)
    np.testing.assert_allclose(record["friction_at_least"], lower, 1e-6, 1e-9)
    assert bool(record["flags"] & Flag.FEW_UNITS) == told.few
    assert bool(record["flags"] & Flag.NO_FRICTION) == is_unknown
    assert bool(record["flags"] & Flag.NOISY) == told.noisy


def bounds(told, load):
    """Margin at least, and grip force at most, where no slip was seen: what was borne is friction,
    and what holds is enough grip."""
    if told.slip >= SlipState.INCIPIENT:
        return 0.0, np.nan
    friction = max(told.friction_lower, 0.0)
    needed = min(told.used / friction if friction else 1.0, 1.0)  # of the load
    return 1.0 - needed, told.safety * load * needed


def compare_units(data, naive, members):
    """And what it keeps of the units."""
    kept, everybody, slow = data.slips, data.all[0], naive.kept
    close, mine = np.testing.assert_allclose, data.slips[members]
    np.testing.assert_array_equal(data.slip, slow["state"])
    np.testing.assert_array_equal(kept["began"], slow["began"])
    np.testing.assert_array_equal(mine["noisy"], slow["noisy"][members])
    for name, called in KEPT.items():
        close(mine[name].T, slow[called][..., members], 1e-5, 1e-8, err_msg=name)
    close(mine["noise_ratio"], slow["ratio"][members], 1e-8)
    close(mine["noise_sum"], slow["unit_lags"][0, members], 1e-6, 1e-9)
    close(mine["noise_count"], slow["unit_lags"][1, members], 1e-8, 1e-12)
    for name, called in (("lag", "lags"), ("reading", "readings"), ("step", "steps"),
                         ("recent", "recent_steps"), ("slow", "slow_lags")):  # fmt: skip
        total = name if name in ("recent", "slow") else f"{name}s"
        both = [everybody[total], everybody[f"{name}_count"]]
        close(both, getattr(naive, called), 1e-6, 1e-9 if name == "slow" else 1e-12)
    close(mine["slow_sum"], slow["slow_sum"][members], 1e-5, 1e-8)
    slid = [mine["slid_shear"], mine["slid_load"], mine["slid_variance"]]
    close(slid, slow["slid"][:, members], 1e-6, 1e-12)
    close(mine["borne"], slow["borne"][members], 1e-6, 1e-12)
