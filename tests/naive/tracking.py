"""Slow and obvious identities of contacts: sets and dictionaries, from the rules in words."""

from dataclasses import dataclass, field

import numpy as np

from skin.contact.record import Event, TrackState

BEHIND = 0.25
"""Worth of the load of a contact that another speaks for."""
BESIDE = 1e-3
"""Worth of the load of a unit beside one that a contact once owned."""


@dataclass
class Known:
    """One identity."""

    id: int
    born: int
    seen: int
    parent: int = 0
    cycles: int = 0
    event: Event = Event.BORN
    track: TrackState = TrackState.PRESENT
    into: "Known | None" = None
    units: list = field(default_factory=list)


class NaiveTracker:
    """Contacts of units with neighbours, `capacity` at most, times in nanoseconds.

    `beside[i]` lists the neighbours of unit i. Twice as many identities as `capacity` are known.
    """

    def __init__(self, beside, capacity, memory, finish_records):
        self.beside, self.capacity = beside, capacity
        self.memory, self.finish_records = memory, finish_records
        self.known = [None] * (2 * capacity)
        self.owner = {}
        self.touching = set()
        self.last_id = self.untracked = 0
        self.present, self.ended = [], []

    def see(self, level, now, start_sigma, keep_sigma):
        """Take loads in sigmas, NaN where a unit is silent."""
        clusters = self.clusters(level, start_sigma, keep_sigma)
        self.ended, self.untracked = [], max(0, len(clusters) - self.capacity)
        if not clusters and not self.present:
            self.touching = set()
            return
        touching = {i for opened, bridges in clusters for i in (*opened, *bridges)}
        weight = sorted((-sum(level[i] for i in opened) for opened, _ in clusters))[: self.capacity]
        clusters = [c for c in clusters if -sum(level[i] for i in c[0]) in weight]
        self.match([opened for opened, _ in clusters], level, now)
        self.touching = touching
        self.present = sorted(
            (one for one in self.known if one and one.track == TrackState.PRESENT),
            key=lambda one: one.id,
        )

    def clusters(self, level, start_sigma, keep_sigma):
        """Loaded units that hang together, and silent ones among them."""
        silent = np.isnan(level)
        opened = {i for i in range(level.size) if level[i] > keep_sigma}
        conducts = opened | {i for i in self.touching if silent[i]}
        found, seen = [], set()
        for first in sorted(opened):
            if first in seen:
                continue
            reached = [first]
            for i in reached:
                reached += [j for j in self.beside[i] if j in conducts and j not in reached]
            seen |= set(reached)
            loaded = [i for i in reached if i in opened]
            if any(i in self.touching or level[i] > start_sigma for i in loaded):
                found.append((loaded, [i for i in reached if i not in opened]))
        return found

    def match(self, clusters, level, now):
        """Give each cluster an identity."""
        for one in filter(None, self.known):
            one.event = Event.NONE
            if one.track == TrackState.LOST and now - one.seen > self.memory:
                self.forget(one)
        shared = {}
        for k, units in enumerate(clusters):
            for i in units:
                if i in self.touching and self.owner.get(i):
                    key = k, self.owner[i].id
                    shared[key] = shared.get(key, 0.0) + level[i]
        given = {}
        self.assign(clusters, given, shared, {TrackState.PRESENT: 1.0, TrackState.ABSORBED: BEHIND})
        self.claim(clusters, given, shared, level, now)
        self.end(given, shared, now)
        for k, one in given.items():
            if one.track in (TrackState.LOST, TrackState.ABSORBED):
                one.event |= Event.RESUMED
            one.track, one.into, one.seen, one.units = TrackState.PRESENT, None, now, clusters[k]
            one.cycles += 1
        for k in range(len(clusters)):
            self.own(given[k], level)

    def assign(self, clusters, given, shared, worth):
        """The largest shared load first, each cluster and each identity once."""
        while True:
            free = [
                (worth[one.track] * shared.get((k, one.id), 0.0), -at, -k)
                for at, one in enumerate(self.known)
                if one and one.track in worth and one not in given.values()
                for k in range(len(clusters))
                if k not in given
            ]
            most = max(free, default=(0.0, 0, 0))
            if not most[0] > 0.0:
                return
            given[-most[2]] = self.known[-most[1]]

    def claim(self, clusters, given, shared, level, now):
        """Parts of a contact that went on elsewhere are new; others may be one that is away, or
        one that has moved."""
        parents, nearby = {}, {}
        for k, units in enumerate(clusters):
            if k in given:
                continue
            parent = max(given.values(), key=lambda one: shared.get((k, one.id), 0.0), default=None)
            if parent and shared.get((k, parent.id), 0.0) > 0.0:
                parents[k] = parent
                parent.event |= Event.SPLIT
                continue
            for i in units:
                for j, worth in [(i, 1.0), *((j, BESIDE) for j in self.beside[i])]:
                    if self.owner.get(j):
                        key = k, self.owner[j].id
                        nearby[key] = nearby.get(key, 0.0) + worth * level[i]
        self.assign(clusters, given, nearby, {TrackState.LOST: 1.0, TrackState.PRESENT: 1.0})
        for k in range(len(clusters)):
            if k in given:
                continue
            if None not in self.known:
                away = [
                    one for one in self.known
                    if one.track != TrackState.PRESENT and one not in given.values()
                ]  # fmt: skip
                self.forget(min(away, key=lambda one: one.seen))
            self.last_id += 1
            parent = parents[k].id if k in parents else 0
            given[k] = Known(self.last_id, now, now, parent)
            self.known[self.known.index(None)] = given[k]

    def end(self, given, shared, now):
        """Who has no cluster of its own is lost, or absorbed by who took its units."""
        for one in list(filter(None, self.known)):
            if one in given.values() or one.track == TrackState.LOST:
                continue
            takers = [k for k in given if shared.get((k, one.id), 0.0) > 0.0]
            if not takers:
                self.ended.append(one.id)
                one.track, one.into = TrackState.LOST, None
                continue
            one.into = given[max(takers, key=lambda k: shared[k, one.id])]
            if one.track == TrackState.PRESENT:
                if one.into.track == TrackState.PRESENT:
                    one.into.event |= Event.MERGED
                one.track = TrackState.ABSORBED
                if one.seen - one.born < self.finish_records:
                    self.forget(one)
            one.seen = now

    def forget(self, one):
        self.known[self.known.index(one)] = None
        self.owner = {i: other for i, other in self.owner.items() if other is not one}

    def own(self, one, level):
        """Units become the contact's, but for those of whom it has absorbed; a new unit is whose
        heaviest neighbour is."""
        family = [one] + [
            other for other in self.known
            if other and other.track == TrackState.ABSORBED and other.into is one
        ]  # fmt: skip
        for i in one.units:
            if len(family) == 1:
                self.owner[i] = one
            elif self.owner.get(i) not in family:
                near = [j for j in self.beside[i] if j in one.units and self.owner.get(j) in family]
                self.owner[i] = self.owner[max(near, key=lambda j: level[j])] if near else one
