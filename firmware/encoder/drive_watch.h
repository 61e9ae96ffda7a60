// Tells a motor that is driven as hard as it may be and does not turn.
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

    void set(uint16_t ticks, uint8_t full_drive) {
        limit_ = ticks;
        full_drive_ = full_drive;
    }
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
        if (drive < full_drive_ && drive > -full_drive_) ticks_ = 0;
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
    uint8_t full_drive_ = FULL_DRIVE;
    bool moved_ = false;
};
