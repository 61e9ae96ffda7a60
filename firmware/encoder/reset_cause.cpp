#include "reset_cause.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "config.h"
#include "controller.h"
#include "motors.h"

namespace {

// Kept over a reset, not over a loss of power. The Mega's boot loader clears MCUSR before we see it: then
// what the board was doing tells why it was reset.
struct Trace {
    uint16_t mark;
    uint16_t unmark;
    volatile uint16_t unheard_ticks; // since the host's last good line
    volatile bool powered;           // the motors were on
    volatile bool hung;              // the watchdog has struck
    volatile uint8_t flags;          // that no host has cleared yet
};

constexpr uint16_t MARK = 0xA5C4;
// A host that works with the board is never silent for longer.
constexpr uint16_t WORKING_TICKS = ms_to_ticks(WATCHDOG_MAX_MS);

Trace trace __attribute__((section(".noinit")));
uint8_t reset_flags __attribute__((section(".noinit")));

const char POWER[] PROGMEM = "power";
const char EXTERNAL[] PROGMEM = "external";
const char BROWNOUT[] PROGMEM = "brownout";
const char WATCHDOG[] PROGMEM = "watchdog";
const char UNEXPECTED[] PROGMEM = "unexpected";

PGM_P cause = POWER;

bool kept() { return trace.mark == MARK && trace.unmark == static_cast<uint16_t>(~MARK); }

PGM_P find() {
    if (reset_flags & _BV(PORF)) return POWER; // brown-out and reset flags then say nothing
    if (reset_flags & _BV(WDRF)) return WATCHDOG;
    if (reset_flags & _BV(BORF)) return BROWNOUT;
    if (reset_flags & _BV(EXTRF)) return EXTERNAL;
    if (!kept()) return POWER;
    if (trace.hung) return WATCHDOG;
    // A sagging supply, most likely. A host that opens the port resets the board, too, but before it speaks.
    return trace.powered || trace.unheard_ticks < WORKING_TICKS ? UNEXPECTED : EXTERNAL;
}

} // namespace

// Before main(): the watchdog stays on after its own reset, with its shortest time.
extern "C" void keep_reset_flags() __attribute__((naked, used, section(".init3")));
extern "C" void keep_reset_flags() {
    reset_flags = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

// Half of the time is over: the motors go off, and nothing else happens until the reset.
ISR(WDT_vect) {
    motors::cut();
    trace.hung = true;
    for (;;) {
    }
}

namespace reset_cause {

PGM_P name() { return cause; }

uint8_t flags() { return trace.flags; }

void forget() { trace.flags = 0; }

void begin() {
    cause = find();
    if (cause == POWER || !kept()) trace.flags = 0;
    if (cause == BROWNOUT) trace.flags = trace.flags | GLOBAL_BROWNOUT;
    if (cause == WATCHDOG || cause == UNEXPECTED) trace.flags = trace.flags | GLOBAL_INTERRUPTED;
    trace.mark = MARK;
    trace.unmark = static_cast<uint16_t>(~MARK);
    trace.unheard_ticks = WORKING_TICKS;
    trace.powered = trace.hung = false;
}

void watch() {
    wdt_reset();
    WDTCSR = _BV(WDCE) | _BV(WDE);
    WDTCSR = _BV(WDIE) | _BV(WDE) | _BV(WDP1) | _BV(WDP0); // 125 ms to the interrupt, as much to the reset
}

void tick(bool powered) {
    trace.powered = powered;
    if (trace.unheard_ticks < WORKING_TICKS) trace.unheard_ticks = trace.unheard_ticks + 1;
}

void heard() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { trace.unheard_ticks = 0; }
}

void alive() { wdt_reset(); }

} // namespace reset_cause
