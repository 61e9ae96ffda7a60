// Finds the home of one joint after the other.
//
// With a switch: towards it (and back the other way if a stop comes first, for a switch in the middle of
// the range), back until it is free again, then slowly on to it. The edge met last is the home, always
// the same one of the two that a switch some 200 counts wide has. Without a switch: against the stop,
// off it, and slowly against it again.
#pragma once

#include <stdint.h>

#include "axes.h"
#include "drive_watch.h"
#include "events.h"
#include "switches.h"

class Homing {
public:
    enum Outcome : uint8_t {
        GOING_ON,
        AXIS_HOMED, // axis() is; call step() again for the next
        DONE,
        FAILED,   // failure() says why
        RUNAWAY,  // it turns the wrong way
        NO_COUNTS // driven, and the encoder says nothing
    };

    // The axes whose bits are set, in their homing order.
    void begin(Axes &axes, uint8_t wanted);
    void abort() { state_ = IDLE; }
    bool active() const { return state_ != IDLE; }
    uint8_t axis() const { return axis_; }
    HomingFailure failure() const { return failure_; }

    // Every control tick while active(), before the profiles advance. The verdict is the worse one of
    // the motors that turn the joint.
    Outcome step(Axes &axes, const Switches &switches, DriveWatch::Verdict verdict);

private:
    enum State : uint8_t { IDLE, SEARCH, SEARCH_BACK, RETREAT, APPROACH, PARK };

    bool next_axis(Axes &axes, const Switches &switches);
    void go(Axes &axes, State state, int8_t direction, uint16_t velocity);
    Outcome on_stall(Axes &axes, DriveWatch::Verdict verdict);
    Outcome take_home(Axes &axes, int32_t edge);
    Outcome fail(HomingFailure failure);
    Outcome search(Axes &axes, bool pressed);
    Outcome retreat(Axes &axes, bool pressed);
    Outcome approach(Axes &axes, const Switches &switches);
    Outcome park(Axes &axes);

    State state_ = IDLE;
    uint8_t axis_ = 0;
    uint8_t wanted_ = 0;
    bool started_ = false; // axis_ is under way
    int8_t direction_ = 1;
    int32_t from_ = 0;       // where this leg began
    int32_t way_limit_ = 0;  // how far it may go
    uint32_t ticks_left_ = 0;
    int32_t sighted_ = 0;    // where the switch (or the stop) was first met
    int32_t edge_ = 0;       // where the switch began to touch on the slow approach
    bool touching_ = false;
    HomingFailure failure_ = HomingFailure::NOT_FOUND;
};
