// armctl's firmware for arms whose motors have encoders: Arduino Mega 2560 (ATmega2560, 16 MHz).
//
// Three layers of urgency: encoder edges and serial bytes in short interrupts; the control of all axes
// in a timer interrupt that these may interrupt; lines, answers and the status in the main loop.
#include <avr/interrupt.h>
#include <avr/sleep.h>

#include "config.h"
#include "controller.h"
#include "encoders.h"
#include "motors.h"
#include "protocol.h"
#include "reset_cause.h"
#include "serial_port.h"
#include "ticker.h"

namespace {

Controller controller;
Protocol protocol(controller);

void tick() {
    controller.tick();
    reset_cause::tick(controller.powered());
}

// Until the next interrupt, but not when a byte came just now.
void rest() {
    cli();
    if (!serial_port::received()) {
        sleep_enable();
        sei(); // takes effect after the next instruction
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

} // namespace

int main() {
    motors::begin();
    reset_cause::begin();
    encoders::begin();
    Switches::begin();
    serial_port::begin();
    controller.begin(reset_cause::flags());
    ticker::begin(tick);
    protocol.begin();
    set_sleep_mode(SLEEP_MODE_IDLE);
    reset_cause::watch();
    sei();
    for (;;) {
        // Only while both the control and this loop run; else the CPU resets, and its pins let go.
        if (ticker::take_ticked()) reset_cause::alive();
        protocol.turn();
        rest();
    }
}
