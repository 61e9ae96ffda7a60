#include "serial_port.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "config.h"
#include "motors.h"
#include "ring.h"

namespace {

Ring<char, 256> incoming;
Ring<char, 256> outgoing;
volatile bool overrun;
bool gap; // bytes were lost since the last one in the queue
volatile uint8_t statuses_wanted;
volatile bool overtaken;      // by a stop, as far as
volatile uint8_t overtaken_to; // this place in the queue
volatile serial_port::Requests requests;

// Where bytes are missing a NUL stands for them. Without it a damaged line that loses just its damage,
// or two lines that lose what parts them, could be whole again.
void keep(char byte) {
    if (gap && !incoming.put('\0')) return;
    gap = !incoming.put(byte);
    if (gap) overrun = true;
}

// A stop has come in before the lines that still wait in the queue were carried out.
void overtake() {
    overtaken_to = incoming.head();
    overtaken = true;
}

} // namespace

// Single bytes act here, before any line is looked at and even when the lines are backed up.
ISR(USART0_RX_vect) {
    const uint8_t damage = UCSR0A & (_BV(FE0) | _BV(DOR0));
    const char byte = static_cast<char>(UDR0);
    if (damage) overrun = gap = true;
    switch (byte) {
    case 0x18:
        motors::cut();
        requests.stop = true;
        overtake();
        break;
    case '!':
        // The later of two wins within one tick; a release that came just before does not undo it.
        requests.release = false;
        requests.hold = true;
        overtake();
        break;
    case '~':
        // What stops acts even if the byte came damaged; what sets free does not.
        if (!damage) requests.release = true;
        break;
    case '?':
        if (statuses_wanted != 0xFF) ++statuses_wanted;
        break;
    default: keep(byte);
    }
}

ISR(USART0_UDRE_vect) {
    if (outgoing.empty()) {
        UCSR0B &= static_cast<uint8_t>(~_BV(UDRIE0));
    } else {
        UDR0 = static_cast<uint8_t>(outgoing.take());
    }
}

namespace serial_port {

void begin() {
    UCSR0A = _BV(U2X0);
    UBRR0 = static_cast<uint16_t>((CPU_HZ / 4 / BAUD - 1) / 2);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

bool received() { return !incoming.empty(); }

char take() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (incoming.tail() == overtaken_to) overtaken = false;
    }
    return incoming.take();
}

bool stopped_since() { return overtaken; }

uint8_t room() { return outgoing.room(); }

void send(const char *bytes, uint8_t count) {
    while (count--) outgoing.put(*bytes++);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { UCSR0B |= _BV(UDRIE0); }
}

bool take_overrun() {
    const bool was = overrun;
    if (was) overrun = false;
    return was;
}

bool take_status_request() {
    bool was = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        was = statuses_wanted != 0;
        if (was) --statuses_wanted;
    }
    return was;
}

Requests take_requests() {
    Requests taken;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        taken.stop = requests.stop;
        taken.hold = requests.hold;
        taken.release = requests.release;
        requests.stop = requests.hold = requests.release = false;
    }
    return taken;
}

} // namespace serial_port
