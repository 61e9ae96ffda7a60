#include "reset_cause.h"

#include <avr/io.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "config.h"

namespace {

// Kept over a reset. The Mega's boot loader clears MCUSR before we see it, so a hang is told by how
// long the main loop had been silent when the CPU was reset.
struct Trace {
    uint16_t mark;
    uint16_t unmark;
    volatile uint16_t silent_ticks;
};

constexpr uint16_t MARK = 0xA5C3;
constexpr uint16_t HANG_TICKS = ms_to_ticks(200); // a little less than the hardware watchdog takes

Trace trace __attribute__((section(".noinit")));
uint8_t flags __attribute__((section(".noinit")));

const char POWER[] PROGMEM = "power";
const char EXTERNAL[] PROGMEM = "external";
const char BROWNOUT[] PROGMEM = "brownout";
const char WATCHDOG[] PROGMEM = "watchdog";

PGM_P cause = POWER;

PGM_P find() {
    if (flags & _BV(PORF)) return POWER; // brown-out and reset flags then say nothing
    if (flags & _BV(WDRF)) return WATCHDOG;
    if (flags & _BV(BORF)) return BROWNOUT;
    if (flags & _BV(EXTRF)) return EXTERNAL;
    if (trace.mark != MARK || trace.unmark != static_cast<uint16_t>(~MARK)) return POWER;
    return trace.silent_ticks >= HANG_TICKS ? WATCHDOG : EXTERNAL;
}

} // namespace

// Before main(): the watchdog stays on after its own reset, with its shortest time.
extern "C" void keep_reset_flags() __attribute__((naked, used, section(".init3")));
extern "C" void keep_reset_flags() {
    flags = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

namespace reset_cause {

PGM_P name() { return cause; }

bool brownout() { return cause == BROWNOUT; }

void begin() {
    cause = find();
    trace.mark = MARK;
    trace.unmark = static_cast<uint16_t>(~MARK);
    trace.silent_ticks = 0;
}

void tick() {
    if (trace.silent_ticks != 0xFFFF) trace.silent_ticks = trace.silent_ticks + 1;
}

void alive() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { trace.silent_ticks = 0; }
}

} // namespace reset_cause
