// Why the CPU started.
#pragma once

#include <avr/pgmspace.h>
#include <stdint.h>

namespace reset_cause {

// "power", "external", "brownout", "watchdog" or "unexpected"; worked out once, at the start.
PGM_P name();
// What a host must hear of it (GLOBAL_BROWNOUT, GLOBAL_INTERRUPTED), kept over other resets until forget().
uint8_t flags();
void forget();

void begin();
// Start the hardware watchdog: two of its times of 125 ms without alive(), and the CPU resets.
void watch();

// Every control tick: the host may have gone. Every good line of the host: it has not.
void tick(bool powered);
void heard();
// While both the control and the main loop run.
void alive();

} // namespace reset_cause
