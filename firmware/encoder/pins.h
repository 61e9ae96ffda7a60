// Spare pins that the host names: inputs whose changes are counted, and outputs.
//
// They are the whole of port L: Arduino pins 42 (PL7) ... 49 (PL0).
#pragma once

#include <stdint.h>

constexpr uint8_t FIRST_PIN = 42;
constexpr uint8_t PINS = 8;

enum class PinUse : uint8_t { OFF, IN, UP, OUT };
enum class PinLoss : uint8_t { KEEP, LOW, HIGH }; // what an output does when the host is lost

class Pins {
public:
    // index: 0 is pin 42. high: of a new output; one that is one already keeps its level.
    void use(uint8_t index, PinUse use, PinLoss loss, bool high);
    bool is_output(uint8_t index) const { return uses_[index] == PinUse::OUT; }
    void set(uint8_t index, bool high);

    // Every control tick.
    void sample(uint8_t ticks);
    // A good line came in.
    void feed() { silent_ = 0; }
    void set_watchdog_ticks(uint16_t ticks) { patience_ = ticks; }

    // Whether take_news() would say so. It reads bytes, so it needs no lock: one each turn of the main loop would
    // keep the control tick, and with it counts, waiting.
    bool has_news() const;
    // Whether an input has changed since the last call; true at most every 10 ms.
    bool take_news();

    // How often the pin has changed since it is in use, 0 ... 15 and round again; odd: it is high now.
    uint8_t changes(uint8_t index) const { return changes_[index] & 15; }

private:
    void lose_host();

    PinUse uses_[PINS] = {};
    PinLoss losses_[PINS] = {};
    uint8_t changes_[PINS] = {};
    uint8_t used_ = 0; // bits of the port
    uint8_t before_ = 0;
    uint16_t silent_ = 0;
    uint16_t patience_ = 0xFFFF;
    bool lost_ = false;
    uint8_t inputs_ = 0;
    volatile bool news_ = false;
    volatile uint8_t told_ago_ = 0; // ticks
};
