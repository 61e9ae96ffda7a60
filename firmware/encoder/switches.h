// The home switches. A switch closes to ground; one that opens instead is turned round by `sinv`.
#pragma once

#include <stdint.h>

class Switches {
public:
    static void begin();

    // Every control tick; bit i of opens: the switch of axis i is closed at rest.
    void sample(uint8_t opens);

    // Bit i: pressed now, bounces included.
    uint8_t touched() const { return touched_; }
    // Bit i: pressed for good.
    uint8_t pressed() const { return pressed_; }

private:
    // A level counts when it has been the same for so many ticks (8 ms: switches bounce for 1 ... 5).
    static constexpr uint8_t SETTLED = 4;

    uint8_t touched_ = 0;
    uint8_t pressed_ = 0;
    uint8_t same_[6] = {};
};
