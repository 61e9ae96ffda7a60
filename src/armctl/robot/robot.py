"""What an arm is: joints, limits, geometry, masses, servo map and named poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import ArrayRecord, FloatArray, content, lock, read_only
from armctl.errors import InputError, MotionRefusedError
from armctl.facts import AngleLimit, Reason, Several, UnknownName, WrongUnit, say
from armctl.kinematics import (
    DEFAULT_STEP,
    BatchSolutions,
    Branch,
    BranchFinder,
    Chain,
    Criterion,
    EnergyModel,
    GravityModel,
    InverseKinematics,
    Solutions,
    Target,
    inverse_kinematics,
)
from armctl.kinematics.frames import LinkFrames
from armctl.kinematics.target import seem_degrees
from armctl.kinematics.velocity import position_is_held, position_leaves_orientation
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.arm_body import ANY_OPENING, BODY_ASSUMED, ArmBody, Capsule, CarriedPart, Openings
from armctl.robot.body.bodies import Bodies, Underside, body_of_shapes, kept_body_of_shapes, leave_room
from armctl.robot.body.collision import CollisionModel
from armctl.robot.look.pieces import Drawing, Piece
from armctl.robot.outputs import DEFAULT_BOARD, OutputMap
from armctl.robot.parts import Gripper, Joint, Look, Obstacle, Shape, beyond_limits, read_values, shown_values
from armctl.robot.signals import NO_SIGNALS, Signals
from armctl.robot.tools import Tool, own_gripper, tool_of, with_tool


@dataclass(frozen=True, eq=False, repr=False)
class Robot(ArrayRecord):
    """One arm: joints, frames, limits, poses. Immutable, comparable, safe to use from several threads."""

    name: str
    title: str
    source: str
    assumed: tuple[str, ...]
    joints: tuple[Joint, ...]
    chain: Chain
    poses: Mapping[str, FloatArray]
    """named configurations (n,) [rad]"""
    output_map: OutputMap | None
    """what a board is told for which angle; None: the robot file does not say"""
    gripper: Gripper | None
    gravity: GravityModel
    floor_z: float
    """height of the floor in the base frame [m]"""
    points: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """named tool points (3,) in the base frame [m]"""
    look: Look = field(default_factory=Look)
    capsules: tuple[Capsule, ...] | None = None
    """its body; None: the solids of its look, or hulls of its shapes"""
    obstacles: tuple[Obstacle, ...] = ()
    """what the arm must stay out of, besides the floor"""
    shapes: tuple[Shape, ...] = ()
    """its links as they are drawn; links without one, and an arm without any, as its look says"""
    board: str = DEFAULT_BOARD
    """the kind of board that drives it"""
    board_settings: object = None
    """what else the robot file tells the board's driver; only the board reads it"""
    no_board: str = ""
    """in few words, why no board drives it, as its file says; it counts for an arm without outputs"""
    left_out: tuple[str, ...] = ()
    """joints of its file that move and are none of the arm's, by their names there"""
    named_links: tuple[tuple[str, str], ...] = ()
    """name and title of each link of a parallel linkage; empty: those of its joint"""
    openings: Openings = ANY_OPENING
    """between which its gripper is while it moves: the jaws of its look count where they are then"""
    criterion: Criterion = "least-travel"
    """by which the page chooses among solutions at first"""
    signals: Signals = NO_SIGNALS
    """inputs and outputs of its board beside the joints"""
    part: CarriedPart | None = None
    """what its gripper carries while it moves, kept apart like a piece of the last link; None: nothing"""
    tools: tuple[Tool, ...] = ()
    """what can be put on at its flange; the first one is on where nobody says another"""
    tool: str = ""
    """name of the one that is on (``with_tool``); empty: none, and the tool point is at the flange"""
    flange: Robot | None = None
    """the same arm without its tool; None: it has none on"""
    limits: FloatArray = field(init=False)
    """(n, 2) lower and upper joint limits [rad]"""
    speed_limits: FloatArray = field(init=False)
    """(n,) largest joint speeds [rad/s]"""
    acceleration_limits: FloatArray = field(init=False)
    """(n,) largest joint accelerations [rad/s²]"""
    jerk_limits: FloatArray = field(init=False)
    """(n,) largest joint jerks [rad/s³]"""

    def __post_init__(self) -> None:
        super().__post_init__()
        both = [[joint.lower, joint.upper] for joint in self.joints]
        object.__setattr__(self, "limits", read_only(both))
        for name in ("speed", "acceleration", "jerk"):
            values = [getattr(joint, name) for joint in self.joints]
            object.__setattr__(self, f"{name}_limits", read_only(values))

    def __hash__(self) -> int:
        return hash((self.name, self.chain, content(self.limits)))  # a board's settings need not have one

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.n} joints)"

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, from the base to the tool."""
        return tuple(joint.name for joint in self.joints)

    @property
    def link_titles(self) -> tuple[str, ...]:
        """What each link is called after, from the base to the tool."""
        return tuple(title for _, title in self.named_links) or tuple(self._titles)

    @property
    def link_names(self) -> tuple[str, ...]:
        """What robot files call each link, from the base to the tool: after its joint, or by its own name."""
        return tuple(name for name, _ in self.named_links) or self.joint_names

    @property
    def resting(self) -> list[FloatArray]:
        """The home and the rest pose (n,) [rad], as far as there are: what touches there may do so."""
        return [self.poses[name] for name in ("home", "rest") if name in self.poses]

    @property
    def _titles(self) -> list[str]:
        return [joint.title for joint in self.joints]

    @cached_property
    def inverse_kinematics(self) -> InverseKinematics:
        """The solver of the arm's family."""
        return inverse_kinematics(self.chain, self.limits, self.energy, self._titles)

    @cached_property
    def energy(self) -> EnergyModel:
        """What the energy criteria need to know of this arm."""
        stall = [joint.stall_torque for joint in self.joints]
        torque = None if None in stall else np.array(stall, dtype=np.float64)
        return EnergyModel(self.speed_limits, self.acceleration_limits, self.gravity, torque)

    @property
    def drawing(self) -> Drawing:
        """The arm as it stands while its look is described."""
        return self.drawn.drawing

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """What its look says, or one that is guessed: to draw and to keep apart, of links without shapes."""
        return self.drawn.pieces

    @property
    def body_is_guessed(self) -> bool:
        """Whether nothing says what its body is like: it has no look, no capsules and no shapes."""
        arm = self.flange or self
        return not arm.look.rows and arm.capsules is None and not arm.shapes

    @cached_property
    def drawn(self) -> Bodies:
        """Its bodies; of an arm with shapes, what is drawn where a link has none."""
        names, look, resting = self.link_names, self.whole_look, np.array(self.resting).reshape(-1, self.n)
        body = self.link_titles, look, self.capsules, self.limits, resting, self.obstacles
        return Bodies(self.chain, names, *body).shared()

    @cached_property
    def bodies(self) -> Bodies:
        """Its body at each opening of the gripper; reading the files of shapes may take seconds."""
        return self.with_body().drawn

    @cached_property
    def whole_look(self) -> Look:
        """Its look; one that is guessed from its lengths where it has none."""
        if self.look.rows:
            return self.look
        from armctl.robot.look_guess import guessed_look

        stands = "home" in self.poses and not self.shapes  # else it is for links without shapes alone
        where = (self.pose("home"), self.floor_z) if stands else (self.limits.mean(axis=1), -np.inf)
        turning, opens = self.limits[:, 0] < self.limits[:, 1], self.gripper is not None
        return guessed_look(self.chain, self.link_names, turning.tolist(), *where, self.look, opens=opens)

    @cached_property
    def body(self) -> ArmBody:
        """What is kept apart: capsules of the file, hulls of its shapes, or the solids of its look."""
        return self.bodies.at(ANY_OPENING)

    def with_body(self, progress: Callable[[int, int], None] | None = None) -> Robot:
        """The same arm with its body worked out, once for all that is made of it, and its ``assumed``.

        Reading the files of shapes takes seconds, the first time. ``progress``: how many of how many links.
        """
        if not self.shapes or self.capsules is not None:
            return self
        if self.flange is not None:
            return self.flange.with_body(progress).with_tool(self.tool).carrying(self.part)
        return self._with(body_of_shapes(self.drawn, self.shapes, progress))

    def with_known_body(self) -> Robot | None:
        """The same, where it takes no time, because the body is kept; else None."""
        if not self.shapes or self.capsules is not None:
            return self
        known = kept_body_of_shapes((self.flange or self).drawn, self.shapes)
        return None if known is None else self.with_body()

    def _with(self, body: ArmBody) -> Robot:
        assumed = tuple(text for text in self.assumed if text != BODY_ASSUMED)
        shapes = tuple(shape for k, shape in enumerate(self.shapes) if k not in body.unused)
        return replace(self, capsules=body.capsules, assumed=(*assumed, *body.notes), shapes=shapes)

    def gripping(self, *openings: float | None) -> Robot:
        """The same arm while its gripper is at an opening 0..1 (to 0.01), or between some; None: at any."""
        key = ANY_OPENING
        if None not in openings and openings:
            rounded = [round(min(max(one or 0.0, 0.0), 1.0), 2) for one in openings]
            key = min(rounded), max(rounded)
        return self if self.shapes or not self.bodies.opens else self._holding(key, self.part)

    def carrying(self, part: CarriedPart | None) -> Robot:
        """The same arm while it carries a part; None: nothing. It shares all that was worked out."""
        return self._holding(self.openings, part)

    def allows_for(self, held: Robot) -> bool:
        """Whether what is clear of it is clear of ``held``: the same arm, tool and part, jaws no farther."""
        (low, high), (closed, opened) = self.openings, held.openings
        return (self.tool, self.part) == (held.tool, held.part) and low <= closed and opened <= high

    def with_tool(self, name: str) -> Robot:
        """The same arm with that of its tools on, jaws anywhere, nothing carried; ``InputError``: no such."""
        if name == self.tool:
            return self
        if self.flange is not None:
            return self.flange.with_tool(name)
        if name not in (known := self._with_tools):
            on = with_tool(self, self.whole_look, tool_of(self.tools, name))
            known[name] = replace(self, tool=name, flange=self, **on._asdict())
        return known[name]

    @cached_property
    def _with_tools(self) -> dict[str, Robot]:
        return {}

    def _holding(self, openings: Openings, part: CarriedPart | None) -> Robot:
        if (openings, part) == (self.openings, self.part):
            return self
        if (found := (known := self._held).get(key := (openings, part))) is not None:
            return found
        _ = self.inverse_kinematics, self.bodies  # all of them share these
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__, openings=openings, part=part)
        leave_room(known)
        return known.setdefault(key, twin)

    @cached_property
    def _held(self) -> dict[tuple[Openings, CarriedPart | None], Robot]:
        return {}

    @property
    def collision(self) -> CollisionModel:
        """The pieces of the arm's body and what it carries, and which of them are kept apart."""
        return self.bodies.collision(self.openings, self.part)

    @property
    def undersides(self) -> tuple[Underside, ...]:
        """What comes nearest to the floor, from the base to the tool; without what no joint lifts."""
        return self.bodies.undersides(self.openings, self.part)

    def body_frames(self, q: ArrayLike) -> LinkFrames:
        """Where the links are at ``q`` (m, n) [rad] and, behind them, cranks and rods that move with two."""
        return self.collision.frames(q)

    @cached_property
    def always_singular(self) -> bool:
        """Whether the tool point is held to a line or a plane, so that no pose is special."""
        return position_is_held(self.chain, self.limits)

    @cached_property
    def orients_tool(self) -> bool:
        """Whether the tool can be turned every way while its point stays, as six joints or more let it."""
        return position_leaves_orientation(self.chain, self.limits)

    def forward(self, q: ArrayLike) -> FloatArray:
        """Pose of the tool: ``q`` (..., n) [rad] -> ``T_base_tool`` (..., 4, 4), metres."""
        return self.chain.forward(q)

    def frames(self, q: ArrayLike) -> FloatArray:
        """Poses of the base and of the frame behind each DH row: (..., rows + 1, 4, 4), metres."""
        return self.chain.frames(q)

    def jacobian(self, q: ArrayLike) -> FloatArray:
        """Geometric Jacobian (..., 6, n), linear over angular, base frame."""
        return self.chain.jacobian(q)

    def inverse(
        self,
        position_m: ArrayLike,
        pitch: float | None = None,
        roll: float | None = None,
        rotation: ArrayLike | None = None,
        step: float = DEFAULT_STEP,
        start: ArrayLike | None = None,
        *,
        quaternion_wxyz: ArrayLike | None = None,
    ) -> Solutions:
        """All configurations inside the limits that put the tool there.

        Where there is none, ``reason`` of the answer says why, and ``nearest_m`` is the nearest in reach.

        Args:
            position_m: (3,) tool point in the base frame [m]; or the whole pose ``T_base_tool`` (4, 4).
            pitch: angle of the tool's approach axis (tool z) above the horizontal [rad]; None: any. For an
                arm of the family *yaw, parallel pitch joints, roll* the horizontal is the plane across its
                base axis, however the arm is mounted; for others it is the base frame's x-y plane.
            roll: angle of the tool about its approach axis [rad]: the roll joint's own angle.
            rotation: (3, 3) ``R_base_tool`` instead of pitch and roll.
            quaternion_wxyz: (4,) the same as a quaternion of any length, w first (ROS and scipy put it last).
            step: step of the swept free joint [rad], where one is free.
            start: (n,) where the arm stands [rad]; a numeric search begins there.
        """
        begin = None if start is None else self.chain.checked_one(start)
        target = Target.of(position_m, pitch, roll, rotation, quaternion_wxyz)
        return self.inverse_kinematics.solve(target, step, begin)

    def branches(
        self,
        position_m: ArrayLike,
        pitch: float | None = None,
        roll: float | None = None,
        rotation: ArrayLike | None = None,
        *,
        quaternion_wxyz: ArrayLike | None = None,
    ) -> tuple[Branch, ...]:
        """Every branch of a target (as for ``inverse``), with a reason where joint limits forbid it.

        Empty where the links do not reach, and where a joint is free, so that there is a continuum.
        """
        return self._branch_finder.find(Target.of(position_m, pitch, roll, rotation, quaternion_wxyz))

    def turned_off(self, solutions: Solutions, q: FloatArray) -> str | None:
        """How ``q`` (n,) of some solutions misses the rotation asked for, and why; None where it does not."""
        return None if (why := self.off_rotation(solutions, q)) is None else say(why)

    def off_rotation(self, solutions: Solutions, q: FloatArray) -> Reason | None:
        """The same as data."""
        off = solutions.off_rotation(q)
        why = None if off is None else self._branch_finder.forbids(solutions.target)
        return off if off is None or why is None else Several((off, why))

    @cached_property
    def _branch_finder(self) -> BranchFinder:
        return BranchFinder(self.chain, self.limits, self.energy, self._titles)

    def inverse_batch(
        self,
        position_m: ArrayLike,
        pitch: ArrayLike | None = None,
        roll: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
    ) -> BatchSolutions:
        """Every branch of many poses at once: a column a branch, as ``inverse`` lists them one by one.

        A pitch within ±90° is met by a tool that points outward and by one that points back at the base
        (``tool-in``). A joint that may turn more than once has the image nearest to zero; a branch with a
        free joint is given at one of its places. ``InputError``: a row is not finite, or the arm's family
        has no such answer.

        ``position_m`` (k, 3) tool points, base frame [m]; the others as of ``inverse``, (k,) or one for all:
        ``pitch`` [rad], needed with three pitch joints and left out with two; ``roll`` [rad], None: the one
        nearest to zero; ``rotation`` (k, 3, 3) instead, for a spherical wrist.
        """
        return self.inverse_kinematics.solve_batch(position_m, pitch, roll, rotation)

    def least_rotation(self, position_m: ArrayLike) -> FloatArray:
        """The configuration of least Σ|θ| for one point or each of many, exact over the continuum.

        ``position_m``: (3,) or (k, 3) tool points in the base frame [m]; the answer: (n,) or (k, n) [rad],
        the roll joint nearest to zero, a row of NaN where a point is out of reach (``inverse`` says why).
        """
        return self.inverse_kinematics.least_rotation(position_m)

    def pose(self, name: str) -> FloatArray:
        """A named configuration (n,) [rad]; ``InputError`` where there is none of that name."""
        return self._named("pose", name, self.poses)

    def _named(self, what: str, name: str, known: Mapping[str, FloatArray]) -> FloatArray:
        if not isinstance(name, str) or name not in known:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(UnknownName(what, name, tuple(known), self.name))
        return known[name].copy()

    @property
    def outputs(self) -> OutputMap:
        """Its output map; where its file gives none, one that only a simulated board may use."""
        return self.output_map or OutputMap.stand_in(self.limits, gripper=own_gripper(self) is not None)

    @property
    def simulated_only(self) -> str | None:
        """In few words, why only a simulated board may drive it; None: a real one may."""
        unknown = "its file gives no servos, so nobody knows which output means which angle"
        return None if self.output_map is not None else self.no_board or unknown

    @cached_property
    def first_pose(self) -> FloatArray:
        """Where the arm stands once it is enabled (n,) [rad]: rest, or where homing ends; read-only."""
        if self.output_map is not None and self.output_map.homed:
            return lock(self.output_map.angles(dict.fromkeys(self.output_map.channels, 0.0)))
        return lock(self.pose("rest"))

    def point(self, name: str) -> FloatArray:
        """A named tool point (3,) [m]; ``InputError`` where there is none of that name."""
        return self._named("point", name, self.points)

    def shown(self, q: ArrayLike) -> FloatArray:
        """Joint values (..., n), or how much they change, as people count them; see ``Joint.shown``."""
        return shown_values(self.joints, q)

    def read(self, shown: ArrayLike) -> FloatArray:
        """The joint values (..., n) of numbers as people count them."""
        return read_values(self.joints, shown)

    def check_limits(self, q: ArrayLike) -> FloatArray:
        """``q`` (n,) [rad]; ``MotionRefusedError`` names each joint or angle that is outside."""
        q = self.chain.checked_one(q)
        if outside := beyond_limits(self.joints, q):
            raise MotionRefusedError(Several((*outside, *[WrongUnit()] * seem_degrees(*q))))
        q = np.clip(q, self.limits[:, 0], self.limits[:, 1])
        if self.chain.turn_limits and (beyond := self.turns_beyond(q)):
            raise MotionRefusedError(Several(beyond))
        return q

    def turns_beyond(self, q: FloatArray) -> tuple[AngleLimit, ...]:
        """Angles between links that are beyond their limits at ``q`` (n,) [rad]."""
        return tuple(
            AngleLimit(limit.name, turn, limit.lower, limit.upper, between_links=True)
            for limit, turn in self.chain.turns_beyond(q)
        )
