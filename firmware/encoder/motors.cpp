#include "motors.h"

#include <avr/io.h>
#include <util/atomic.h>

#include "config.h"

namespace {

volatile uint16_t *const DUTY[AXES] = {&OCR3A, &OCR3B, &OCR3C, &OCR4A, &OCR4B, &OCR4C};

// Phase-correct PWM up to twice the full drive: 15.7 kHz, with true 0 % and 100 % at the ends.
constexpr uint16_t TOP = 2 * FULL_DRIVE;

constexpr uint8_t ENABLE = _BV(PH6);
constexpr uint8_t LAMP = _BV(PB7);

volatile bool on;

} // namespace

namespace motors {

void begin() {
    cut();
    DDRC |= 0x3F;
    DDRE |= _BV(PE3) | _BV(PE4) | _BV(PE5);
    DDRH |= _BV(PH3) | _BV(PH4) | _BV(PH5) | ENABLE;
    DDRB |= LAMP;
    // The mode first, and the clock last: in a mode that does not count to ICR, ICR cannot be written.
    TCCR3A = TCCR4A = _BV(COM3A1) | _BV(COM3B1) | _BV(COM3C1) | _BV(WGM31);
    TCCR3B = TCCR4B = _BV(WGM33);
    ICR3 = ICR4 = TOP;
    TCCR3B = TCCR4B = _BV(WGM33) | _BV(CS30);
}

void enable() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        on = true;
        PORTH |= ENABLE;
        PORTB |= LAMP;
    }
}

void cut() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        on = false;
        PORTH &= static_cast<uint8_t>(~ENABLE);
        PORTB &= static_cast<uint8_t>(~LAMP);
        for (uint8_t axis = 0; axis < AXES; ++axis) *DUTY[axis] = 0;
    }
}

bool enabled() { return on; }

void drive(uint8_t axis, int16_t value) {
    const bool backward = value < 0;
    const uint16_t duty = static_cast<uint16_t>(2 * (backward ? -value : value));
    const uint8_t direction = static_cast<uint8_t>(1 << axis);
    // Looked at and written in one go: cut() may come from the receive interrupt at any moment.
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        volatile uint16_t &output = *DUTY[axis];
        const bool was_backward = PORTC & direction;
        if (backward != was_backward && output != 0) {
            output = 0; // a tick without drive; the timer takes a duty only at the end of its period
        } else {
            if (backward) PORTC |= direction;
            else PORTC &= static_cast<uint8_t>(~direction);
            output = on ? duty : 0;
        }
    }
}

} // namespace motors
