#include "status.h"

// How often each spare pin has changed, and by that its level.
void write_pins(Writer &line, Controller &controller) {
    uint8_t pins[PINS];
    {
        const TickLock lock;
        for (uint8_t index = 0; index < PINS; ++index) pins[index] = controller.pins().changes(index);
    }
    for (const uint8_t changes : pins) line.hex1(changes);
}

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
    line.put(' ');
    write_pins(line, controller);
    for (const int32_t position : positions) line.next_number(position);
}
