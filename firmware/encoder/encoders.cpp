#include "encoders.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "config.h"

namespace {

struct Channel {
    volatile int16_t counts;
    volatile uint8_t lost;    // edges
    volatile uint8_t turned;  // changes of direction
    volatile uint8_t repeats; // changes of direction in a row: the same channel changes again and again
    bool up;                  // the direction of the last count
    uint8_t at;               // when that was [16 us]
    uint8_t lost_lately;      // of lost, since forget_signs(); not for the interrupts
};

Channel channels[AXES];
// The ports as last seen: A of the first axis is bit 0, its B bit 1, and so on.
uint8_t port_d, port_k;

// A joint that hunts about one edge repeats a channel too, but slowly: its control has a dead band.
constexpr uint8_t REPEATS_OF_TORN_WIRE = 40;
constexpr uint8_t LOST_BY_BAD_ENCODER = 8;
// A flank that bounces comes back within microseconds and loses nothing; a pulse that is missing takes two
// edges' time, 330 us at full speed. [16 us]
constexpr uint8_t BOUNCE = 3;

// Six encoders at full speed keep the interrupts busy for a third of the time: every cycle counts here.
template <uint8_t Axis, uint8_t Shift>
inline __attribute__((always_inline)) void look(uint8_t old, uint8_t levels) {
    constexpr uint8_t A = 1 << Shift, B = 2 << Shift;
    const uint8_t changed = (old ^ levels) & (A | B);
    if (!changed) return;
    Channel &channel = channels[Axis];
    if (changed == (A | B)) {
        channel.lost = channel.lost + 1;
        return;
    }
    const uint8_t now = TCNT0;
    const uint8_t since = static_cast<uint8_t>(now - channel.at);
    channel.at = now;
    // Upward, the new A is the other one of the old B.
    const bool up = !(old & B) == !!(levels & A);
    channel.counts = static_cast<int16_t>(channel.counts + (up ? 1 : -1));
    if (up == channel.up) {
        channel.repeats = 0;
        return;
    }
    channel.up = up;
    if (since >= BOUNCE) channel.turned = channel.turned + 1;
    if (channel.repeats != 255) channel.repeats = channel.repeats + 1;
}

} // namespace

ISR(INT0_vect) {
    const uint8_t now = PIND, old = port_d;
    port_d = now;
    look<0, 0>(old, now);
    look<1, 2>(old, now);
}
ISR(INT1_vect, ISR_ALIASOF(INT0_vect));
ISR(INT2_vect, ISR_ALIASOF(INT0_vect));
ISR(INT3_vect, ISR_ALIASOF(INT0_vect));

ISR(PCINT2_vect) {
    const uint8_t now = PINK, old = port_k;
    port_k = now;
    look<2, 0>(old, now);
    look<3, 2>(old, now);
    look<4, 4>(old, now);
    look<5, 6>(old, now);
}

namespace encoders {

void begin() {
    PORTD |= 0x0F;
    PORTK = 0xFF;
    port_d = PIND;
    port_k = PINK;
    TCCR0B = _BV(CS02); // 16 us a step
    EICRA = _BV(ISC00) | _BV(ISC10) | _BV(ISC20) | _BV(ISC30); // any edge
    EIFR = 0x0F;
    EIMSK = 0x0F;
    PCMSK2 = 0xFF;
    PCIFR = _BV(PCIF2);
    PCICR = _BV(PCIE2);
}

Seen take(uint8_t axis) {
    Channel &channel = channels[axis];
    Seen seen;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        seen = {channel.counts, channel.lost, channel.turned};
        channel.counts = 0;
        channel.lost = channel.turned = 0;
    }
    if (seen.lost > 255 - channel.lost_lately) channel.lost_lately = 255;
    else channel.lost_lately = static_cast<uint8_t>(channel.lost_lately + seen.lost);
    return seen;
}

bool broken(uint8_t axis) {
    return channels[axis].repeats >= REPEATS_OF_TORN_WIRE || channels[axis].lost_lately >= LOST_BY_BAD_ENCODER;
}

void forget_signs() {
    for (Channel &channel : channels) channel.repeats = channel.lost_lately = 0;
}

} // namespace encoders
