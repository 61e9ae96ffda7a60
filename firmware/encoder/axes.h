// The six joints and their motors: which motor turns which joint, where they are, what drives them.
//
// Without a pair, joint and motor of an axis are the same. The two axes of a differential pair count
// their joints as the sum (pitch) and the difference (roll) of their motors' counts; smoothing, limits
// and homing are those of the joints, control and stall detection those of the motors.
#pragma once

#include <stdint.h>

#include "config.h"
#include "drive_watch.h"
#include "pid.h"
#include "profile.h"
#include "settings.h"

constexpr uint8_t NO_AXIS = 0xFF;

class Axes {
public:
    void begin();

    // Only while the motors are off.
    void configure(uint8_t axis, const Settings &settings);
    void pair(uint8_t sum, uint8_t difference);

    const Settings &settings(uint8_t axis) const { return settings_[axis]; }
    Profile &profile(uint8_t axis) { return joints_[axis].profile; }
    uint8_t pair_sum() const { return sum_; }
    uint8_t pair_difference() const { return difference_; }
    // The other axis of its pair, or NO_AXIS.
    uint8_t partner(uint8_t axis) const;
    // Its motor gets drive: the axis is used, or the other one of its pair is.
    bool driven(uint8_t axis) const;

    // Joint counts.
    int32_t position(uint8_t axis) const { return joints_[axis].position; }
    // Where the setpoint is, less where the joint is.
    int32_t following_error(uint8_t axis) const {
        return joints_[axis].profile.nearest_count() - joints_[axis].position;
    }
    // Edges that its encoders have lost since the joint was counted anew (or since the start); 255: or more.
    // Each is 2 counts up or down.
    uint8_t lost_edges(uint8_t axis) const { return joints_[axis].lost_edges; }
    // Whether there are more of them, on any axis, since the last call.
    bool take_losses() {
        const bool some = losses_;
        losses_ = false;
        return some;
    }
    // Make a joint position count as another.
    void recount(uint8_t axis, int32_t from, int32_t to);

    // Every control tick, in this order; the last two only while the motors are on.
    void measure();
    void advance();
    void drive();
    // Of the motor, after drive().
    DriveWatch::Verdict verdict(uint8_t axis) const { return motors_[axis].verdict; }

    // Hold every joint where it is.
    void hold_here();
    // Start anew against a stop: without what the control has wound up.
    void relax(uint8_t axis);
    bool at_rest() const;

private:
    struct Joint {
        Profile profile;
        int32_t offset = 0; // joint counts = counts of the motors + offset
        int32_t fine_offset = 0; // [1/512 count]
        int32_t position = 0;
        uint8_t lost_edges = 0;
    };
    struct Motor {
        Pid pid;
        DriveWatch watch;
        DriveWatch::Verdict verdict = DriveWatch::FINE;
        int32_t count = 0;
        int32_t velocity = 0; // filtered [1/256 count/s]
        uint8_t still_ticks = 0;
        uint8_t turned = 0; // how often at speed, and for how many ticks that speed has gone on since
        uint8_t fast_ticks = 0;
        bool backward = false;
    };

    void note_lost(uint8_t axis, uint8_t edges);
    static uint8_t lost_pulses(Motor &motor, uint8_t turned);
    bool pair_is_off() const;
    void locate();

    Settings settings_[AXES];
    Joint joints_[AXES];
    Motor motors_[AXES];
    uint8_t sum_ = NO_AXIS;
    uint8_t difference_ = NO_AXIS;
    bool losses_ = false;
};
