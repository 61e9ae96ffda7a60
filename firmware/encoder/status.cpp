#include "status.h"

namespace {

// 125/64 of the ticks, without overflow before that of the milliseconds.
uint32_t milliseconds(uint32_t ticks) { return (ticks >> 6) * 125 + (((ticks & 63) * 125) >> 6); }
static_assert(TICK_HZ == 512, "as above");

} // namespace

void write_status(Writer &line, Controller &controller) {
    // Copied under the lock and written after it: digits take long.
    int32_t positions[AXES];
    uint8_t faults[AXES];
    Mode mode;
    uint32_t ticks;
    uint8_t homed, switches, global;
    {
        const TickLock lock;
        for (uint8_t axis = 0; axis < AXES; ++axis) {
            positions[axis] = controller.axes().position(axis);
            faults[axis] = controller.faults(axis);
        }
        mode = controller.mode();
        ticks = controller.ticks();
        homed = controller.homed();
        switches = controller.switches();
        global = controller.global();
        controller.forget_overrun();
    }
    line.unsigned_number(milliseconds(ticks));
    line.put(' ');
    line.put(static_cast<char>(mode));
    const uint8_t sets[] = {homed, switches, global};
    for (const uint8_t bits : sets) {
        line.put(' ');
        line.hex2(bits);
    }
    line.put(' ');
    for (const uint8_t bits : faults) line.hex2(bits);
    for (const int32_t position : positions) line.next_number(position);
}
