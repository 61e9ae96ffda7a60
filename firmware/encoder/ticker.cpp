#include "ticker.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "config.h"

namespace {

void (*on_tick)();
volatile bool locked;
volatile bool running;
volatile bool waiting; // a tick came while it could not run
volatile bool ticked;
volatile uint8_t left_out;

bool take_waiting() {
    bool was;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        was = waiting;
        waiting = false;
    }
    return was;
}

void run_once() {
    PORTB |= _BV(PB6);
    on_tick();
    PORTB &= static_cast<uint8_t>(~_BV(PB6));
    ticked = true;
}

void run() {
    running = true;
    run_once();
    if (take_waiting()) run_once();
    running = false;
}

} // namespace

// A tick that cannot run at once runs a little later, one of them: the main loop has to run as well.
ISR(TIMER1_COMPA_vect, ISR_NOBLOCK) {
    if (!locked && !running) return run();
    if (!waiting) waiting = true;
    else if (left_out != 255) left_out = left_out + 1;
}

namespace ticker {

void begin(void (*tick)()) {
    on_tick = tick;
    DDRB |= _BV(PB6);
    TCCR1A = 0;
    OCR1A = CPU_HZ / TICK_HZ - 1;
    TCNT1 = 0;
    TCCR1B = _BV(WGM12) | _BV(CS10);
    TIMSK1 = _BV(OCIE1A);
}

bool take_ticked() {
    const bool was = ticked;
    if (was) ticked = false;
    return was;
}

uint8_t take_left_out() {
    uint8_t count;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        count = left_out;
        left_out = 0;
    }
    return count;
}

} // namespace ticker

TickLock::TickLock() {
    locked = true;
    asm volatile("" ::: "memory");
}

TickLock::~TickLock() {
    asm volatile("" ::: "memory");
    locked = false;
    if (take_waiting()) run();
}
