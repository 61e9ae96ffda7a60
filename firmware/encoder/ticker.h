// The timer interrupt that the control runs in, and the lock that keeps it away from shared data.
#pragma once

#include <stdint.h>

namespace ticker {

// Call a function TICK_HZ times a second, with interrupts allowed.
void begin(void (*tick)());

// Whether there was a tick since the last call.
bool take_ticked();

// How many ticks had no time since the last call; for the control tick.
uint8_t take_left_out();

} // namespace ticker

// Keeps the control tick away while it lives; encoders and serial line go on. A tick that falls into
// it runs at its end. For the main loop only, and not one inside another.
class TickLock {
public:
    TickLock();
    ~TickLock();
    TickLock(const TickLock &) = delete;
    TickLock &operator=(const TickLock &) = delete;
};
