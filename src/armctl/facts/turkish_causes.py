"""What is said of each cause of a tool that is off, in Turkish."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts import causes
from armctl.facts.angles import in_degrees, to_degrees
from armctl.facts.reasons import Reason, decimals_apart, in_millimetres

_ALONG = 0.98
"""bir doğrultuyu eksen saydıran pay"""
_NUMBERS = {
    "zero": "sıfırını", "sag": "sarkmasını", "play": "boşluğunu", "scale": "ölçeğini", "a": "a_mm uzunluğunu",
    "d": "d_mm uzunluğunu", "place": "noktaların yerini", "tilt": "noktaların eğimini",
    "heading": "noktaların yönünü",
}  # fmt: skip

_TOO_FEW = {
    "marks": "{} işaret çok az: birbirinden uzak {} tane gerekli; 4 ya da daha çoğuyla yanlış olan bulunur",
    "touches": "{} dokunuş çok az: noktaya en az {} yandan dokunun, aralarda takımı olabildiğince döndürün",
    "points": "{} nokta çok az: kolun farklı duruşlarında en az {}, daha iyisi 10 noktaya dokunun",
}


def _narrow(one: causes.MarksNarrow) -> str:
    spread, least = to_degrees(one.spread), to_degrees(one.least)
    angle = f"{spread:.{decimals_apart(spread, least, least=1)}f}°"
    return (
        f"işaretlerin açıları yalnız {angle} yayılıyor: daha uzak "
        f"alın, en az {least:.0f}°, daha iyisi eklemin bütün aralığı"
    )


def _give(sd: float) -> str:
    return f"± {in_degrees(sd, '.1f')}"


def _figures(one: causes.FitFigures) -> str:
    def size(rms: float, largest: float) -> str:
        return f"RMS {1000 * rms:.2f} mm, en çok {1000 * largest:.2f} mm"

    text = f"{one.count} noktada, her biri sırayla dışarıda bırakılınca takım hatası: "
    text += size(one.before, one.before_largest)
    if not one.corrected:
        return text
    after = f"düzeltmeyle {size(one.after, one.after_largest)}"
    return f"{text}; {after}; yakında RMS {1000 * one.low:.1f} … {1000 * one.high:.1f} mm (10'da 9)"


def _length(one: causes.LengthOff) -> str:
    old, new = 1000 * one.old, 1000 * (one.old + one.off)
    sure = f"{1000 * one.off:+.1f} mm ± {1000 * one.sd:.1f}"
    return f"DH satırı {one.row}: {one.key}_mm {old:.1f} değil, {new:.1f} mm ({sure})"


def _tip(one: causes.TaughtTip) -> str:
    x, y, z = (f"{1000 * value:.2f}" for value in one.offset)
    return (
        f"uç, robotun takım noktasından takımın eksenleri boyunca ({x}, {y}, {z}) mm uzakta, "
        f"± {1000 * one.sd:.2f} mm; {one.count} dokunuş {1000 * one.residual:.2f} mm içinde buluşuyor (RMS), "
        f"en çok {one.worst}. dokunuş sapıyor: {1000 * one.away:.2f} mm"
    )


def _axis(axis: tuple[float, float, float]) -> str:
    largest = max(range(3), key=lambda i: abs(axis[i]))
    if abs(axis[largest]) > _ALONG:
        return f"takımın {'xyz'[largest]} ekseni"
    return "takımın ({}) doğrultusu".format(", ".join(f"{value:.2f}" for value in axis))


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    causes.ZeroOff: lambda one: f"sıfırı {to_degrees(one.off):+.1f}° kaymış ({_give(one.sd)})",
    causes.Sags: lambda one: f"uzanınca {in_degrees(one.angle, '.1f')} sarkıyor ({_give(one.sd)})",
    causes.HasPlay: lambda one: f"{in_degrees(one.angle, '.1f')} boşluk var ({_give(one.sd)})",
    causes.ScaleOff: lambda one: f"%{100 * one.share:+.1f} fazla dönüyor (± %{100 * one.sd:.1f})",
    causes.LengthOff: _length,
    causes.PlaceOff: lambda one: f"bütün noktalar bu eksende {in_millimetres(one.off)} mm ileride",
    causes.MistakenPoint: lambda one: (
        f"{one.number}. nokta, ötekilerin gösterdiği yerden {in_millimetres(one.away)} mm uzakta; "
        f"hesaba katılmadı; uç, oraya göre {causes.in_signed_millimetres(one.off)} mm (x, y, z) ötedeydi"
    ),
    causes.WorstPoint: lambda one: (
        f"en az uyan {one.number}. nokta: uç, ötekilerin gösterdiği yere göre "
        f"{causes.in_signed_millimetres(one.off)} mm (x, y, z) ötedeydi"
    ),
    causes.NotTold: lambda one: f"bu noktalar {_NUMBERS[one.what]} göstermiyor; olduğu gibi kalıyor",
    causes.FitFigures: _figures,
    causes.GoodAlready: lambda one: (
        f"hatayı rastlantıdan iyi açıklayan bir sayı yok: {in_millimetres(one.rms)} mm, noktalara dokunarak "
        "ölçülebilecek kadardır"
    ),
    causes.NotBetter: lambda one: (
        f"hiçbir düzeltme dışarıda bırakılan noktalarda daha iyi değil: düzeltmesiz "
        f"{in_millimetres(one.before)} mm, en iyisiyle {in_millimetres(one.after)} mm"
    ),
    causes.TaughtTip: _tip,
    causes.TipAsBefore: lambda _: "uç, dokunuşların gösterebildiği kadarıyla robotun bildiği yerde",
    causes.TipUntold: lambda one: (
        f"ucun {_axis(one.axis)} boyunca yeri ancak ± {1000 * one.sd:.1f} mm ile biliniyor: takım başka "
        "eksenler çevresinde az döndürüldü"
        if one.sd is not None
        else f"ucun {_axis(one.axis)} boyunca yeri bilinmiyor: takım yalnız bu eksen çevresinde döndürüldü; "
        "olduğu gibi kalıyor"
    ),
    causes.TooFew: lambda one: _TOO_FEW[one.of].format(one.count, one.least),
    causes.MarksTogether: lambda one: (
        f"işaretler yalnız {one.places} yerde: eklemin aralığında {one.least} ya da daha çok yerde alın"
        if one.output is None
        else f"bütün işaretler aynı yerde, {one.output:.1f} {one.unit}: işaretler arasında eklemi oynatın"
    ),
    causes.MarksNarrow: _narrow,
    causes.PointsTogether: lambda one: (
        f"noktaların hepsi birbirine {1000 * one.within:.0f} mm'den yakın: kolun çalışma alanına yayın"
    ),
    causes.ToolTurnedLittle: lambda one: (
        f"takım dokunuştan dokunuşa yalnız {in_degrees(one.turn, '.0f')} döndürüldü: 60° ya da daha çok "
        "döndürün, yoksa ucu bilinemez"
    ),
    causes.PlanePointsNear: lambda one: (
        f"dokunulan {one.first} ve {one.second} numaralı noktalar arası {1000 * one.apart:.1f} mm; en az "
        f"{1000 * one.least:g}"
    ),
    causes.PlanePointsInLine: lambda _: (
        "dokunulan üç nokta neredeyse tek doğru üzerinde; üçüncüye bu doğrunun yanında dokunun"
    ),
    causes.PlaneFromBelow: lambda _: (
        "üçüncü nokta yukarıdan bakınca birinciden ikinciye giden yolun sağında kalıyor, kalem alttan "
        "gelirdi; öbür yanda dokunun"
    ),
    causes.PlanePointOff: lambda one: (
        f"dokunulan {one.number}. nokta ilk üçünün düzleminden {1000 * one.off:.1f} mm uzakta; en çok "
        f"{1000 * one.most:g}"
    ),
    causes.PlaneOutOfReach: lambda _: (
        "hiçbir boyutu bu düzlemde bütünüyle erişim içinde değil; düzleme kolun iyi eriştiği yerde dokunun"
    ),
}
ADVICE: Mapping[type[Reason], Callable[[Any], str]] = {
    causes.ZeroOff: lambda one: (
        "düzeltmeyi kaydedin ya da servo kolunu yeniden takın"
        if abs(one.off) < 0.17
        else "servo kolunu yeniden takın"
    ),
    causes.Sags: lambda _: "düzeltmeyi kaydedin; daha az yük taşıyın ya da bağlantıyı güçlendirin",
    causes.HasPlay: lambda _: "bu eklemin servo kolunu ve vidalarını sıkın",
    causes.ScaleOff: lambda _: "bu eklemi iletkiyle ölçün (Calibration → Joints)",
    causes.LengthOff: lambda _: "ölçün ve robot dosyasına yazın",
    causes.PlaceOff: lambda _: "noktaların yerini yeniden ölçün",
    causes.MistakenPoint: lambda _: "bu noktaya yeniden dokunun",
    causes.NotBetter: lambda _: "birbirinden daha farklı duruşlarda, iki yandan, daha çok noktaya dokunun",
    causes.TipUntold: lambda _: "takımı başka bir eksen çevresinde de daha çok döndürün",
}
