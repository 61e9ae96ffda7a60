"""What is said of each reason why a target has no solution, in Turkish."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts import targets
from armctl.facts.angles import in_degrees
from armctl.facts.causes import in_signed_millimetres
from armctl.facts.reasons import Reason, in_millimetres
from armctl.facts.turkish import angle_needed

_SIDES = {None: "", "facing": "hedefe dönükken ", "over the back": "arkaya uzanırken "}
_LEAST = "en azından "
_ORIENTATIONS = {"": "", "pitch kept": "o takım eğimiyle ", "any": "yönelim ne olursa olsun "}
_POINTS = {"target": "hedef", "wrist": "bilek"}
_LINKS = {"arm": "kolun", "two links": "iki uzvun"}
_NO_SUCH_ANGLE = {
    "pitch": "bu kolun takımı kolun düşey düzleminde kalmaz, bu yüzden istenebilecek bir takım eğimi yok",
    "roll": "bu kolda takımı kendi ekseni çevresinde döndüren bir eklem yok",
    "elevation": "takımın eğimi -90° ile 90° arasındadır, hiçbir duruşta başka bir eğim olmaz",
}


def _way(one: targets.JointsNeeded) -> str:
    return _SIDES[one.side] + (" ve ".join(map(angle_needed, one.needs)) or "uzuvlar oraya yetişmiyor")


def _joints(one: targets.JointsNeeded) -> str:
    return f"{_LEAST if one.least else ''}{_way(one)}"


def _forbid(one: targets.LimitsForbid) -> str:
    said = f"uzuvlar {'o takım eğimiyle ' if one.pitched else ''}yetişiyor, ama eklem sınırları izin vermiyor"
    least = _LEAST if any(way.least for way in one.ways) else ""
    return f"{said}: {least}{'; '.join(map(_way, one.ways))}" if one.ways else said


def _miss(miss_m: float, *, far: bool) -> str:
    return f"{'' if far else 'ölü bölgede, '}{in_millimetres(miss_m)} mm fazla {'uzak' if far else 'yakın'}"


def _reach(length_m: float, *, far: bool) -> str:
    return f"{'en büyük' if far else 'en küçük'} erişimi {1000 * length_m:.1f} mm"


def _out_of_reach(one: targets.OutOfReach) -> str:
    shoulder = f"{one.shoulder} ekleminden" if one.shoulder else "omuzdan"
    pitched = "takım o eğimdeyken " if one.pitched else ""
    where = f"{shoulder} ölçülünce"
    if one.distance_m is not None:
        where = f"{_POINTS[one.point]} {shoulder} {1000 * one.distance_m:.1f} mm uzakta olurdu"
    reach = f"{_LINKS[one.links]} {_reach(one.length_m, far=one.far)}"
    return f"{_miss(one.miss_m, far=one.far)}: {_SIDES[one.side]}{pitched}{where}, {reach}"


def _out_of_bound(one: targets.OutOfBound) -> str:
    x, y, z = (1000.0 * value for value in one.centre_m)
    place = f"{one.joint} ekseni üzerindeki ({x:z.1f}, {y:z.1f}, {z:z.1f}) mm noktasından"
    reach = f"bütün uzuvların {_reach(one.length_m, far=one.far)}"
    return f"{_miss(one.miss_m, far=one.far)}: hedef {place} {1000 * one.distance_m:.1f} mm uzakta, {reach}"


def _cylinder(one: targets.InsideCylinder) -> str:
    radius = f"{1000 * one.radius_m:.2f} mm"
    return (
        f"taban ekseni çevresinde takım ucunun giremediği {radius} yarıçaplı silindirin içinde: "
        f"hedef eksenden {1000 * one.distance_m:.2f} mm uzakta, "
        f"takım düzlemi eksenin {radius} yanından geçiyor"
    )


def _beside_axis(one: targets.BesideAxis) -> str:
    miss = _miss(one.radius_m - one.distance_m, far=False)
    away = f"hedef taban ekseninden {1000 * one.distance_m:.1f} mm uzakta"
    return f"{miss}: {away}, kol eksene {1000 * one.radius_m:.1f} mm uzaklıkta kalıyor"


def _between(one: targets.BetweenReaches) -> str:
    near, far, least, most = (1000.0 * value for value in (one.near_m, one.far_m, one.least_m, one.most_m))
    return (
        f"iki yönden de olmuyor: bilek omuzdan {near:.1f} mm ya da {far:.1f} mm uzakta olurdu, "
        f"iki uzvun erişimi {least:.1f} mm … {most:.1f} mm"
    )


def _by_position(one: targets.PitchByPosition) -> str:
    pitches = " ya da ".join(dict.fromkeys(map(in_degrees, one.pitches)))
    return (
        "bu takım eğimi burada olanaksız: iki eğim eklemi olan kolda eğimi yalnız konum belirler; "
        f"uzuvlar {pitches} verirdi, sınırların içinde ya da dışında"
    )


def _pitch_outside(one: targets.PitchOutside) -> str:
    held = f"{one.joint} {in_degrees(one.held)} açısındayken " if one.joint else ""
    return (
        f"bu takım eğimi burada olanaksız: kol bu noktada {held}takımını "
        f"{in_degrees(one.low)} … {in_degrees(one.high)} eğimde tutabilir, istenene en yakını "
        f"{in_degrees(one.nearest)}"
    )


def _off_rotation(one: targets.OffRotation) -> str:
    return (
        "kol o noktaya erişiyor, ama o yönelimle değil: orada bulunan en yakın yönelim "
        f"{in_degrees(one.angle, '.3g')} sapıyor"
    )


def _impossible(one: targets.OrientationImpossible) -> str:
    if one.proven:
        return "istenen yönelime, eklem sınırları ne olursa olsun, uzuvlar izin vermiyor"
    return "eklem sınırları olmadan da bulunamadı"


def _not_found(one: targets.NotFound) -> str:
    turned = ", hiçbir yönelimle" if one.turned else ""
    nearer = f"{one.starts} başlangıcın hiçbiri hedefe {in_millimetres(one.away_m)} mm kadar bile yaklaşmadı"
    return f"çözüm bulunamadı{turned}: {nearer}"


def _pitch_not_found(one: targets.PitchNotFound) -> str:
    return (
        f"kol o noktaya erişiyor, ama {one.starts} başlangıcın hiçbiri orada {in_degrees(one.asked)} takım "
        f"eğimini bulamadı: en yakını {in_degrees(one.nearest)}"
    )


def _not_in_orientation(one: targets.NotInOrientation) -> str:
    return f"kol oraya {'o takım eğimiyle ' if one.pitched else ''}erişiyor, ama istenen yönelimle değil"


def _held(one: targets.HeldAtLimit) -> str:
    return f"{one.joint} {in_degrees(one.limit)} olan sınırında"


def _nearest(one: targets.NearestPoint) -> str:
    x, y, z = (1000.0 * value for value in one.point_m)
    inside = "eklem sınırları içinde " if one.held else ""
    held = f", orada {' ve '.join(map(_held, one.held))}" if one.held else ""
    point = f"({x:z.1f}, {y:z.1f}, {z:z.1f}) mm, {in_millimetres(one.away_m)} mm uzakta"
    return f"{inside}{_ORIENTATIONS[one.orientation]}erişilebilen en yakın nokta {point}{held}"


_AT_ANY_ANGLE = {
    "target on base axis": "hedef taban ekseninde, bu yüzden {} herhangi bir açıda olabilir",
    "wrist on shoulder axis": "bilek omuz ekseninde, bu yüzden {} herhangi bir açıda olabilir",
    "centre of wrist": "bileğin merkezi {} ekseninde, bu eklem herhangi bir açıda olabilir: biri listelendi",
}
_REACHED_FREE = {
    "pitch": "kol bu noktaya erişir, ama o eğimle değil: eğimi boş bırakın",
    "roll": "kol bu noktaya erişir, ama o dönme açısıyla değil: dönme açısını boş bırakın",
    "pitch and roll": "kol bu noktaya erişir, ama o eğim ve dönme açısıyla değil: ikisini de boş bırakın",
    "orientation": "kol bu noktaya erişir, ama o yönelimle değil: yönelimi boş bırakın",
}
_COUNTS = {"sum": "toplamı", "difference": "farkı"}


def _in_steps(one: targets.ListedInSteps) -> str:
    return (
        f"{one.joint} için {in_degrees(one.step, '.6g')} adımlarla listelendi; bundan kısa bir çözüm aralığı "
        "ve tekil bir duruşun başka çözümleri eksik olabilir"
    )


def _may_turn(one: targets.MayTurn) -> str:
    *others, last = one.joints
    joints = f"{', '.join(others)} ve {last} birlikte" if others else last
    return f"takım yerinde dururken {joints} dönebilir: sürekli bir kümenin bazı çözümleri listelendi"


def _turn_together(one: targets.TurnTogether) -> str:
    joints = f"{' ve '.join(one.joints)} birbirine karşı" if one.joints else "eklemler"
    return f"tekil: {joints} takımı oynatmadan dönebilir; bu sürekli kümeden seçmeler listelendi"


def _one_line(one: targets.OneLine) -> str:
    return (
        f"{' ve '.join(one.joints)} eksenleri burada tek bir doğru, bu yüzden açılarının yalnız "
        f"{_COUNTS[one.counts]} önemli: bir çift listelendi"
    )


def _instead(one: targets.Instead) -> str:
    if one.branch:
        return f"en yakın nokta için {one.branch} gerekir: kol duruşunu koruyor ve bekliyor"
    return "kol bekliyor" if one.what == "wait" else "en yakın nokta izleniyor"


def _unmet(one: targets.PoseUnmet) -> str:
    why = "" if one.reason else "pozun eklem açıları hâlâ hesaplanıyor"
    return f"poz alanları ile eklem açıları aynı poz değil: {why}"


def _left_out(one: targets.StrokeLeftOut) -> str:
    begin, end, length = (f"{1000 * value:.1f}" for value in (one.begin, one.end, one.length))
    part = (begin, end) != ("0.0", length)
    said = "{n}. çizgi (dosyanın {l}. satırı) çizilmeyecek"
    if part:
        said = "{n}. çizgi (dosyanın {l}. satırı) {c} mm içinde {a} ile {b} arasında çizilmeyecek"
    filled = said.format(n=one.stroke, l=one.line, a=begin, b=end, c=length)
    return filled if one.why is None else f"{filled}: "


def _step(one: targets.ToolStepRefused) -> str:
    step = f"buradan {in_signed_millimetres(one.step_m)} mm (tabanın x, y, z eksenlerinde)"
    if one.turns is None:
        return f"{step} erişim dışında; başka bir yöne adım atın"
    turns = in_degrees(one.turns, ".0f")
    return f"{step} bir eklemi {turns} üzerinde döndürürdü: daha küçük bir adım atın, ya da Go ile gidin"


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    targets.JointsNeeded: _joints,
    targets.LimitsForbid: _forbid,
    targets.OutOfReach: _out_of_reach,
    targets.OutOfBound: _out_of_bound,
    targets.InsideCylinder: _cylinder,
    targets.BesideAxis: _beside_axis,
    targets.BetweenReaches: _between,
    targets.NoSuchAngle: lambda one: _NO_SUCH_ANGLE[one.what],
    targets.PitchByPosition: _by_position,
    targets.PitchOutside: _pitch_outside,
    targets.PitchOfRods: lambda one: (
        f"çubuklar takımı {in_degrees(one.kept)} eğimde tutar; {in_degrees(one.asked)} olamaz"
    ),
    targets.NotInOrientation: _not_in_orientation,
    targets.OffRotation: _off_rotation,
    targets.OrientationImpossible: _impossible,
    targets.OrientationNeeds: lambda one: f"istenen yönelim için: {_joints(one.way)}",
    targets.NoOrientationNear: lambda _: "istenene yakın bir yönelim bulunamadı",
    targets.NotFound: _not_found,
    targets.PitchNotFound: _pitch_not_found,
    targets.NoneWithoutLimits: lambda one: (
        f"eklem sınırları olmadan da {one.starts} başlangıcın hiçbiri oraya varmadı"
    ),
    targets.MayExist: lambda _: "bulunamamış bir çözüm olabilir",
    targets.Searched: lambda one: (
        f"aramayla bulundu, başkaları olabilir{': sürekli bir küme oluşturuyorlar' if one.continuum else ''}"
    ),
    targets.MoreByTurns: lambda one: f"{one.count} çözüm daha var, tam turlarla ayrılıyorlar",
    targets.ListedAt: lambda one: (
        f"{one.joint} da serbest: {in_degrees(one.angle)} açısındayken olan çözümler listelendi"
    ),
    targets.ListedInSteps: _in_steps,
    targets.MayTurn: _may_turn,
    targets.AnyAngle: lambda one: _AT_ANY_ANGLE[one.what].format(one.joint),
    targets.TurnTogether: _turn_together,
    targets.OneLine: _one_line,
    targets.MayBeHidden: lambda _: "tekil bir duruşa yakın: yuvarlama başka çözümleri gizleyebilir",
    targets.LostAtLimit: lambda one: (
        f"{one.joint} sınırındayken bir çözüm eksik olabilir: ona yuvarlama karar veriyor"
    ),
    targets.Instead: _instead,
    targets.PoseUnmet: _unmet,
    targets.StrokeLeftOut: _left_out,
    targets.ToolStepRefused: _step,
    targets.OtherConfiguration: lambda _: "kol orada başka bir çözüme geçmek zorunda kalır",
    targets.Besides: lambda _: "ayrıca ",
    targets.ReachedFree: lambda one: _REACHED_FREE[one.without],
    targets.AtRoll: lambda one: f"{one.joint} en çok yaklaştığı {in_degrees(one.roll)} açısındayken: ",
    targets.AtPoint: lambda one: f"{one.count} noktadan {one.number}. nokta: ",
    targets.HeldAtLimit: _held,
    targets.NearestPoint: _nearest,
    targets.PointReached: lambda _: "noktanın kendisine erişilebilir",
}
"""Of reasons with a reason inside (``PoseUnmet``, ``StrokeLeftOut``, …) what is said ahead of that."""
