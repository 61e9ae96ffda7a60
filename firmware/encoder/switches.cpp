#include "switches.h"

#include <avr/io.h>

#include "config.h"

void Switches::begin() { PORTA |= 0x3F; }

void Switches::sample(uint8_t opens) {
    const uint8_t now = static_cast<uint8_t>((~PINA ^ opens) & 0x3F);
    const uint8_t changed = now ^ touched_;
    touched_ = now;
    for (uint8_t axis = 0; axis < AXES; ++axis) {
        const uint8_t bit = static_cast<uint8_t>(1 << axis);
        if (changed & bit) same_[axis] = 0;
        if (same_[axis] < SETTLED && ++same_[axis] == SETTLED) {
            pressed_ = static_cast<uint8_t>((pressed_ & ~bit) | (now & bit));
        }
    }
}
