// What is wired where, and the constants of this firmware. The arm itself (limits, gains, homing) is
// told by the host with CFG; see settings.cpp for what holds until then.
//
// Pins of the Arduino Mega 2560, by axis:
//
//   axis                       0    1    2    3    4    5
//   motor PWM                  5    2    3    6    7    8     timers 3 and 4
//   motor direction           37   36   35   34   33   32     PC0 ... PC5
//   encoder A                 21   19   A8  A10  A12  A14
//   encoder B                 20   18   A9  A11  A13  A15
//   home switch               22   23   24   25   26   27     PA0 ... PA5, to ground
//
//   motors on (relay, or all enables)    9   PH6, high = on; pull it down with 10 kOhm
//   lamp: motors are on                13   PB7, the lamp of the board
//   control tick, for an oscilloscope  12   PB6, high while the control of all axes runs
//   spare, named by the host     42 ... 49   PL7 ... PL0: inputs and outputs, see pins.h
//
// Encoders of axes 0 and 1 are on PD0 ... PD3 (external interrupts INT0 ... INT3), those of axes 2 ... 5
// on PK0 ... PK7 (pin-change interrupts PCINT16 ... 23): whole ports, so that one read gives both
// channels of an axis at the same instant. The input ports carry no outputs.
#pragma once

#include <stdint.h>

// Whatever the Arduino IDE says: a tenth faster, and there is memory enough.
#pragma GCC optimize("O2")

// PROTOCOL_VERSION goes up with whatever a host has to know of: a key, a command, a field of the status.
#define FIRMWARE_VERSION "1.3.0"
#define PROTOCOL_VERSION "4"
#define BANNER_HEAD "armctl-encoder " FIRMWARE_VERSION " proto=" PROTOCOL_VERSION " axes=6 reset="

constexpr uint8_t AXES = 6;
constexpr uint32_t CPU_HZ = 16000000UL;
constexpr uint32_t BAUD = 115200UL;

// 512 control ticks a second: the CPU clock divides by it without a rest, and what is counted in
// counts/s and in 1/512 count a tick is the same number, so no tick needs a division. A tick of all six
// axes takes 13,000 of its 31,250 cycles, up to 25,000 with the interrupts of six encoders at full speed.
constexpr uint16_t TICK_HZ = 512;
constexpr uint8_t TICK_SHIFT = 9;

constexpr uint8_t STATUS_EVERY_MS = 20;

// The longest lines. The host's are bounded by the protocol; our longest is the answer to GET, with all
// its numbers as long as they get.
constexpr uint8_t LINE_MAX = 96;
constexpr uint8_t ANSWER_MAX = 127;

constexpr int16_t FULL_DRIVE = 255;

// The fastest that an axis may be told to run, and a homing. Six axes at this speed, a little beyond it while
// they swing, lose no edge and no control tick; ticks are left out from 8,000 on, edges lost from 15,000.
constexpr int32_t FASTEST = 6000; // counts/s

// Edges that an axis may lose between two homings: 8 counts of doubt, a few hundredths of a degree at a
// Scorbot's base and a quarter of one at its wrist, about what its gears have as well.
constexpr uint8_t LOST_EDGES_MAX = 4;

constexpr uint16_t WATCHDOG_DEFAULT_MS = 500;
constexpr uint16_t WATCHDOG_MIN_MS = 50;
constexpr uint16_t WATCHDOG_MAX_MS = 500;
// Of the watchdog's time, this much is kept for braking, so that the motors are off when it is over.
constexpr uint16_t BRAKE_MS = 100;

constexpr uint16_t ms_to_ticks(uint32_t ms) { return static_cast<uint16_t>((ms * TICK_HZ + 999) / 1000); }
