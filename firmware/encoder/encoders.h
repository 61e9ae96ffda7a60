// Quadrature decoding of all axes, four counts a period, in interrupts. A leading B counts up.
#pragma once

#include <stdint.h>

namespace encoders {

void begin();

// Counts since the last call; called every control tick, in which no encoder makes 127 counts.
int8_t take(uint8_t axis);

// Signs of a broken encoder since the last forget_signs(). A wire that hangs leaves only one channel
// changing; a good encoder that turns changes them in turn. Both changing at once means lost edges.
bool broken(uint8_t axis);
void forget_signs();

} // namespace encoders
