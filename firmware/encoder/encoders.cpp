#include "encoders.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "config.h"

namespace {

struct Channel {
    volatile int8_t counts;
    uint8_t levels;           // B A, as last seen
    uint8_t changed;          // the channel that changed last
    volatile uint8_t repeats; // how often in a row that was the same one
    volatile uint8_t doubles; // how often both changed at once
};

Channel channels[AXES];

// A joint that hunts about one edge repeats a channel too, but slowly: its control has a dead band.
constexpr uint8_t REPEATS_OF_TORN_WIRE = 40;
constexpr uint8_t DOUBLES_OF_BAD_ENCODER = 8;

// Counts by the old and the new levels, 4 * old + new; 0 where nothing or both changed.
const int8_t STEP[16] = {0, 1, -1, 0, -1, 0, 0, 1, 1, 0, 0, -1, 0, -1, 1, 0};

inline __attribute__((always_inline)) void look(Channel &channel, uint8_t levels) {
    const uint8_t old = channel.levels;
    const uint8_t changed = old ^ levels;
    if (!changed) return;
    channel.levels = levels;
    if (changed == 3) {
        if (channel.doubles != 255) ++channel.doubles;
        return;
    }
    channel.counts += STEP[old << 2 | levels];
    if (changed != channel.changed) {
        channel.changed = changed;
        channel.repeats = 0;
    } else if (channel.repeats != 255) {
        ++channel.repeats;
    }
}

} // namespace

ISR(INT0_vect) { look(channels[0], PIND & 3); }
ISR(INT1_vect, ISR_ALIASOF(INT0_vect));
ISR(INT2_vect) { look(channels[1], PIND >> 2 & 3); }
ISR(INT3_vect, ISR_ALIASOF(INT2_vect));

ISR(PCINT2_vect) {
    const uint8_t port = PINK;
    look(channels[2], port & 3);
    look(channels[3], port >> 2 & 3);
    look(channels[4], port >> 4 & 3);
    look(channels[5], port >> 6);
}

namespace encoders {

void begin() {
    PORTD |= 0x0F;
    PORTK = 0xFF;
    for (uint8_t i = 0; i < 2; ++i) channels[i].levels = PIND >> (2 * i) & 3;
    for (uint8_t i = 0; i < 4; ++i) channels[2 + i].levels = PINK >> (2 * i) & 3;
    EICRA = _BV(ISC00) | _BV(ISC10) | _BV(ISC20) | _BV(ISC30); // any edge
    EIFR = 0x0F;
    EIMSK = 0x0F;
    PCMSK2 = 0xFF;
    PCIFR = _BV(PCIF2);
    PCICR = _BV(PCIE2);
}

int8_t take(uint8_t axis) {
    int8_t counts;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        counts = channels[axis].counts;
        channels[axis].counts = 0;
    }
    return counts;
}

bool broken(uint8_t axis) {
    return channels[axis].repeats >= REPEATS_OF_TORN_WIRE || channels[axis].doubles >= DOUBLES_OF_BAD_ENCODER;
}

void forget_signs() {
    for (Channel &channel : channels) channel.repeats = channel.doubles = 0;
}

} // namespace encoders
