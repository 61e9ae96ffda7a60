// Position control of one motor.
#pragma once

#include <stdint.h>

#include "settings.h"

class Pid {
public:
    void set(const Settings &settings);
    void reset();

    struct Input {
        int32_t target;          // [1/512 count]
        int16_t target_velocity; // [counts/s]
        int32_t count;
        int16_t velocity; // [counts/s]
        bool standing;    // the motor has not moved for a while
        bool exact;       // a single count of error matters
    };
    // Every control tick; the drive, no larger than the axis's limit.
    int16_t step(const Input &input);

private:
    void integrate(int16_t error, bool resting, int16_t drive);
    int16_t push_off(int16_t error, const Input &input, int16_t drive);

    uint16_t p_ = 0, i_ = 0, d_ = 0;
    uint8_t breakaway_ = 0;
    uint8_t limit_ = 0;
    int32_t integral_limit_ = 0;
    int32_t integral_ = 0; // [1/16 count] summed over ticks
    uint8_t leak_ = 0;
    uint8_t pushed_ = 0; // ticks, each a step of drive more
};
