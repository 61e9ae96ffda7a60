#include "status.h"

void write_status(Writer &line, Controller &controller) {
    // Copied under the lock and written after it: digits take long.
    int32_t positions[AXES];
    uint8_t faults[AXES], lost[AXES];
    Mode mode;
    uint32_t now;
    uint8_t homed, switches, global;
    {
        const ControlLock lock(controller);
        for (uint8_t axis = 0; axis < AXES; ++axis) {
            positions[axis] = controller.axes().position(axis);
            faults[axis] = controller.faults(axis);
            lost[axis] = controller.axes().lost_edges(axis);
        }
        mode = controller.mode();
        now = controller.milliseconds();
        homed = controller.homed();
        switches = controller.switches();
        global = controller.global();
        controller.forget_overrun();
    }
    line.unsigned_number(now);
    line.put(' ');
    line.put(static_cast<char>(mode));
    const uint8_t sets[] = {homed, switches, global};
    for (const uint8_t bits : sets) {
        line.put(' ');
        line.hex2(bits);
    }
    line.put(' ');
    for (const uint8_t bits : faults) line.hex2(bits);
    line.put(' ');
    for (const uint8_t edges : lost) line.hex1(edges < 15 ? edges : 15);
    for (const int32_t position : positions) line.next_number(position);
}
