// The H-bridges: PWM and direction for each axis, one enable for all.
#pragma once

#include <stdint.h>

namespace motors {

void begin();

void enable();
// Off at once, from anywhere: also from an interrupt in the middle of a control tick.
void cut();
bool enabled();

// -255 ... 255. While the motors are cut, nothing but 0 reaches a bridge. A motor that is to turn round
// has no drive for one call: its bridge changes direction only while it is off.
void drive(uint8_t axis, int16_t value);

} // namespace motors
