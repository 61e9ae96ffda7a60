"""What is said of a command that is refused, or ended before it was over, in Turkish."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts import commands
from armctl.facts.commands import range_texts
from armctl.facts.reasons import Reason
from armctl.facts.turkish import STATES

_NOTHING = {
    "resume": "sürdürülecek bir şey yok",
    "clear": "silinecek bir arıza yok",
    "release": "bırakılacak bir şey yok",
}
_NEWER = {
    "gripper": "yerini daha yeni bir tutucu komutu aldı",
    "edit": "ardından başka bir düzenleme geldi",
}
_SHARES = {
    "speed": "hız",
    "opening": "açıklık",
    "torque limit": "tork sınırı",
    "input": "giriş {}:",
    "output": "çıkış {}:",
    "gripper": "{}:",
}
_KINDS = {"joint": "eklem", "input": "giriş", "output": "çıkış", "pose": "poz", "point": "nokta"}
_STOPPED = {"stopped": "durduruldu", "cancelled": "iptal edildi", "unbegun": "başlamadan durduruldu"}
_OUTPUTS = {"channel": "kanal", "pin": "pin", "servo": "servo"}

_SAY_WHERE = (
    "Nerede durduğunu söyleyin: sayfada, armctl run --pose last ile (ya da adlı bir poz, ya da derece olarak "
    'eklem açıları), ya da arm.enable(pose="last") ile'
)


def _took(one: commands.LineSlow) -> str:
    return f"{1000 * one.took:.0f} ms kadar sürdü" if math.isfinite(one.took) else "hepsi zamanında gelmedi"


def _stopped(one: commands.Stopped) -> str:
    note = f": {one.note}" if one.note and one.how != "unbegun" else ""
    return f"{f'{one.what} ' if one.what else ''}{_STOPPED[one.how]} ({one.by or 'siz'}{note})"


def _not_operator(one: commands.NotOperator) -> str:
    if one.operator:
        return f"kolu {one.operator} yönetiyor; önce denetimi alın"
    if one.locked:
        return "öğretmen denetimi kilitledi; öğretmenin PIN'ini verin"
    return "kolu kimse yönetmiyor; önce denetimi alın"


def _locked(one: commands.ControlLocked) -> str:
    pin = ", ya da öğretmenin PIN'ini verin" if one.pin else ""
    return f"denetimi {one.by or 'öğretmen'} kilitledi; açılmasını isteyin{pin}"


def _share(one: commands.ShareOutside) -> str:
    scale, unit = (1, "") if one.of in ("input", "output") else (100, "%")
    text, least, most = range_texts(scale * one.share, scale * one.low, scale * one.high)
    head = _SHARES[one.of].format(one.name)
    return f"{head} {unit}{text}, {unit}{least} … {unit}{most} dışında"


def _unknown(one: commands.UnknownName) -> str:
    whose = f"{one.robot}: " if one.robot else ""
    known = f"olanlar: {', '.join(one.known)}" if one.known else "hiç yok"
    return f"{whose}{one.name!r} adında {_KINDS[one.kind]} yok; {known}"


def _on(one: commands.ReleaseUnconfirmed) -> str:
    outputs = f"{_OUTPUTS[one.noun]} {', '.join(map(str, one.outputs))}"
    who = f"{one.board} " if one.board else ""
    return (
        f"{one.line}: {who}kapandığını doğrulamadı ({outputs}); kol hâlâ tutuluyor olabilir. Elinizi "
        "uzatmadan önce servoların gücünü kesin"
    )


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    commands.Stopped: _stopped,
    commands.Released: lambda one: f"{'eklemler' if one.joints else 'kol'} bırakıldı ({one.by})",
    commands.NotOperator: _not_operator,
    commands.ControlLocked: _locked,
    commands.NothingTo: lambda one: f"{_NOTHING[one.do]}: {STATES[one.state]}",
    commands.NoBoard: lambda _: "kart yok; önce bağlanın",
    commands.Disconnected: lambda one: (
        f"{one.opening} açılırken bağlantı kesildi" if one.opening else "bağlantı kesildi"
    ),
    commands.Superseded: lambda one: _NEWER[one.by],
    commands.PlanningAlready: lambda _: "başka bir hareket planlanıyor; önce onu durdurun",
    commands.PlannedTooLong: lambda one: f"planlama {one.limit_s:.0f} s'den uzun sürdü; hareketi küçültün",
    commands.StartLeft: lambda _: "kol artık hareketin planlandığı yerde durmuyor; yeniden isteyin",
    commands.AfterGap: lambda one: (
        f"başlayamadan önce {one.gap_s:.1f} s boyunca hiçbir şey çalışmadı; yeniden isteyin"
    ),
    commands.ShareOutside: _share,
    commands.NotDigital: lambda one: f"çıkış {one.name} dijital: 0 ya da 1, {one.value:g} değil",
    commands.UnknownName: _unknown,
    commands.NoSuchStep: lambda one: f"{one.program}: adım {one.step} yok; {one.steps} adımı var",
    commands.PoseUnknown: lambda one: (
        f"kolun nerede durduğunu kimse bilmiyor{f' ({one.last})' if one.last else ''}: gücü kapalı "
        f"({one.power}). {_SAY_WHERE}"
    ),
    commands.NothingOn: lambda one: f"{'; '.join(one.errors)}; hiçbir şey açılmadı",
    commands.LineSlow: lambda one: (
        f"hat çok yavaş: kartın yanıtları {_took(one)}, güvenli olan en çok {1000 * one.most:.0f} ms; hiçbir "
        "şey açılmadı. USB dağıtıcıyı, ağı ve baud hızını denetleyin"
    ),
    commands.MotorsApart: lambda one: (
        f"iki motoru birbirinden ayrı duran eklemler: {', '.join(one.joints)}; biri ötekine sürülürdü. Kolu "
        "bırakın, düzeltin ve yeniden etkinleştirin"
    ),
    commands.ReadingsDiffer: lambda one: (
        f"kartın iki okuması farklı ({', '.join(one.joints)}); durmasını bekleyip yeniden deneyin"
    ),
    commands.OnUnconfirmed: lambda one: (
        f"kart gücün açıldığını doğrulamadı ({one.power}), bir bölümü açık olabilir: uzak durun, "
        "gücü olduğuna bakın, Release'e basın ve yeniden deneyin"
    ),
    commands.ReleaseUnconfirmed: _on,
}
