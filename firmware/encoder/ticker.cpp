#include "ticker.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "config.h"

namespace {

void (*on_tick)();
volatile bool locked;
volatile bool missed;
volatile bool running;
volatile bool ticked;

void run() {
    // A tick that takes longer than its time is not piled on: the next one is left out.
    if (running) return;
    running = true;
    PORTB |= _BV(PB6);
    on_tick();
    PORTB &= static_cast<uint8_t>(~_BV(PB6));
    ticked = true;
    running = false;
}

} // namespace

ISR(TIMER1_COMPA_vect, ISR_NOBLOCK) {
    if (locked) missed = true;
    else run();
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

} // namespace ticker

TickLock::TickLock() {
    locked = true;
    asm volatile("" ::: "memory");
}

TickLock::~TickLock() {
    asm volatile("" ::: "memory");
    locked = false;
    if (missed) {
        missed = false;
        run();
    }
}
