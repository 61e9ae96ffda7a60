// Tells when the host has been silent for too long.
#pragma once

#include <stdint.h>

#include "config.h"

class HostWatchdog {
public:
    void set_ms(uint16_t ms) {
        ticks_ = static_cast<uint16_t>(static_cast<uint32_t>(ms) * TICK_HZ / 1000);
        const uint16_t brake = ms_to_ticks(BRAKE_MS);
        brake_ticks_ = brake < ticks_ / 2 ? brake : ticks_ / 2;
    }
    void feed() { silent_ = 0; }

    // In which it matters, as many ticks later: true when it is time to brake.
    bool step(uint8_t ticks) {
        silent_ = static_cast<uint16_t>(silent_ + ticks);
        return silent_ >= ticks_ - brake_ticks_;
    }

    // How long braking may take, for the motors to be off in time.
    uint16_t brake_ticks() const { return brake_ticks_; }

private:
    uint16_t ticks_ = 0;
    uint16_t brake_ticks_ = 0;
    uint16_t silent_ = 0;
};
