"""What is said of servos that are not as an arm needs them, in Turkish."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts import servos
from armctl.facts.angles import in_degrees
from armctl.facts.reasons import Reason

_REGISTERS = {
    "offset": "sıfır kayması",
    "lowest": "en küçük konumu",
    "highest": "en büyük konumu",
    "mode": "çalışma kipi",
}

_UNCONFIRMED = {
    "told": "kendisine söyleneni doğrulamıyor",
    "on": "torkunu açmadı",
    "locked": "EEPROM'unu kilitlemedi; bir kez daha deneyin",
    "open": "EEPROM'unu açmadı; bir kez daha deneyin",
}


def _plug(one: servos.ServoSilent) -> str:
    if one.behind is not None:
        return f"{one.behind} numaralı servonun önündeki fişe bakın: arkasındakilerin hepsi susuyor"
    if one.stranger is not None:
        return f"{one.stranger} olarak yanıt veren oysa, ona {one.servo} numarasını verin"
    return "fişine bakın; yeni bir servonun numarası 1'dir: tek başına takın ve numarasını verin"


def _range(one: servos.ServoRange) -> str:
    return (
        f"servo {one.servo}: kendi sınırları {one.lowest} … {one.highest}, robot dosyasındaki "
        f"{one.minimum:g} … {one.maximum:g} adımın bir bölümünü kesiyor"
    )


def _changed(one: servos.ServoChanged) -> str:
    return (
        f"servo {one.servo}: {_REGISTERS[one.register]} {one.now}; armctl sakladığında {one.kept} idi: o "
        "zamandan beri başka bir program değiştirdi"
    )


def _not_taken(one: servos.ServoNotTaken) -> str:
    if one.register == "goal":
        return f"servo {one.servo} hedef olarak {one.number} adımı almadı, hedefi {one.has}"
    return f"servo {one.servo} {one.register} olarak {one.number} değerini almadı"


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    servos.ServoSilent: lambda one: (
        f"servo {one.servo}{f' ({one.joint})' if one.joint else ''} yanıt vermiyor"
    ),
    servos.ServoStranger: lambda one: f"servo {one.servo} bu kolun değil",
    servos.ServoAtBaud: lambda one: f"servo {one.servo} {one.baud} baud hızında yanıt veriyor",
    servos.ServoUnfit: lambda one: f"servo {one.servo}: {one.why}",
    servos.ServoRange: _range,
    servos.ServoOffset: lambda one: f"servo {one.servo}: sıfır kayması {one.offset} adım",
    servos.ServoSeam: lambda one: (
        f"eklem, servosunun turunun sonunu geçiyor; orada {one.turn - 1:.0f} adımdan sonra 0 gelir: "
        f"{one.high:.0f} ve {one.low:.0f} adımda durdu"
    ),
    servos.ServoTold: lambda one: f"servo {one.servo}: {one.words}",
    servos.ServoChanged: _changed,
    servos.ServoUnconfirmed: lambda one: f"servo {one.servo} {_UNCONFIRMED[one.what]}",
    servos.ServoNotTaken: _not_taken,
    servos.ServoTorqueOn: lambda one: f"servo {one.servo}: torku açık; EEPROM'u yazılmadan önce kolu bırakın",
    servos.ServoTurned: lambda one: (
        f"servo {one.servo} bakıldığından beri {in_degrees(one.turn, '.1f')} döndü; kolu kıpırdatmayın, yine "
        "etkinleştirin"
    ),
    servos.ServoTurning: lambda one: (
        f"servo {one.servo} torku açılırken dönüyor; kolu sabit tutun"
        if one.enabling
        else f"servo {one.servo}: okumaları farklı, dönüyor: durmasını bekleyip yine deneyin"
    ),
    servos.ServoOutside: lambda one: (
        f"servo {one.servo} {one.place}. adımda, kendi EEPROM'undaki {one.lowest} … {one.highest} "
        f"sınırlarının dışında: tork açılınca {in_degrees(one.jump, '.1f')} fırlar. Elle geri çevirin, ya da "
        "o sınırları yeniden yazın"
    ),
}
ADVICE: Mapping[type[Reason], Callable[[Any], str]] = {
    servos.ServoSilent: _plug,
    servos.ServoStranger: lambda _: "çıkarın, ya da eksik olan numarayı verin",
    servos.ServoAtBaud: lambda one: f"armctl {one.wanted} ile konuşur: ayarlayın",
    servos.ServoUnfit: lambda _: "adı geçen yazmacı yazın",
    servos.ServoRange: lambda _: "onları genişletin, ya da eklemin sınırlarını daraltın",
    servos.ServoOffset: lambda _: "kol bununla kalibre edildiyse saklayın",
    servos.ServoSeam: lambda one: (
        f"eklem ortada ve servo {one.turn / 2:.0f} adım dolayındayken kolu yeniden takın; ya da sıfır "
        "kaymasını buna göre ayarlayın"
    ),
    servos.ServoChanged: lambda one: f"yine {one.kept} yazın, ya da şimdiki gibi saklayın",
}
