// Why the CPU started.
#pragma once

#include <avr/pgmspace.h>
#include <stdint.h>

namespace reset_cause {

// "power", "external", "brownout" or "watchdog"; worked out once, at the start.
PGM_P name();
bool brownout();

void begin();

// Every control tick: the main loop may be hanging. Every turn of the main loop: it is not.
void tick();
void alive();

} // namespace reset_cause
