"""What is said of each kind of reason, in Turkish."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts.angles import in_degrees, to_degrees
from armctl.facts.program_paths import (
    CallCircle,
    CalledStep,
    CallMissing,
    CallTooDeep,
    CallTooLong,
    CallUnread,
    CellOutsideGrid,
    FrameNamedBase,
    InStep,
    NeverComes,
    NeverEnds,
    OnPath,
    PathsLeftOut,
    PathTurn,
    Unbounded,
    UnknownFrame,
)
from armctl.facts.quantities import LOAD_S, LevelPassed
from armctl.facts.reasons import (
    UNITS,
    AngleLimit,
    AngleNeeded,
    AtLimit,
    BeyondReach,
    Blocked,
    BranchEnds,
    MotionEndsMoving,
    Need,
    NoSteps,
    NotHomed,
    NotNow,
    OnCurve,
    OtherRobot,
    Overload,
    PitchDecided,
    RateLimit,
    Reason,
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
    UnknownTool,
    UnmatchedBlock,
    WrongUnit,
    decimals_apart,
    limits_apart,
)
from armctl.facts.targets import NoRoomToTurn

AT, STEP, MORE = "{:.{}f} saniyede, ", "adım {}: ", " (ve {} tane daha)"
STATES = {
    State.DISCONNECTED: "bağlı değil",
    State.OFF: "kapalı",
    State.HOLDING: "konumunu koruyor",
    State.MOVING: "hareket ediyor",
    State.PAUSED: "duraklatıldı",
    State.FAULT: "arızada",
}
_NEEDS = {
    Need.HOLDING: "konumunu korumalı",
    Need.JOG: "konumunu korumalı ya da elle sürülmeli",
    Need.PAUSE: "hareket etmeli",
    Need.GRIPPER: "etkin olmalı",
    Need.OFF: "kapalı olmalı",
    Need.OFF_OR_HOLDING: "kapalı olmalı ya da konumunu korumalı",
    Need.HOLDING_SOME: "en az birkaç eklemiyle konumunu korumalı",
    Need.CONNECTED: "bağlı ve arızasız olmalı",
}
_HOME_FIRST = "Homing düğmesine basın (her eksen sıfırına gider)"
_TO_DO = {
    "other pose": "etkinleştirmek için başka bir duruş seçin",
    "support and enable": "kolu destekleyin, serbest bırakın (düşer) ve yeniden etkinleştirin",
    "turn back": "serbest bırakıp elle geri çevirin ya da Homing düğmesine basın",
    "mend pose": "pozu düzeltin, en yakınını alın ya da bir eklem açısı yazın",
}
_WAYS = {
    "then": "adım {0}: evet",
    "else": "adım {0}: hayır",
    "pass": "adım {0}: geçiş {1}",
    "cell": "adım {0}: göz {1}",
}
_UNMATCHED = {
    "end": "bu 'end' öncesinde 'repeat', 'if' ya da 'while' yok; silin ya da bitirdiğini ekleyin",
    "else": "bu 'else' öncesinde kendi 'if' adımı yok; silin ya da 'if' ekleyin",
}
_WRONG_UNIT = (
    "birim yanlış mı? Robot ve armctl.motion metre ve radyan ile; Arm, programlar, sayfalar ve komut "
    "satırı milimetre ve derece ile sayar"
)
_FREER = {
    "pitch kept": "yalnız takım eğimi korunursa",
    "pitch free": "takım eğimi serbest bırakılırsa",
    "orientation free": "takım yönelimi serbest bırakılırsa",
}
_CURVES = {"line": "doğrunun", "arc": "yayın", "stroke": "çizginin"}
_FOLLOWED = {"line": "doğruyu", "arc": "yayı", "stroke": "çizgiyi"}
_HELD = {"": "", "pitch": "o takım eğimiyle ", "rotation": "o takım yönelimiyle "}


def _path(turns: tuple[PathTurn, ...]) -> str:
    return "; ".join(
        (f"{turn.program}, " if turn.program else "") + _WAYS[turn.way].format(turn.step + 1, turn.number)
        for turn in turns
    )


_MISSING = {
    "beside": "{0!r} programı onu çağıran programın yanında yok; dosyayı oraya koyun ya da adını düzeltin",
    "saved": "{0!r} adlı kayıtlı program yok; Files bölümünde Upload ile yükleyip {0!r} adıyla Save edin",
    "sent": "çağırdığı {0!r} programı birlikte gönderilmedi",
}
_DOING = {
    "": "",
    "open": "açma",
    "approach": "yaklaşma",
    "down": "noktaya gitme",
    "grip": "tutma",
    "let go": "bırakma",
    "held": "tutuldu mu",
    "gone": "bırakıldı mı",
    "settle": "bekleme",
    "retreat": "uzaklaşma",
}


def _inside(one: InStep) -> str:
    calls = ": ".join(f"{call.program!r} içinde, adım {call.step + 1}" for call in one.calls)
    return ", ".join(filter(None, (calls, _DOING[one.doing])))


def _called(chain: tuple[str, ...]) -> str:
    return " → ".join(chain)


def _angle(one: AngleLimit) -> str:
    (angle,), low, high = limits_apart([one.angle], one.low, one.high)
    return f"{angle}, {low} … {high} aralığının dışında"


def _keep_away(one: AngleLimit) -> str:
    other = "başka bir noktadan geçen bir yol" if one.between_links else "daha düz bir yol"
    return f"bu sınırdan uzak durun: başka bir hedef ya da {other} seçin"


def _stands(one: StandsOutside) -> str:
    angle, low, high = (to_degrees(value) for value in (one.angle, one.low, one.high))
    return f"{one.joint} {angle:.1f}° açısında duruyor, {low:.1f}° … {high:.1f}° aralığının dışında"


def _rate(one: RateLimit) -> str:
    unit, limit, value = UNITS[one.rate], to_degrees(one.limit), to_degrees(one.value)
    if not math.isfinite(value):
        return f"yolun bir köşesinde hızı sıçrıyor; sınırı {limit:.1f} {unit}"
    shown = decimals_apart(value, limit, least=1)
    return f"{value:.{shown}f} {unit}, {limit:.{shown}f} {unit} olan sınırını aşıyor"


def _slower(one: RateLimit) -> str:
    if not math.isfinite(one.value):
        return "orada durun ya da yolu yuvarlatın"
    return f"süreyi {one.longer:.2f} katına çıkarın"


def _blocked(one: Blocked) -> str:
    depth_mm, at_rest_mm = 1000 * one.depth_m, 1000 * one.at_rest_m
    if one.kind == "floor":
        return f"zeminin {depth_mm:.1f} mm altında"
    if one.surfaces:
        near = f"{-depth_mm:.1f} mm yakın" if depth_mm < 0.0 else "değiyor"
        return f"{one.other} parçasına {near}"
    hulls = ", dışbükey gövdelere göre" if one.fitted else ""
    rest = f" (dururken {at_rest_mm:.1f} mm)" if at_rest_mm > 0 else ""
    return f"{one.other} parçasının {depth_mm:.1f} mm içinde{hulls}{rest}"


def _round_it(one: Blocked) -> str:
    if one.kind == "floor":
        return "hedefi yükseltin ya da daha yüksek bir noktadan dolaşın"
    if one.kind == "obstacle":
        return f"başka bir hedef seçin ya da {one.other} çevresinden başka bir noktayla dolaşın"
    return f"başka bir hedef seçin ya da {one.other} parçasından daha uzak bir noktadan dolaşın"


def _singular(one: Singular) -> str:
    percent = 100 * one.isotropy
    if percent < 0.1:
        return "tekillik: takım bir yönde hareket edemiyor"
    return f"tekilliğe yakın: takım bir yönde en hızlı yöndekinin yalnız % {percent:.1f} hızında"


def _by_joints(one: Singular) -> str:
    if one.lost:
        return "eklem hareketleri uygundur; oradan geçmeyen bir doğru seçin"
    return "eklem hareketleri uygundur; oradan bir doğru ya da takım sürüşü yavaş olur ya da reddedilir"


def _overload(one: Overload) -> str:
    motor = f"{one.stall:.2f} N·m durma torkunun"
    if one.effort:
        motor = f"URDF dosyasındaki {one.stall:.3g} N·m değerinin"
    share = 100 * one.torque / one.stall
    return f"yerçekimi onu {one.torque:.2f} N·m ile yüklüyor, {motor} % {share:.0f} kadarı ({one.counted})"


def _lighter(one: Overload) -> str:
    if one.effort:
        return f"motor başkaysa {one.joint} için stall_torque_nm değerini yan dosyaya yazın"
    if one.over:
        return "yükü ekleme yaklaştırın ya da daha hafif bir yük alın"
    return "orada uzun durmayın: motor ısınır"


def _on_curve(one: OnCurve) -> str:
    x, y, z = (1000.0 * value for value in one.point_m)
    share = f"{_CURVES.get(one.curve, one.curve)} % {100.0 * one.fraction:.0f} noktasında"
    return f"{share} (x {x:z.1f}, y {y:z.1f}, z {z:z.1f} mm)"


def _followed(curve: str) -> str:
    return _FOLLOWED.get(curve, curve)


def _move(one: TooFewJoints | BeyondReach | AtLimit | BranchEnds) -> str:
    return f"{_followed(one.curve)} başka bir yere taşıyın"


def _too_few(one: TooFewJoints) -> str:
    wish = "takımı böyle döndüremez" if one.turns else "takımın yönelimini koruyamaz"
    turn = in_degrees(one.turn / 1000.0, ".3g")
    return f"{one.joints} eklem burada {wish}, takım milimetre başına ayrıca {turn} dönerdi"


def _in_its_plane(one: TooFewJoints) -> str:
    if one.has_plane:
        return "kolun kendi düşey düzleminde ve takım tam yukarı ya da aşağı bakarken yapabilirler"
    return _move(one)


def angle_needed(one: AngleNeeded) -> str:
    """What is said of one, also inside of what is said of a target."""
    if not one.angles:
        low, high = map(in_degrees, (one.low, one.high))
        return f"bu dal bitmeden {one.joint} {low} … {high} sınırlarının dışına çıkmak zorunda kalır"
    angles, low, high = limits_apart(one.angles, one.low, one.high)
    place = "" if one.percent is None else f"% {one.percent:.4g} noktasında "
    return f"{place}{one.joint} için {' ya da '.join(angles)} gerekir, sınırları {low} … {high}"


def _at_limit(one: AtLimit) -> str:
    needs = " ve ".join(map(angle_needed, one.needs))
    return f"{_found(one)}{one.joint} {in_degrees(one.limit)} olan sınırında; {needs}"


def _found(one: AtLimit | BranchEnds) -> str:
    return "bulunan en iyi yolda " if one.searched else ""


def _branch_ends(one: BranchEnds) -> str:
    turn = f"milimetre başına {in_degrees(one.turn / 1000.0, '.0f')} ve az ötede daha da çok"
    farther = "; % 100 noktasında: " if one.at_end else ""
    return f"{_found(one)}{one.joint} {turn} dönmek zorunda kalır: tekillik{farther}"


def _other_ways(one: AtLimit | BranchEnds) -> str:
    if not one.branches:
        return _move(one)
    names = " ya da ".join(one.branches)
    return f"başka bir dalda başlayın ({names} {_followed(one.curve)} sonuna kadar izler) ya da {_move(one)}"


def _beyond_reach(one: BeyondReach) -> str:
    leaves = f"burada kolun {_HELD.get(one.held, '')}eriştiği bölgeden çıkıyor"
    return leaves if one.why is None else f"{leaves}; % {one.percent} noktasında: "


def _pitch_decided(one: PitchDecided) -> str:
    low, high = map(in_degrees, (one.low, one.high))
    return (
        f"bu kolda takım eğimini yalnız konum belirler: {_CURVES.get(one.curve, one.curve)} üzerinde eğim "
        f"{low} … {high}; bu yüzden ne korunabilir ne de başka bir eğime geçirilebilir; serbest bırakın"
    )


def _not_now(one: NotNow) -> str:
    why = _state(one)
    return f"{one.asked}: kol {_NEEDS[one.need]}, şimdi {why}" if one.asked else f"kol {why}"


def _state(one: NotNow) -> str:
    now, moves = STATES[one.state], one.state in (State.MOVING, State.PAUSED)
    told = f"{now} ({one.cause})" if one.cause else now
    if one.limp:
        return f"duruyor, ama {', '.join(one.limp)} serbest; önce etkinleştirin"
    if one.state is State.DISCONNECTED:
        off = one.need in (Need.OFF, Need.OFF_OR_HOLDING, Need.CONNECTED)
        return f"{now}; önce bağlanın" if off else f"{now}; bağlanın ve etkinleştirin"
    if one.state is State.OFF:
        return f"{now}; {'önce etkinleştirin' if one.homed else _HOME_FIRST}"
    if moves and one.stopping:
        return "duruyor; durana kadar bekleyin"
    if moves and one.need is Need.PAUSE and one.doing:
        return f"{told}; {one.doing} duraklatılamaz; STOP düğmesine basın"
    if moves and one.need is Need.GRIPPER:
        return f"{told}; tutucu serbest değil: bekleyin ya da önce durdurun"
    if moves and one.need is not Need.OFF:
        return f"{told}; önce durdurun"
    if one.state is State.FAULT:
        return f"{told}; {'önce arızayı temizleyin' if one.connected else 'yeniden bağlanın'}"
    return f"{told}; {'duraklatılacak bir şey yok' if one.need is Need.PAUSE else 'kol zaten etkin'}"


def _level(one: LevelPassed) -> str:
    match one.quantity:
        case "load":
            value, limit = 100 * one.value, 100 * one.reference
            return f"{one.output}: yük {LOAD_S:.0f} saniyeden uzun süredir %{value:.0f}, sınırı %{limit:.0f}"
        case "temperature":
            return f"{one.output}: {one.value:.0f} °C, {one.reference:.0f} °C olunca kendini kapatır"
        case "voltage":
            return f"{one.output}: besleme {one.value:.1f} V, yüksüzken {one.reference:.1f} V"


_LEVEL_ADVICE = {
    "load": "servo bırakmadan önce yükü azaltın ya da daha az yük taşıyan bir poz seçin",
    "temperature": "kolu asılı durduğu ya da yattığı yerde dinlendirin, yükü azaltın",
    "voltage": "fişlere ve kablolara bakın, daha çok akım veren bir kaynak kullanın",
}


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    AngleLimit: _angle,
    NoRoomToTurn: lambda one: (
        f"sınırına {in_degrees(one.room, '.1f')} uzakta, o yandan gelmek için çok yakın; "
        f"{in_degrees(one.needed, '.1f')} gerekir"
    ),
    StandsOutside: _stands,
    WrongUnit: lambda _: _WRONG_UNIT,
    ToDo: lambda one: _TO_DO[one.what],
    UnknownTool: lambda one: (
        f"kolun {one.name!r} adlı bir takımı yok; olanlar: "
        f"{', '.join(map(repr, one.known)) or 'dosyasında hiç yok'}"
    ),
    ToolGripsNot: lambda one: f"{one.tool!r} takımıyla hiçbir şey tutulamaz; önce başka bir takım takın",
    ToolToConfirm: lambda one: (
        "kart bağlandığından beri hangi takımın takılı olduğunu kimse söylemedi; son takım "
        f"{one.tool!r}: kola bakın ve birini seçin: {', '.join(map(repr, one.known))} (sayfada, arm.set_tool "
        "ile, --tool ile)"
    ),
    ToolWhileMoving: lambda one: (
        f"takım yalnız kol dururken değiştirilir ({one.cause}); durdurun ya da bekleyin"
    ),
    ToolHoldsPart: lambda one: (
        f"tutucuda {one.size} boyutunda bir parça var; takım değişmeden önce tutucuyu açın"
    ),
    NotHomed: lambda _: f"kol nerede olduğunu henüz bilmiyor; {_HOME_FIRST}",
    OtherRobot: lambda one: f"{one.made_for!r} robotu için yazılmış, bu ise {one.this!r}",
    NoSteps: lambda _: "hiç adımı yok",
    UnmatchedBlock: lambda one: _UNMATCHED.get(
        one.marker, f"bu '{one.marker}' için 'end' yok; bloğun son adımının arkasına bir tane ekleyin"
    ),
    PathTurn: lambda one: _path((one,)),
    OnPath: lambda one: f" (yol: {_path(one.turns)})",
    CellOutsideGrid: lambda _: "frame = 'cell' için çevresinde 'grid' olmalı; ekleyin ya da frame'i silin",
    CalledStep: lambda one: f"{one.program!r} içinde, adım {one.step + 1}",
    InStep: _inside,
    CallMissing: lambda one: _MISSING[one.place].format(one.program),
    CallUnread: lambda one: f"çağırdığı {one.program!r} programı okunamıyor: {one.why}",
    CallCircle: lambda one: f"programlar birbirini döngüyle çağırıyor: {_called(one.chain)}; birini çıkarın",
    CallTooDeep: lambda one: f"iç içe çağrılan program {one.most} sayısını aşıyor: {_called(one.chain)}",
    CallTooLong: lambda one: f"çağırdığı programlarla birlikte {one.most} adımdan çok",
    UnknownFrame: lambda one: (
        f"programda {one.name!r} çerçevesi yok; "
        + (f"olanlar: {', '.join(map(repr, one.known))} ve 'base'" if one.known else "yalnız 'base' var")
    ),
    FrameNamedBase: lambda _: "bir çerçevenin adı 'base' olamaz, o kolunkidir; adını değiştirin",
    NeverComes: lambda one: f"{one.what} hiç gelemez: program beklerken hiçbir şey saymaz",
    NeverEnds: lambda _: "bu döngü hiç bitmez: hiçbir geçiş sorduğunu değiştirmez",
    Unbounded: lambda _: "bu döngünün kaç kez döneceği denetlenemez, sonsuz olabilir; 'most' ile sınırlayın",
    PathsLeftOut: lambda one: (
        f"programın yolu çok fazla: denetim {one.most} adımdan sonra burada bitti; ötekiler denetlenmedi"
    ),
    ShownSoFar: lambda _: "gösterilen hareket orada bitiyor",
    RateLimit: _rate,
    SpeedJump: lambda one: f"hareketin iki parçası arasında hızı {to_degrees(one.jump):.2f} °/s sıçrıyor",
    MotionEndsMoving: lambda one: (
        f"hareket {to_degrees(one.speed):.2f} °/s ile {'başlıyor' if one.end == 'starts' else 'bitiyor'}"
    ),
    Blocked: _blocked,
    Singular: _singular,
    Overload: _overload,
    OnCurve: _on_curve,
    TooFewJoints: _too_few,
    AngleNeeded: angle_needed,
    AtLimit: _at_limit,
    SingularStart: lambda one: f"kol bir tekillikte duruyor ve bu {_followed(one.curve)} izlemeye başlayamaz",
    BranchEnds: _branch_ends,
    BeyondReach: _beyond_reach,
    PitchDecided: _pitch_decided,
    NotNow: _not_now,
    Unanswered: lambda one: f"{one.what}; şunu denetleyin: {one.check}",
    LevelPassed: _level,
}
ADVICE: Mapping[type[Reason], Callable[[Any], str]] = {
    AngleLimit: _keep_away,
    NoRoomToTurn: lambda _: "öteki yandan gelin ya da bu sınırdan daha uzak bir duruş seçin",
    RateLimit: _slower,
    SpeedJump: lambda _: "bir parça, sonraki başladığı hızda bitsin, ya da ikisi de orada dursun",
    MotionEndsMoving: lambda _: "durgun başlasın ve durgun bitsin",
    Blocked: _round_it,
    Singular: _by_joints,
    Overload: _lighter,
    OnCurve: lambda one: f"{_FREER[one.freer]} kol onu izleyebilir" if one.freer else "",
    TooFewJoints: _in_its_plane,
    AtLimit: _other_ways,
    SingularStart: lambda _: "önce kolu bükün (bir eklemi döndürün ya da o poz bükülüyse Main → Home)",
    BranchEnds: _other_ways,
    BeyondReach: lambda one: _move(one) if one.why is None else "",
    LevelPassed: lambda one: _LEVEL_ADVICE[one.quantity],
}
