// What happened in a control tick and the host must hear of: queued there, sent by the main loop.
#pragma once

#include <avr/pgmspace.h>
#include <stdint.h>

#include "ring.h"
#include "text.h"

enum class EventKind : uint8_t { HOMED, HOME_DONE, HOME_FAILED, TRIP, WATCHDOG, STOPPED, HELD };

enum Fault : uint8_t {
    FAULT_STALL = 1,
    FAULT_FOLLOW = 2,
    FAULT_ENCODER = 4,
    FAULT_HOMING = 8,
    FAULT_LIMIT = 16,
    FAULT_LOST = 32,
};

enum class HomingFailure : uint8_t { NOT_FOUND, STUCK, TIMEOUT };

struct Event {
    EventKind kind;
    uint8_t axis;
    uint8_t detail; // of TRIP: the Fault; of HOME_FAILED: the HomingFailure
};

// When the queue is full an event is dropped; the status line still tells its outcome.
using EventQueue = Ring<Event, 16>;

void write_event(Writer &line, const Event &event);
