# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rivals sample by sample, in a world whose orientations are turns about one axis."""

from math import cos, inf, radians, sin, sqrt
from types import SimpleNamespace

import pytest
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.supervision.rivals import Rivals
from spm_haptic_master.supervision.sample import Place, Sample

MS = 1_000_000
BEGIN = 1000 * MS
SPEED = 20.0
ACCELERATION = 500.0
LIMIT = 0.02
PART = 0.01
SIGMA = radians(0.04)
# What noise and bias of the others do to a rival, rad: 5.3 deviations, and no bias.
HEALTHY = 5.3 * 1e-3
THRESHOLD = 7.0


def turned(angle):
    """Return the quaternion of a turn by rad."""
    return (0.0, 0.0, sin(0.5 * angle), cos(0.5 * angle))


def solution(angle, count=4):
    """Return a solution at a turn, rad, with a total deviation of 1e-3 rad."""
    return SimpleNamespace(
        angle=angle,
        quaternion=turned(angle),
        total_deviation=1e-3,
        covariance=(1e-6,) + 8 * (0.0,),
        sensors=SimpleNamespace(sigma=(SIGMA,) * count, weights=(1.0,) * count),
        gain_sizes=(0.0,) * count,
        parity_sizes=(0.0,) * count,
        determined=True,
    )


class World:
    """A device at a turn, and by sensor the turns at which all others agree."""

    def __init__(self, count=4, entries=1):
        self.count = count
        self.here = 0.0
        self.now = BEGIN
        self.part = [PART] * count
        # Other turns at which the sensors agree without one, and what it is off by there.
        self.others = {}
        self.fault = 0.5
        self.fault_deviation = 0.0
        self.readings = [0.1] * count
        self.factor = 1.0
        self.is_in_reach = True
        self.on_trial = {}
        self.searches = []
        # Curvatures of the parity, and the turns behind a fold from which others are looked for.
        self.bends = {}
        self.turns = []
        self.used = SimpleNamespace(
            parity_count=entries,
            members=tuple(range(count)),
            threshold=THRESHOLD,
            parts=lambda worth: list(self.part),
            worth=SimpleNamespace(healthy=0.0, slopes=(1.0,) * count),
            solver=SimpleNamespace(
                parity_curvature=lambda estimate, sensor: self.bends.get(sensor, 0.0),
                turned_by_fault=self.turned_by_fault,
                implied_fault=self.implied,
            ),
        )
        sensors = SimpleNamespace(
            used=self.used,
            is_trying=False,
            places_on_trial=lambda: self.on_trial,
            one_less=self.one_less,
        )
        self.sensors = sensors
        self.rivals = Rivals(sensors, count, SPEED, ACCELERATION)

    def implied(self, found, sensor, sample):
        if not self.is_in_reach:
            raise UnreachableError('leg')
        return SimpleNamespace(fault=self.fault, deviation=self.fault_deviation, bias=1e-3)

    def turned_by_fault(self, estimate, sensor, turn):
        self.turns.append(turn)
        return (turned(self.here + turn), turned(self.here - turn))

    def one_less(self, sensor):
        """Return the others: their solution next to an orientation is within 0.2 rad."""
        angles = [*self.others.get(sensor, ()), self.here]

        def near(sample, quaternion):
            angle = min(angles, key=lambda each: -abs(overlap(turned(each), quaternion)))
            is_near = overlap(turned(angle), quaternion) > cos(0.1)
            return solution(angle, self.count) if is_near else None

        def every(sample):
            self.searches.append(sensor)
            return [solution(angle, self.count) for angle in angles]

        return SimpleNamespace(near=near, every=every)

    def sample(self, after=1):
        self.now += round(after * MS)
        return Sample(
            stamp=self.now,
            angles=tuple(self.readings),
            prior=None,
            bias=(0.0,) * self.count,
            factors=(self.factor,) * self.count,
            period=1e-3,
        )

    def follow(self, here=None, after=1):
        """Follow a consistent sample, at a turn, rad; return the parts."""
        if here is not None:
            self.here = here
        self.used.estimate = SimpleNamespace(
            quaternion=turned(self.here), parity_sizes=(1e-9,) * self.count
        )
        parts = self.rivals.follow(self.sample(after), LIMIT)
        self.rivals.last = Place(self.now, turned(self.here))
        return parts

    def place(self, angle):
        return Place(self.now, turned(angle))


def overlap(one, other):
    """Return the cosine of half the turn between two quaternions."""
    return abs(sum(each * beside for each, beside in zip(one, other, strict=True)))


def known(count=4, entries=1, **others):
    """Return a world in which every rival has been found or is none."""
    world = World(count, entries)
    world.others = {int(name[1:]): angles for name, angles in others.items()}
    for _ in range(3 * count):
        world.follow()
    return world


def beyond(angle):
    """Return the part of a sensor with a rival at a turn, rad."""
    return pytest.approx(angle + HEALTHY, abs=1e-6)


# The start ------------------------------------------------------------------------------------


def test_at_the_start_a_rival_may_be_anywhere_until_all_solutions_are_known():
    """Of one sensor a sample, and thrice, as noise may hide a solution of three."""
    world = World()
    assert world.rivals.parts(world.place(0.0)) == [inf] * 4
    shown = [world.follow() for _ in range(12)]
    for number, parts in enumerate(shown, 1):
        found = number // 3
        assert parts == [PART] * found + [inf] * (4 - found)
    assert world.searches == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert world.rivals.unseen_steps == {}
    world.follow()
    assert len(world.searches) == 12


def test_the_best_fit_of_more_sensors_is_there_with_noise_as_well():
    world = World(5, 2)
    for number in range(1, 6):
        assert world.follow() == [PART] * number + [inf] * (5 - number)
    assert world.searches == [0, 1, 2, 3, 4]


def test_a_sensor_that_is_not_checked_waits_for_its_rivals():
    world = World()
    world.part[0] = inf
    for _ in range(3):
        world.follow()
    assert world.searches == [1, 1, 1]
    world.part[0] = PART
    world.follow()
    assert world.searches[3:] == [0]


def test_without_a_parity_nothing_is_bounded():
    world = known()
    world.used.parity_count = 0
    assert world.follow() == [inf] * 4
    assert world.rivals.unseen_steps == {}
    world.used.parity_count = 1
    assert world.follow() == [PART] * 4
    world.rivals.unseen_steps = {0: 1.0}
    world.used.estimate = None
    assert world.rivals.follow(world.sample(), LIMIT) == [inf] * 4
    assert world.rivals.unseen_steps == {}


# Found rivals ---------------------------------------------------------------------------------


def test_a_sensor_is_bounded_by_the_distance_of_its_rival():
    world = known(_2=(1.0,))
    parts = world.follow()
    assert parts[2] == beyond(1.0)
    assert [parts[sensor] for sensor in (0, 1, 3)] == [PART] * 3
    # A part that is larger without it counts.
    world.part[2] = 1.5
    assert world.follow()[2] == 1.5


def test_a_rival_counts_from_its_birth_on():
    world = World()
    world.others = {0: (1.0,)}
    world.follow()
    born = world.now
    for _ in range(20):
        world.follow()
    here = world.place(0.0)
    assert world.rivals.born_since(born - 1) == {0}
    assert world.rivals.born_since(born) == set()
    assert world.rivals.parts(here)[0] == beyond(1.0)
    assert world.rivals.parts(here, born - 1)[0] == beyond(1.0)
    assert world.rivals.parts(here, born)[0] == PART


@pytest.mark.parametrize(
    ('fault', 'deviation', 'factor', 'least'),
    [
        (0.5, 0.0, 1.0, 0.5 - 1e-3),
        (-0.5, 0.0, 1.0, 0.5 - 1e-3),
        # A whole turn of the reading is none.
        (0.5 + 6.283185307, 0.0, 1.0, 0.5 - 1e-3),
        (0.5, 0.01, 1.0, 0.5 - THRESHOLD * 0.01 - 1e-3),
        # With twice the noise.
        (0.5, 0.01, 2.0, 0.5 - THRESHOLD * 0.02 - 1e-3),
        (0.5, 0.1, 1.0, 0.0),
    ],
)
def test_a_step_may_lead_to_a_rival_from_half_its_least_size_on(fault, deviation, factor, least):
    world = World()
    world.factor = factor
    world.others = {1: (1.0,)}
    world.fault = fault
    world.fault_deviation = deviation
    for _ in range(20):
        world.follow()
    assert world.rivals.unseen_steps == {1: pytest.approx(0.5 * least)}
    # Of one that is hidden any step is unseen.
    world.part[3] = 1.01 * LIMIT
    world.part[2] = LIMIT
    world.follow()
    assert world.rivals.unseen_steps == {1: pytest.approx(0.5 * least), 3: 0.0}


def test_at_the_edge_of_a_legs_reach_any_step_may_lead_to_a_rival():
    world = known(_1=(1.0,))
    assert world.rivals.unseen_steps[1] > 0.2
    world.is_in_reach = False
    for step in range(1, 4):
        world.others = {1: (1.0 + 0.009 * step,)}
        world.follow(0.009 * step)
    assert world.rivals.unseen_steps == {1: 0.0}


def test_while_a_rival_is_lost_any_step_may_lead_to_it():
    world = World()
    world.follow()
    assert world.rivals.unseen_steps == dict.fromkeys(range(4), 0.0)


def test_a_rival_follows_the_motion_and_is_computed_after_two_hundredths_of_a_turn():
    """The turn since then adds to its distance."""
    world = known(_2=(1.0,))
    for here, distance in ((0.009, 1.0), (0.018, 1.0), (0.027, 1.027), (0.03, 1.027)):
        world.others = {2: (1.0 + 2.0 * here,)}
        assert world.follow(here)[2] == beyond(distance)


def test_a_rival_that_the_motion_contradicts_is_over():
    """Its fault is not constant, and its reading neither."""
    for fault, reading, is_over in ((0.6, 0.2, True), (0.6, 0.1, False), (0.5, 0.2, False)):
        world = known(_2=(1.0,))
        world.fault = fault
        world.readings[2] = reading
        for step in range(1, 5):
            here = 0.009 * step
            world.others = {2: (1.0 + here,)}
            part = world.follow(here)[2]
        assert (part == PART) == is_over


def test_a_rival_that_reaches_the_orientation_is_none():
    world = known(_2=(0.15,))
    assert world.follow()[2] == beyond(0.15)
    world.others = {2: (0.085,)}
    for step in range(1, 10):
        parts = world.follow(0.009 * step)
    assert parts[2] == PART


def test_a_rival_that_the_others_do_not_continue_is_lost_until_all_solutions_are_known():
    world = known(_2=(1.0,))
    world.others = {}
    searches = len(world.searches)
    shown = [world.follow(0.0099 * step)[2] for step in range(1, 11)]
    assert inf in shown
    assert shown[-1] == PART
    # At three places of the platform.
    assert world.searches[searches:] == [2, 2, 2]


def test_rivals_of_a_sensor_that_meet_are_one():
    world = known(_2=(1.0, 1.1))
    world.others = {2: (1.05,)}
    for step in range(1, 5):
        world.follow(0.009 * step)
    assert world.follow()[2] < 1.2


@pytest.mark.parametrize(
    ('fault', 'reading', 'is_over'),
    [
        # A constant offset from either of both, or a reading that sticks at either.
        (0.8, 0.3, False),
        (0.5, 0.3, False),
        (1.1, 0.2, False),
        (1.1, 0.1, False),
        (1.1, 0.3, True),
    ],
)
def test_where_two_rivals_meet_what_explains_either_explains_the_one_that_stays(
    fault, reading, is_over
):
    world = known(_2=(1.0,))
    world.fault = 0.8
    world.readings[2] = 0.2
    # A trial without its sensor is there.
    world.sensors.is_trying = True
    world.on_trial = {2: Place(world.now + MS, turned(1.0))}
    assert world.follow()[2] == beyond(1.0)
    world.sensors.is_trying = False
    world.on_trial = {}
    world.fault = fault
    world.readings[2] = reading
    for step in range(1, 4):
        parts = world.follow(0.009 * step)
    assert (parts[2] == PART) == is_over


def test_a_lost_rival_is_searched_for_again_once_the_platform_has_moved():
    world = known(_2=(1.0,))
    world.others = {}
    for step in range(1, 4):
        world.follow(0.009 * step)
    before = len(world.searches)
    for _ in range(5):
        assert world.follow()[2] == inf
    assert len(world.searches) == before


# Where the truth may have left ----------------------------------------------------------------


@pytest.mark.parametrize(('turn', 'is_lost'), [(0.0099, False), (0.0101, True)])
def test_a_fast_turn_may_have_left_the_truth_where_it_was(turn, is_lost):
    """The others still agree there as well."""
    world = known()
    world.others = {1: (0.0,)}
    # Parts are smaller than the turn here.
    world.part = [0.001] * 4
    parts = world.follow(turn)
    assert parts[1] == (beyond(turn) if is_lost else 0.001)
    assert parts[0] == 0.001
    # Behind no fold nothing is looked for.
    assert world.turns == []


@pytest.mark.parametrize(('gap', 'is_lost'), [(2.5, False), (2.6, True)])
def test_a_gap_may_have_left_the_truth_anywhere_in_reach(gap, is_lost):
    reach = SPEED * gap * 1e-3 + 6e-3
    for share, is_in_reach in ((0.99, True), (1.01, False)):
        world = known()
        world.others = {0: (share * reach,), 1: (2.0,)}
        for _ in range(20):
            parts = world.follow()
        assert parts == [PART] * 4
        shown = [world.follow(after=gap)]
        for _ in range(20):
            shown.append(world.follow())
        expected = beyond(share * reach) if is_lost and is_in_reach else PART
        assert shown[-1][0] == expected
        # The others are searched for later, and wait.
        assert (shown[0][1] == inf) == is_lost
        assert shown[-1][1] == PART


def test_behind_a_gap_a_rival_may_be_anywhere_in_reach_of_where_it_was():
    world = known(_2=(1.0,))
    world.others = {2: (1.05, 1.3)}
    assert world.follow(after=20)[2] == inf
    for _ in range(20):
        parts = world.follow()
    assert parts[2] == beyond(1.3)


def test_that_reach_is_from_the_last_sample_before_the_gap():
    """Not from when the rival was computed last."""
    world = known(_2=(1.0,))
    for _ in range(40):
        world.follow()
    world.others = {2: (1.5,)}
    shown = [world.follow(after=20)[2] for _ in range(3)]
    shown += [world.follow()[2] for _ in range(10)]
    assert shown == [inf] * 13


@pytest.mark.parametrize(
    ('turn', 'part', 'is_lost'),
    [
        (0.019, 1.01 * LIMIT, False),
        (0.021, 1.01 * LIMIT, True),
        (0.021, LIMIT, False),
    ],
)
def test_a_sensor_that_was_hidden_while_the_platform_turned_may_have_a_rival(turn, part, is_lost):
    world = known()
    hidden_from = world.now
    world.part[1:3] = [part, inf]
    for step in range(1, 6):
        world.follow(0.2 * step * turn)
    # If it is wrong, the truth may be where it became hidden.
    place = world.rivals.place_without(1)
    assert place.stamp == (hidden_from if is_lost else world.now)
    world.others = {1: (0.15,)}
    world.part[1] = PART
    for _ in range(10):
        parts = world.follow()
    assert parts[1] == (beyond(0.15 - turn) if is_lost else PART)


def test_where_a_rival_is_the_truth_without_its_sensor_is_not_known():
    world = known(_2=(1.0,))
    assert world.rivals.place_without(2) is None
    assert world.rivals.place_without(1) == world.place(0.0)
    world.rivals.restart()
    assert world.rivals.place_without(1) is None


def test_through_samples_that_are_not_consistent_a_rival_goes_on_without_its_sensor():
    world = known(_2=(1.0,))
    world.others = {2: (1.1,)}
    world.rivals.follow_inconsistent(world.sample())
    assert world.rivals.parts(world.place(0.0))[2] == beyond(1.1)
    world.others = {}
    world.rivals.follow_inconsistent(world.sample())
    assert world.rivals.parts(world.place(0.0))[2] == inf


@pytest.mark.parametrize(('places', 'is_anywhere'), [(4, False), (5, True)])
def test_with_more_than_four_places_the_truth_may_be_anywhere(places, is_anywhere):
    world = known(_3=(1.0,))
    for step in range(1, places + 1):
        world.part[1] = inf
        world.follow(0.05 * step)
    world.part[1] = PART
    world.others = {1: (2.0,)}
    before = len(world.searches)
    for _ in range(30):
        parts = world.follow()
    assert parts[1] == (beyond(2.0 - 0.05 * places) if is_anywhere else PART)
    assert parts[3] == beyond(1.0 - 0.05 * places)
    # It is searched for thrice then, as at the start.
    assert world.searches[before:] == ([1, 1, 1] if is_anywhere else [1])


def test_with_other_sensors_those_with_rivals_may_have_more():
    world = known(_2=(1.0,), _3=(1.0,))
    world.used.members = (0, 1, 2)
    world.others = {2: (1.0, 2.0), 1: (2.0,)}
    for _ in range(20):
        parts = world.follow()
    assert parts[:2] == [PART] * 2
    assert parts[2] == beyond(2.0)
    # The sensor that is not in use has none.
    assert parts[3] == PART


def test_what_was_hidden_stays_so_while_another_is_not_in_use():
    world = known()
    world.part[1] = 1.01 * LIMIT
    world.follow(0.009)
    world.follow(0.018)
    world.used.members = (0, 1, 2)
    world.follow(0.027)
    world.part[1] = PART
    world.others = {1: (0.08,)}
    for _ in range(10):
        parts = world.follow()
    assert parts[1] == beyond(0.08 - 0.027)


@pytest.mark.parametrize(('turn', 'is_lost'), [(0.012, False), (0.013, True)])
def test_near_a_fold_a_quarter_of_the_way_to_its_other_side_counts(turn, is_lost):
    world = World()
    world.bends = {1: 20.0}
    for _ in range(12):
        world.follow()
    world.part[1] = 1.01 * LIMIT
    for step in range(1, 5):
        world.follow(0.25 * step * turn)
    world.part[1] = PART
    world.others = {1: (0.09,)}
    for _ in range(10):
        parts = world.follow()
    assert (parts[1] > 0.05) == is_lost


def test_what_was_hidden_while_it_was_not_in_use_is_forgotten():
    world = known()
    world.part[3] = 1.01 * LIMIT
    world.follow()
    world.used.members = (0, 1, 2)
    for step in range(1, 6):
        world.follow(0.009 * step)
    world.part[3] = PART
    world.used.members = (0, 1, 2, 3)
    world.others = {3: (0.15,)}
    for _ in range(10):
        assert world.follow() == [PART] * 4


def test_once_three_sensors_were_in_use_there_may_be_more_rivals():
    world = known(_2=(1.0,))
    world.used.parity_count = 0
    world.follow()
    world.used.parity_count = 1
    assert world.follow() == [PART, PART, inf, PART]


@pytest.mark.parametrize('restarts', [True, False])
def test_curvatures_are_those_of_the_sensors_in_use(restarts):
    """And none from before a restart."""
    world = World(5, 2)
    for _ in range(6):
        world.follow()
    world.bends = dict.fromkeys(range(5), 20.0)
    assert world.follow() == [PART] * 5
    if restarts:
        world.rivals.restart()
    else:
        world.used.members = (0, 1, 2, 3)
    for _ in range(6):
        parts = world.follow()
    # Of e - 20 e^2 = 0.01 the smaller solution.
    assert parts[:4] == [pytest.approx((1.0 - sqrt(1.0 - 0.8)) / 40.0)] * 4


def test_a_restart_knows_nothing():
    world = known(_2=(1.0,))
    world.rivals.restart()
    assert world.rivals.last is None
    assert world.follow() == [inf] * 4


def test_bad_samples_are_no_gap_for_a_rival():
    world = known(_2=(1.0,))
    for _ in range(10):
        world.rivals.follow_inconsistent(world.sample())
    # The others have taken over.
    world.rivals.last = world.place(0.0)
    before = len(world.searches)
    assert world.follow()[2] == beyond(1.0)
    assert len(world.searches) == before


# Trials ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('angle', 'part'),
    [
        # Within part and limit it is the orientation itself.
        (0.0095, PART),
        (0.0105, beyond(0.0105)),
    ],
)
def test_a_trial_says_where_the_truth_without_its_sensor_is(angle, part):
    world = known()
    world.sensors.is_trying = True
    world.others = {1: (angle,)}
    world.on_trial = {1: Place(world.now + MS, turned(angle))}
    assert world.follow()[1] == part


@pytest.mark.parametrize(('angle', 'is_lost'), [(0.016, False), (0.0175, True)])
def test_a_trial_behind_the_fold_of_its_sensor_is_another_orientation(angle, is_lost):
    """That is half way to its other side; the part may cover it, and shrink later."""
    world = World()
    world.bends = {1: 30.0}
    world.part[1] = 1e-6
    for _ in range(12):
        world.follow()
    world.part[1] = 0.01
    world.sensors.is_trying = True
    world.on_trial = {1: Place(world.now + MS, turned(angle))}
    assert world.follow()[1] == inf
    world.sensors.is_trying = False
    world.on_trial = {}
    world.part[1] = 1e-6
    world.others = {1: (angle,)}
    for _ in range(5):
        parts = world.follow()
    assert (parts[1] > angle) == is_lost


@pytest.mark.parametrize(('milliseconds', 'searches'), [(3, 1), (5, 3)])
def test_where_a_trial_was_before_is_a_place_that_the_truth_may_have_left(milliseconds, searches):
    """It is searched for once where a human can have turned the platform by 0.1 rad since."""
    world = known()
    before = len(world.searches)
    world.sensors.is_trying = True
    world.on_trial = {1: Place(world.now - milliseconds * MS, turned(0.0))}
    shown = [world.follow()[1] for _ in range(5)]
    assert shown == [inf] * (searches - 1) + [PART] * (6 - searches)
    # The same place counts once.
    assert world.searches[before:] == [1] * searches
    # When no trial is left it is not asked for.
    world.on_trial = {1: Place(world.now - milliseconds * MS, turned(0.0))}
    world.sensors.is_trying = False
    world.follow()
    assert world.searches[before:] == [1] * searches


# Folds ----------------------------------------------------------------------------------------


def bent(expected, count=20):
    """Return a world at rest with a fold of sensor 1 behind which a turn (rad) may lead."""
    world = World()
    world.part = [1e-6] * 4
    world.bends = {1: 0.7 / expected}
    for _ in range(count):
        world.follow()
    return world


def looked_for(expected):
    """Return the turns, rad, at which a truth so far away is looked for."""
    return pytest.approx([0.6 * expected, 1.5 * expected], rel=1e-3)


def test_at_rest_the_truth_is_as_far_as_a_human_accelerates_the_platform():
    at_rest = ACCELERATION * 1e-6
    assert bent(at_rest).turns[-2:] == looked_for(at_rest)
    # To the other side of the fold if that is nearer.
    assert bent(0.6 * at_rest).turns[-2:] == looked_for(0.6 * at_rest / 0.7)


def test_in_motion_it_is_as_far_as_the_platform_went_on_the_other_way():
    expected = 0.005 + 0.005 + ACCELERATION * 1e-6
    world = bent(expected)
    world.turns.clear()
    for step in range(1, 4):
        world.follow(0.005 * step)
    assert world.turns[-2:] == looked_for(expected)
    # Where the orientation turns faster than the platform did before, by as much.
    expected = 2.0 * 0.009
    world = bent(expected)
    world.turns.clear()
    world.follow(0.009)
    assert world.turns == looked_for(expected)


def test_where_the_orientation_stops_the_truth_may_have_gone_on():
    expected = 0.005 + ACCELERATION * 1e-6
    world = bent(expected)
    for step in range(1, 4):
        world.follow(0.005 * step)
    world.turns.clear()
    world.follow()
    assert world.turns == looked_for(expected)
    world.turns.clear()
    world.follow()
    assert world.turns == []


def test_the_same_sample_taken_twice_is_no_stop():
    expected = 0.005 + ACCELERATION * 1e-6
    world = bent(expected)
    for step in range(1, 4):
        world.follow(0.005 * step)
    world.follow(after=0)
    world.turns.clear()
    world.follow()
    assert world.turns == looked_for(expected)


@pytest.mark.parametrize(('gap', 'speed'), [(10, 5.0), (60, 20.0)])
def test_behind_a_gap_it_is_about_the_latest_sample_of_a_trial(gap, speed):
    step = 2.5e-3
    expected = speed * step + ACCELERATION * step**2
    world = bent(expected)
    world.sensors.is_trying = True
    world.on_trial = {1: Place(world.now + gap * MS, turned(0.0))}
    world.turns.clear()
    world.follow(after=gap)
    assert world.turns == looked_for(expected)


def test_after_a_restart_the_platform_may_be_as_fast_as_a_human():
    expected = SPEED * 1e-3 + ACCELERATION * 1e-6
    world = World(5, 2)
    world.part = [1e-6] * 5
    world.bends = {0: 0.7 / expected}
    for _ in range(2):
        world.turns.clear()
        world.follow()
        assert world.turns == []
        world.follow()
        assert world.turns == looked_for(expected)
        world.rivals.restart()


def test_a_sensor_that_is_not_checked_has_no_fold_behind_which_it_is_lost():
    world = bent(ACCELERATION * 1e-6)
    world.part[3] = inf
    for _ in range(6):
        world.follow()
    world.part[3] = PART
    world.others = {3: (2.0,)}
    for _ in range(30):
        parts = world.follow()
    assert parts[3] == PART
