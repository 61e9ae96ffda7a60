// Setpoint smoothing of one joint: a trapezoid of velocity inside the joint's limits.
//
// The host's setpoints are joined by straight lines in time. The profile follows that line: it heads
// for it with the full acceleration and slows down in time to arrive at the line's own velocity, so
// that a trajectory within the limits is followed without a lag and a jump becomes a trapezoid. A short
// line is a piece of a stream: its end is passed with the line's velocity, as the next piece will go on.
// A long one is a move: it ends at rest.
#pragma once

#include <stdint.h>

#include "config.h"
#include "shift.h"

class Profile {
public:
    // Soft limits [counts], of velocity [counts/s] and of acceleration [counts/s2].
    void limit(int32_t low, int32_t high, uint16_t velocity, uint16_t acceleration);

    // Be at rest at a count.
    void stand_at(int32_t count);
    // Reach a count in so many ticks, or as soon as the limits allow.
    void go_to(int32_t count, uint16_t ticks);
    // Run at a velocity [counts/s]; 0 slows down to rest.
    void run_at(int16_t velocity);
    // Slow down to rest in so many ticks, whatever the acceleration that takes.
    void brake(uint16_t ticks);

    // Every control tick.
    void step();

    // Count differently from now on (homing).
    void shift(int32_t counts);
    // Stay within a distance of where the joint really is (homing against a stop).
    void stay_near(int32_t count, int32_t distance);

    int32_t position() const { return position_; } // [1/512 count]
    int16_t velocity() const { return static_cast<int16_t>(shifted_down<TICK_SHIFT>(velocity_)); } // [counts/s]
    int32_t nearest_count() const { return shifted_down<TICK_SHIFT>(position_ + (1 << (TICK_SHIFT - 1))); }
    bool at_rest() const;

private:
    void follow();
    void advance_line();
    bool must_stop_here() const;
    void change_velocity();
    bool must_brake(uint16_t v, uint32_t distance) const;

    int32_t position_ = 0; // [1/512 count]
    int32_t velocity_ = 0; // [1/512 count/s]
    int32_t low_ = 0, high_ = 0; // [1/512 count]
    int32_t longest_stop_ = 0;   // farther from a limit than this, nothing has to brake for it [1/512 count]
    int16_t velocity_limit_ = 1;
    int32_t velocity_limit_fine_ = 1; // [1/512 count/s]
    uint16_t acceleration_ = 1; // [counts/s2], which is [1/512 count/s] a tick

    bool following_ = true;
    // While following: the line to the goal.
    int32_t line_ = 0;      // where the line is now [1/512 count]
    int32_t line_step_ = 0; // [1/512 count] a tick, which is [counts/s]
    int32_t goal_ = 0;      // [1/512 count]
    uint16_t line_ticks_ = 0;
    int16_t line_velocity_ = 0; // [counts/s]
    bool ends_at_rest_ = false;
    // While running at a velocity.
    int32_t velocity_goal_ = 0; // [1/512 count/s]
    int32_t velocity_step_ = 1; // [1/512 count/s] a tick
};
