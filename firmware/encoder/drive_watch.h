// Tells a motor that is driven fully and does not turn.
#pragma once

#include <stdint.h>

#include "config.h"

class DriveWatch {
public:
    enum Verdict : uint8_t {
        FINE,
        STALLED, // it has turned, and now does not
        SILENT,  // its encoder has not given a count since the motors were switched on
    };

    void set(uint16_t ticks) { limit_ = ticks; }
    void reset(int32_t count) {
        anchor_ = count;
        ticks_ = 0;
        moved_ = false;
    }
    // Count the time anew; what is known of the encoder stays.
    void restart() { ticks_ = 0; }

    // Every control tick.
    Verdict step(int32_t count, int16_t drive) {
        const int32_t way = count - anchor_;
        if (way >= MOVEMENT || way <= -MOVEMENT) {
            anchor_ = count;
            ticks_ = 0;
            moved_ = true;
        }
        if (drive < FULL_DRIVE && drive > -FULL_DRIVE) ticks_ = 0;
        else if (ticks_ < limit_) ++ticks_;
        if (ticks_ < limit_) return FINE;
        return moved_ ? STALLED : SILENT;
    }

private:
    // One count back and forth at an edge of the encoder is no movement.
    static constexpr int32_t MOVEMENT = 2;

    int32_t anchor_ = 0;
    uint16_t ticks_ = 0;
    uint16_t limit_ = 0xFFFF;
    bool moved_ = false;
};
