"""Reasons travel as data, and every kind of them has words in every language."""

from __future__ import annotations

import json
import math
import pickle

import pytest

from armctl.errors import EnableError, StateError
from armctl.facts import (
    About,
    Advised,
    AngleLimit,
    AngleNeeded,
    AtLimit,
    BeyondReach,
    Blocked,
    BranchEnds,
    CallCircle,
    CalledStep,
    CallMissing,
    CallTooDeep,
    CallTooLong,
    CallUnread,
    CellOutsideGrid,
    Found,
    FrameNamedBase,
    InStep,
    MotionEndsMoving,
    Need,
    NeverComes,
    NeverEnds,
    NoRoomToTurn,
    NoSteps,
    NotHomed,
    NotNow,
    OnCurve,
    OnPath,
    OtherRobot,
    Overload,
    PathsLeftOut,
    PathTurn,
    PitchDecided,
    RateLimit,
    Reason,
    Said,
    Several,
    ShownSoFar,
    Singular,
    SingularStart,
    SpeedJump,
    StandsOutside,
    State,
    ToDo,
    TooFewJoints,
    ToolGripsNot,
    ToolHoldsPart,
    ToolToConfirm,
    ToolWhileMoving,
    Unanswered,
    Unbounded,
    UnknownFrame,
    UnknownTool,
    UnmatchedBlock,
    WrongUnit,
    advice,
    at,
    say,
    state_words,
    what,
)
from armctl.facts.causes import (
    FitFigures,
    GoodAlready,
    HasPlay,
    LengthOff,
    MarksNarrow,
    MarksTogether,
    MistakenPoint,
    NotBetter,
    NotTold,
    PlaceOff,
    PlaneFromBelow,
    PlaneOutOfReach,
    PlanePointOff,
    PlanePointsInLine,
    PlanePointsNear,
    PointsTogether,
    Sags,
    ScaleOff,
    TaughtTip,
    TipAsBefore,
    TipUntold,
    TooFew,
    ToolTurnedLittle,
    WorstPoint,
    ZeroOff,
)
from armctl.facts.commands import (
    AfterGap,
    ControlLocked,
    Disconnected,
    LineSlow,
    MotorsApart,
    NoBoard,
    NoSuchStep,
    NotDigital,
    NothingOn,
    NothingTo,
    NotOperator,
    OnUnconfirmed,
    PlannedTooLong,
    PlanningAlready,
    PoseUnknown,
    ReadingsDiffer,
    Released,
    ReleaseUnconfirmed,
    ShareOutside,
    StartLeft,
    Stopped,
    Superseded,
    UnknownName,
)
from armctl.facts.quantities import LevelPassed
from armctl.facts.servos import (
    ServoAtBaud,
    ServoChanged,
    ServoNotTaken,
    ServoOffset,
    ServoOutside,
    ServoRange,
    ServoSeam,
    ServoSilent,
    ServoStranger,
    ServoTold,
    ServoTorqueOn,
    ServoTurned,
    ServoTurning,
    ServoUnconfirmed,
    ServoUnfit,
)
from armctl.facts.targets import (
    AnyAngle,
    AtPoint,
    AtRoll,
    BesideAxis,
    Besides,
    BetweenReaches,
    HeldAtLimit,
    InsideCylinder,
    Instead,
    JointsNeeded,
    LimitsForbid,
    ListedAt,
    ListedInSteps,
    LostAtLimit,
    MayBeHidden,
    MayExist,
    MayTurn,
    MoreByTurns,
    NearestPoint,
    NoneWithoutLimits,
    NoOrientationNear,
    NoSuchAngle,
    NotFound,
    NotInOrientation,
    OffRotation,
    OneLine,
    OrientationImpossible,
    OrientationNeeds,
    OtherConfiguration,
    OutOfBound,
    OutOfReach,
    PitchByPosition,
    PitchNotFound,
    PitchOfRods,
    PitchOutside,
    PointReached,
    PoseUnmet,
    ReachedFree,
    Searched,
    StrokeLeftOut,
    ToolStepRefused,
    TurnTogether,
)
from armctl.facts.words import KINDS, LANGUAGES, fact_of, fact_record, opening, preferred

ELBOW = AngleLimit("Elbow", math.radians(190.004), -math.pi, math.radians(190))
NEEDS = AngleNeeded("Elbow", (1.2,), -1.0, 1.0, 66.7)
SAMPLES: list[Reason] = [
    *(TooFew(of, 2, 3) for of in ("marks", "touches", "points")),
    MarksTogether(2, 3),
    MarksTogether(1, 3, 1500.0, "µs"),
    MarksNarrow(0.3, 0.35),
    PointsTogether(0.03),
    ToolTurnedLittle(0.2),
    PlanePointsNear(1, 2, 0.004, 0.02),
    PlanePointsInLine(),
    PlaneFromBelow(),
    PlanePointOff(4, 0.007, 0.005),
    PlaneOutOfReach(),
    ServoSilent(3),
    *(ServoUnconfirmed(3, what) for what in ("told", "on", "locked", "open")),
    ServoNotTaken(3, 2048, "goal", 100),
    ServoNotTaken(3, 4, "id"),
    ServoTorqueOn(3),
    ServoTurned(3, 0.1),
    ServoTurning(3),
    ServoTurning(3, enabling=True),
    ServoOutside(3, 2048, 2100, 4095, 0.08),
    Stopped("page 2", what="move"),
    Stopped("", "the board reports: overrun", how="cancelled"),
    Stopped("page 2", how="unbegun"),
    Released("page 2"),
    Released("page 2", joints=True),
    NotOperator("Anna"),
    NotOperator(locked=True),
    NotOperator(),
    ControlLocked("Anna"),
    ControlLocked(pin=True),
    *(NothingTo(do, State.OFF) for do in ("resume", "clear", "release")),
    NoBoard(),
    Disconnected(),
    Disconnected("/dev/ttyACM0"),
    Superseded("gripper"),
    Superseded("edit"),
    PlanningAlready(),
    PlannedTooLong(60.0),
    StartLeft(),
    AfterGap(1.2),
    *(ShareOutside(of, 1.2, 0.05, 1.0) for of in ("speed", "opening", "torque limit")),
    *(ShareOutside(of, -0.1, 0.0, 1.0, "door") for of in ("input", "output", "gripper")),
    NotDigital("lamp", 0.5),
    *(UnknownName(kind, "x", ("a", "b")) for kind in ("joint", "input", "output")),
    *(UnknownName(kind, "x", (), "uzuner") for kind in ("output", "pose", "point")),
    NoSuchStep("pick", 4, 3),
    PoseUnknown("pulses"),
    PoseUnknown("pulses", "last seen at 1.0° on 2026-01-01 10:00; then a fault ended it"),
    NothingOn(("overload", "overheat")),
    LineSlow(0.12, 0.04),
    LineSlow(math.inf, 0.04),
    MotorsApart(("Shoulder",)),
    ReadingsDiffer(("Shoulder", "Elbow")),
    OnUnconfirmed("motors"),
    ReleaseUnconfirmed("/dev/ttyACM0", "PCA9685", "channel", (3, 4)),
    ReleaseUnconfirmed("/dev/ttyACM0", "", "servo", (3,)),
    TaughtTip(4, (0.001, -0.002, 0.03), 0.0004, 0.0005, 2, 0.0007),
    TipAsBefore(),
    TipUntold((1.0, 0.0, 0.0), None),
    TipUntold((0.6, 0.0, 0.8), 0.0021),
    FitFigures(10, 0.025, 0.04, 0.002, 0.003, 0.0011, 0.0024, corrected=True),
    FitFigures(10, 0.025, 0.04, 0.025, 0.04, 0.01, 0.03, corrected=False),
    ZeroOff("Elbow", 0.05, 0.005),
    ZeroOff("Elbow", -0.3, 0.005),
    Sags("Shoulder", 0.04, 0.005),
    HasPlay("Elbow", 0.02, 0.005),
    ScaleOff("Elbow", -0.02, 0.004),
    LengthOff("Elbow", 3, "a", 0.116, 0.001, 0.0002),
    PlaceOff("x", 0.005, 0.0003),
    MistakenPoint(4, (0.012, -0.003, 0.0004)),
    WorstPoint(4, (0.012, -0.003, 0.0004)),
    *(
        NotTold("Elbow", one)
        for one in ("zero", "sag", "play", "scale", "a", "d", "place", "tilt", "heading")
    ),
    GoodAlready(0.0007),
    NotBetter(0.004, 0.005),
    Said("no", "mend it"),
    About("step 3", ELBOW),
    Advised(ELBOW, "choose another pose"),
    Several((ELBOW, WrongUnit())),
    Found(ELBOW, "Elbow", 0.512, 2, 1, 3),
    Found(SpeedJump("Base", 0.5)),
    ELBOW,
    AngleLimit("Angle between links", 1.0, 0.0, 0.5, between_links=True),
    NoRoomToTurn("Base", 0.002, 0.035),
    StandsOutside("Base", 2.0, -1.0, 1.0),
    WrongUnit(),
    *(ToDo(what) for what in ("other pose", "support and enable", "turn back")),
    NotHomed(),
    UnknownTool("saw", ()),
    UnknownTool("saw", ("jaws", "pen")),
    ToolToConfirm("pen", ("jaws", "pen")),
    ToolWhileMoving("move (page 1)"),
    ToolGripsNot("pen"),
    ToolHoldsPart("20 × 20 × 20 mm"),
    OtherRobot("uzuner", "scorbot"),
    NoSteps(),
    UnmatchedBlock("repeat"),
    UnmatchedBlock("end"),
    UnmatchedBlock("else"),
    UnmatchedBlock("while"),
    PathTurn(2, "pass", 3),
    OnPath((PathTurn(1, "then"), PathTurn(4, "else")), NoSteps()),
    CalledStep("grip", 1),
    InStep((CalledStep("grip", 1), CalledStep("lib/turn", 0)), "approach", NoSteps()),
    InStep((), "retreat", NoSteps()),
    InStep((), "", NoSteps()),
    CallMissing("grip", "beside"),
    CallMissing("grip", "saved"),
    CallMissing("grip", "sent"),
    CallUnread("grip", "line 4: no value"),
    CallCircle(("pick", "grip", "pick")),
    CallTooDeep(("pick", "grip"), 8),
    CallTooLong(50_000),
    CellOutsideGrid(),
    UnknownFrame("table", ()),
    UnknownFrame("table", ("shelf", "tray")),
    FrameNamedBase(),
    NeverComes("counter parts = 3"),
    NeverEnds(),
    Unbounded(),
    PathsLeftOut(200_000),
    ShownSoFar(),
    Unanswered("no answer for 50 ms", "the cable"),
    RateLimit("Base", "speed", 2.0, 1.0),
    RateLimit("Base", "jerk", 8.0, 1.0),
    RateLimit("Base", "acceleration", math.inf, 1.0),
    SpeedJump("Base", 0.5),
    MotionEndsMoving("Base", "starts", 0.5),
    MotionEndsMoving("Base", "ends", 0.5),
    Blocked("floor", "the jaw", "", 0.012),
    Blocked("obstacle", "the jaw", "the box", 0.012, fitted=True),
    Blocked("self-collision", "the jaw", "the base", 0.012, at_rest_m=0.004),
    Blocked("self-collision", "the jaw", "the base", -0.002, surfaces=True),
    Singular(0.004, lost=True),
    Singular(0.0, lost=False),
    Overload("Shoulder", "shoulder", 1.2, 1.0, "links", over=True, effort=False),
    Overload("Shoulder", "shoulder", 0.6, 1.0, "links", over=False, effort=True),
    OnCurve("line", 0.25, (0.1, 0.2, 0.3), Said("it ends", "move the line"), 1.5),
    OnCurve("arc", 0.25, (0.1, 0.2, 0.3), Said("it ends"), None, "pitch free"),
    TooFewJoints("line", 5, turns=True, turn=2.0, has_plane=True),
    TooFewJoints("arc", 5, turns=False, turn=2.0, has_plane=False),
    NEEDS,
    AngleNeeded("Elbow", (), -1.0, 1.0, 12.5),
    AtLimit("line", "Elbow", 1.0, (NEEDS, NEEDS), True, ("elbow-up", "elbow-down")),
    SingularStart("arc"),
    BranchEnds("line", "Elbow", 2.0, NoSteps(), False, ()),
    BeyondReach("arc", "pitch"),
    BeyondReach("line", "", 100, NoSteps()),
    PitchDecided("line", -0.5, 0.5),
    *(NotNow("a motion", need, state) for need in Need for state in State),
    NotNow("", Need.PAUSE, State.MOVING, "a line", "a line", stopping=True),
    NotNow("", Need.PAUSE, State.MOVING, "a line", "a line"),
]
SAMPLES += [
    OtherConfiguration(),
    ToolStepRefused((0.01, 0.0, -0.001)),
    ToolStepRefused((0.01, 0.0, -0.001), turns=math.radians(30)),
    StrokeLeftOut(1, 2, 0.0, 0.03, 0.03),
    StrokeLeftOut(3, 9, 0.01, 0.02, 0.1, ELBOW),
]
SAMPLES += [ToDo("mend pose"), PoseUnmet(None), PoseUnmet(ELBOW)]
SAMPLES += [
    Searched(),
    Searched(continuum=True),
    MoreByTurns(12),
    ListedAt("Roll", 0.5),
    ListedInSteps("Joint 7", 0.01),
    MayTurn(("Base",)),
    MayTurn(("Base", "Roll", "Elbow")),
    AnyAngle("Base", "target on base axis"),
    AnyAngle("Shoulder", "wrist on shoulder axis"),
    AnyAngle("Joint 1", "centre of wrist"),
    TurnTogether(("Joint 2", "Joint 4")),
    TurnTogether(()),
    OneLine(("Joint 4", "Joint 6"), "sum"),
    MayBeHidden(),
    LostAtLimit("Elbow"),
]
SAMPLES += [
    ServoSilent(3, "Elbow"),
    ServoSilent(4, "Wrist", behind=3),
    ServoSilent(3, "Elbow", stranger=9),
    ServoStranger(9),
    ServoAtBaud(3, 57_600, 1_000_000),
    ServoUnfit(3, "it is in mode 1"),
    ServoRange(3, 100, 2500, 946.0, 3150.0),
    ServoOffset(3, -7),
    ServoSeam(120.0, 3900.0, 4096.0),
    ServoTold(3, "it is too hot"),
    *(ServoChanged(3, register, 0, 7) for register in ("offset", "lowest", "highest", "mode")),
]
SAMPLES += [Instead("wait"), Instead("go near"), Instead("go near", "elbow-up")]
NEEDED = AngleNeeded("Elbow", (1.7, -1.8), -1.5, 1.5)
WAY = JointsNeeded((NEEDED, AngleNeeded("Base", (2.0,), -1.0, 1.0)), least=True)
SAMPLES += [
    NEEDED,
    WAY,
    JointsNeeded((), "over the back"),
    LimitsForbid(()),
    LimitsForbid((WAY, JointsNeeded((), "facing")), pitched=True),
    OutOfReach(True, 0.2, 0.5, 0.7, "wrist", "Shoulder", pitched=True, side="facing"),
    OutOfReach(False, 0.1, 0.2, None, links="two links"),
    OutOfBound(True, 0.2, 0.5, 0.7, (0.0, 0.0, 0.1), "Joint 1"),
    OutOfBound(False, 0.2, 0.5, 0.3, (0.0, 0.0, 0.1), "Joint 1"),
    InsideCylinder(0.004, 0.003),
    BesideAxis(0.02, 0.01),
    BetweenReaches(0.1, 0.7, 0.2, 0.6),
    *(NoSuchAngle(what) for what in ("pitch", "roll", "elevation")),
    PitchByPosition((0.1, 0.2)),
    PitchOutside(-0.5, 0.5, 0.5),
    PitchOutside(-0.5, 0.5, 0.5, "Wrist roll", 0.1),
    PitchOfRods(0.0, 1.0),
    NotInOrientation(pitched=True),
    OffRotation(0.1),
    OrientationImpossible(proven=True),
    OrientationImpossible(proven=False),
    OrientationNeeds(WAY),
    NoOrientationNear(),
    NotFound(256, 0.01, turned=True),
    PitchNotFound(256, 0.1, 0.2),
    NoneWithoutLimits(64),
    MayExist(),
    Besides(NotFound(256, 0.01, turned=False)),
    AtRoll("Roll", 0.1, MayExist()),
    AtPoint(2, 3, MayExist()),
    HeldAtLimit("Elbow", 1.5),
    NearestPoint((0.1, 0.2, 0.3), 0.01),
    NearestPoint((0.1, 0.2, 0.3), 1e-5, "any", (HeldAtLimit("Elbow", 1.5), HeldAtLimit("Base", 1.0))),
    PointReached(),
    ReachedFree("pitch"),
    ReachedFree("pitch and roll"),
    LevelPassed("Elbow", "servo 3", "load", 0.93, 0.8, 0.8),
    LevelPassed("Elbow", "servo 3", "temperature", 62.0, 60.0, 70.0),
    LevelPassed("Gripper", "servo 6", "voltage", 10.4, 10.8, 12.0),
]


def deep(levels: int) -> dict[str, object]:
    """A reason about a reason about a reason …"""
    record: dict[str, object] = fact_record(ELBOW)
    for _ in range(levels):
        record = {"fact": "About", "thing": "step 3", "reason": record}
    return record


def test_each_kind_of_reason_has_a_sample() -> None:
    assert {type(one) for one in SAMPLES} == set(KINDS.values()) - {Reason}


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("reason", SAMPLES, ids=lambda one: type(one).__name__)
def test_it_has_words_in_every_language(reason: Reason, language: str) -> None:
    for text in (what(reason, language), say(reason, language)):
        assert text and text == text.strip() and "None" not in text
    assert advice(reason, language) == advice(reason, language).strip()
    assert at(1.234, 2, language).strip().endswith(",") and at(None, language=language) == ""


@pytest.mark.parametrize(
    ("reason", "english", "turkish"),
    [
        (Stopped("Bob", what="move"), "move was stopped by Bob", "move durduruldu (Bob)"),
        (Stopped(""), "stopped by you", "durduruldu (siz)"),
        (
            ShareOutside("speed", 0.02, 0.05, 1.0),
            "a speed of 2 % is outside 5 … 100 %",
            "hız %2, %5 … %100 dışında",
        ),
        (
            ShareOutside("input", 2, 0, 1, "door"),
            "input door: 2 is outside 0 … 1",
            "giriş door: 2, 0 … 1 dışında",
        ),
        (
            UnknownName("pose", "x", ("home", "rest"), "uzuner"),
            "uzuner has no pose 'x'; it has home, rest",
            "uzuner: 'x' adında poz yok; olanlar: home, rest",
        ),
        (
            ReleaseUnconfirmed("COM3", "board", "pin", (3, 5)),
            "COM3: the board did not confirm the release of pins 3, 5; the arm may still be held. "
            "Cut the servos' supply before you reach in",
            "COM3: board kapandığını doğrulamadı (pin 3, 5); kol hâlâ tutuluyor olabilir. Elinizi uzatmadan "
            "önce servoların gücünü kesin",
        ),
    ],
    ids=lambda one: type(one).__name__,
)
def test_what_a_command_is_told(reason: Reason, english: str, turkish: str) -> None:
    assert (say(reason, "en"), say(reason, "tr")) == (english, turkish)


def test_no_kind_lacks_a_word_and_no_word_lacks_its_kind() -> None:
    tables = [set(one.what) for one in LANGUAGES.values()]
    assert all(one == tables[0] for one in tables)
    assert tables[0] | {Said, About, Advised, Several, Found, Reason} == set(KINDS.values())
    assert len({frozenset(one.advice) for one in LANGUAGES.values()}) == 1
    for language in LANGUAGES:
        assert len({state_words(state, language) for state in State}) == len(State)


@pytest.mark.parametrize("reason", SAMPLES, ids=lambda one: type(one).__name__)
def test_it_travels_as_a_record(reason: Reason) -> None:
    record = fact_record(reason)
    assert record["fact"] == type(reason).__name__
    assert fact_of(json.loads(json.dumps(record))) == reason
    assert pickle.loads(pickle.dumps(reason)) == reason


@pytest.mark.parametrize(
    "record",
    [
        {},
        {"fact": "os.system"},
        {"fact": []},
        {"fact": "Reason"},
        {"fact": "AngleLimit", "part": "Elbow"},
        {"fact": "Said", "text": 5, "mend": ""},
        {"fact": "Said", "text": "no", "mend": None},
        fact_record(RateLimit("Base", "speed", 2.0, 1.0)) | {"limit": 0.0},
        deep(2_000),
        fact_record(ELBOW) | {"angle": "wide"},
        fact_record(NotNow("a motion", Need.HOLDING, State.OFF)) | {"state": "asleep"},
        fact_record(About("step 3", ELBOW)) | {"reason": {"fact": "Unheard"}},
        fact_record(BeyondReach("line", "pitch", 40, ELBOW)) | {"why": {"fact": "Unheard"}},
    ],
)
def test_a_record_that_is_none_is_nothing(record: dict[str, object]) -> None:
    assert fact_of(record) is None


@pytest.mark.parametrize(
    ("settings", "language"),
    [
        ({}, "en"),
        ({"LANG": "C.UTF-8"}, "en"),
        ({"LANG": "tr_TR.UTF-8"}, "tr"),
        ({"LANG": "de_DE.UTF-8"}, "en"),
        ({"LANG": "trv_TW.UTF-8"}, "en"),
        ({"LANG": "tr"}, "tr"),
        ({"LANG": "tr_TR.UTF-8", "LC_ALL": "C"}, "en"),
        ({"LANG": "en_GB", "LC_MESSAGES": "tr_TR"}, "tr"),
    ],
)
def test_the_language_is_the_users(settings: dict[str, str], language: str) -> None:
    assert preferred(settings) == language


def test_an_error_keeps_its_reason_and_makes_its_words_when_they_are_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    error = StateError(NotNow("a motion", Need.HOLDING, State.OFF))
    assert str(error) == "a motion needs the arm holding, it is off; enable first"
    monkeypatch.setenv("LC_ALL", "tr_TR.UTF-8")
    assert str(error) == "a motion: kol konumunu korumalı, şimdi kapalı; önce etkinleştirin"
    assert str(EnableError("said in English")) == "said in English"
    about = error.about("step 2")
    assert isinstance(about, StateError) and about.reason == About("step 2", error.reason)
    assert str(pickle.loads(pickle.dumps(about))) == str(about)


def test_numbers_read_unlike_the_limit_that_they_pass() -> None:
    assert say(ELBOW) == "Elbow: 190.004° is outside -180.000° … 190.000°"
    assert RateLimit("Base", "speed", 2.0, 1.0).longer == 2.0
    assert RateLimit("Base", "jerk", 8.0, 1.0).longer == 2.0
    assert advice(RateLimit("Base", "jerk", 8.0, 1.0)) == "take 2.00 times as long"


def test_a_capital_is_that_of_the_language_of_its_word() -> None:
    both = (NoOrientationNear(), Said("it"))
    assert opening(both[0], "tr") == f"İ{say(both[0], 'tr')[1:]}" and say(both[0], "tr")[0] == "i"
    assert opening(both[0], "en").startswith("No orientation")
    assert opening(both[1], "tr") == "It" and opening(About("it.urdf", both[0]), "tr").startswith("It.urdf: ")
    assert opening(Several(both), "tr")[0] == "İ" and opening(Several(both[::-1]), "tr")[:2] == "It"


def test_what_a_check_found_is_one_reason_that_is_said_as_before() -> None:
    found = Found(ELBOW, "Elbow", 0.512, 2, 1, 3)
    assert say(found, "en").startswith("step 2: Elbow: at 0.51 s, 190.004° is outside")
    assert say(found, "en").endswith(" (and 3 more)")
    assert say(found, "tr").startswith("adım 2: Elbow: 0.51 saniyede, ") and say(found, "tr").endswith(
        "tane daha)"
    )
