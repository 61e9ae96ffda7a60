// Quadrature decoding of all axes, four counts a period, in interrupts. A leading B counts up.
#pragma once

#include <stdint.h>

namespace encoders {

void begin();

// What an encoder has done since the last call.
struct Seen {
    int16_t counts;
    uint8_t lost;   // edges: both channels had changed at once, so one edge was not seen. 2 counts each
    uint8_t turned; // how often the direction changed, bounces of an edge left out
};
// Every control tick.
Seen take(uint8_t axis);

// Signs of a broken encoder since the last forget_signs(). A wire that hangs leaves only one channel
// changing; a good encoder that turns changes them in turn. Many lost edges are a sign as well.
bool broken(uint8_t axis);
void forget_signs();

} // namespace encoders
